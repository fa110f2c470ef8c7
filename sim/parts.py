"""Finished pieces of an unfinished simulation: whole, or not there.

A *part* holds events and ground truth of some whole chunks, and the sensors' state behind them. It
is written under another name, flushed and renamed; hashes say whether it still is what was written.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs.data.event_store import EventStoreReader, EventStoreWriter
from emvs.data.image_stores import FrameReader, FrameWriter, Photo, TruthReader, TruthWriter
from emvs.geometry.rig import Rig

State = dict[str, NDArray[Any]]

_INDEX, _STATE = "part.json", "state.npz"


@dataclass(frozen=True)
class Part:
    """A finished part: chunks `first_chunk` up to and without `end_chunk`.

    Attributes:
        path: its folder.
        first_chunk: the first chunk in it.
        end_chunk: the first chunk behind it.
        events: of all cameras.
        counts: in the last part, what became of all events, per camera.
    """

    path: Path
    first_chunk: int
    end_chunk: int
    events: int
    counts: tuple[dict[str, int], ...] = ()

    def readers(self, camera: int, rig: Rig) -> tuple[EventStoreReader, TruthReader]:
        """Opens one camera's events and ground truth."""
        seen = rig.cameras[camera]
        events = EventStoreReader(self.path / _events_file(camera), seen.width_px, seen.height_px)
        return events, TruthReader(self.path / _truth_file(camera))

    def photos(self, camera: int) -> Iterator[Photo]:
        """One camera's pictures that were completed in this part."""
        path = self.path / _frames_file(camera)
        return FrameReader(path).photos() if path.exists() else iter(())

    @property
    def has_state(self) -> bool:
        """Whether the simulation can go on behind this part."""
        return (self.path / _STATE).exists()

    def drop_state(self) -> None:
        """Makes room: a state is as large as the memory of all pixels."""
        (self.path / _STATE).unlink(missing_ok=True)

    def state(self) -> State:
        """The sensors' state behind the part."""
        with np.load(self.path / _STATE) as stored:
            return {name: stored[name] for name in stored.files}


class PartWriter:
    """Writes one part, in a folder that does not count before it is renamed."""

    def __init__(self, path: Path, first_chunk: int, rig: Rig) -> None:
        self.path, self.first_chunk, self.events = path, first_chunk, 0
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
        self._files, self._rig = ExitStack(), rig
        self._frame_writers: dict[int, FrameWriter] = {}
        self.event_writers: list[EventStoreWriter] = []
        self.truth_writers: list[TruthWriter] = []
        for k, camera in enumerate(rig.cameras):
            size_px = camera.width_px, camera.height_px
            events = EventStoreWriter(path / _events_file(k), *size_px)
            self.event_writers.append(self._files.enter_context(events))
            truth = TruthWriter(path / _truth_file(k), *size_px)
            self.truth_writers.append(self._files.enter_context(truth))

    def append_photo(self, camera: int, photo: Photo) -> None:
        """Adds a picture; the first one of a camera makes its file."""
        if camera not in self._frame_writers:
            seen = self._rig.cameras[camera]
            file = FrameWriter(self.path / _frames_file(camera), seen.width_px, seen.height_px)
            self._frame_writers[camera] = self._files.enter_context(file)
        self._frame_writers[camera].append(photo)

    def close(self) -> None:
        """Closes its files."""
        self._files.close()

    def finish(self, state: State, end_chunk: int, counts: Sequence[dict[str, int]] = ()) -> Part:
        """Adds state and hashes, flushes everything to the disk, and makes the part count."""
        self.close()
        np.savez(self.path / _STATE, **state)  # type: ignore[arg-type,unused-ignore]
        index = {
            "first_chunk": self.first_chunk,
            "end_chunk": end_chunk,
            "events": self.events,
            "counts": list(counts),
            "files": {file.name: _sha256(file) for file in sorted(self.path.iterdir())},
        }
        (self.path / _INDEX).write_text(json.dumps(index, indent=1), encoding="utf-8")
        for file in (*self.path.iterdir(), self.path):
            _sync(file)
        whole = self.path.with_suffix("")
        self.path.rename(whole)
        _sync(whole.parent)
        return Part(whole, self.first_chunk, end_chunk, self.events, tuple(counts))


def whole_part(path: Path) -> Part | None:
    """The part in a folder, or None where anything is missing or changed."""
    try:
        index = json.loads((path / _INDEX).read_text(encoding="utf-8"))
        for name, digest in index["files"].items():
            file = path / name
            if not (name == _STATE and not file.exists()) and _sha256(file) != digest:
                return None
        first, end, events = (int(index[name]) for name in ("first_chunk", "end_chunk", "events"))
        return Part(path, first, end, events, tuple(index["counts"]))
    except (OSError, KeyError, TypeError, ValueError, AttributeError):
        return None


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _events_file(camera: int) -> str:
    return f"cam{camera}.events.h5"


def _truth_file(camera: int) -> str:
    return f"cam{camera}.truth.h5"


def _frames_file(camera: int) -> str:
    return f"cam{camera}.frames.h5"
