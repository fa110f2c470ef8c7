"""Checkpoints of unfinished simulations: whole or not there, and taken up by the next run.

A checkpoint holds the events and ground truth of some chunks, and the sensors' state behind them.
It is written under another name, flushed and renamed; hashes say whether it still is what was
written.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.event_store import EventStoreReader, EventStoreWriter
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import (
    FrameReader,
    FrameWriter,
    Photo,
    TruthReader,
    TruthWriter,
)
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.files import made_parent, work_folder, write_text
from eventsweep.emvs.utils.inputs import TABLE_BYTES, parse_json, read_text
from eventsweep.emvs.utils.output_manifest import hashed
from eventsweep.emvs.utils.outputs import real

Notice = Callable[[str], None]
"""Called with one line for people to read."""
State = dict[str, NDArray[Any]]
"""Everything that later events depend on."""
_FORMAT = 3
# Files of the folder, and of each checkpoint in it.
_KEY, _LOCK = "job.json", "lock"
_INDEX, _STATE = "part.json", "state.npz"
_OURS = re.compile(
    r"job\.json|lock|\.job\.json\.partial(/.*)?"
    r"|\d{6}(\.partial)?(/(part\.json|state\.npz|cam\d+\.(events|truth|frames)\.h5))?"
)
# A damaged checkpoint costs the work back to the last state before it.
_STATES_KEPT = 3


class Stopped(InputError):
    """Something outside the input stopped the work; run again to go on."""


class CheckpointFolder:
    """A context that holds the checkpoints of the target `out`, for one process at a time.

    Left with an error, they stay for the next run if one is finished; they go if none is, or if the
    input was wrong, because then what is done is of no use. The target is never touched. The key
    says what is being made, and `begun_with` by which renderer. Without `resume`, what is there is
    discarded.

    Raises:
        InputError: another process works on the target, the folder cannot be made, or what is there
            was made with other parameters.
    """

    def __init__(
        self, out: Path, key: str, rig: Rig, *, renderer: str, resume: bool, notice: Notice
    ) -> None:
        self.path = checkpoint_path(out)
        self.finished: list[Checkpoint] = []
        self._out, self._rig = out, rig
        self._made_of = {"format": _FORMAT, "key": key, "renderer": renderer}
        self._resume, self._notice = resume, notice
        self._open: CheckpointWriter | None = None

    def __enter__(self) -> CheckpointFolder:
        _refuse_foreign(self.path)
        with ExitStack() as stack:
            stack.enter_context(made_parent(self.path / _LOCK, make=False))
            try:
                self.path.mkdir(parents=True, exist_ok=True)
                self._lock = stack.enter_context(_opened(self.path / _LOCK))
            except OSError as error:
                raise InputError(
                    f"cannot work in {self.path.parent} ({error.strerror}): choose another output"
                ) from error
            self._take_lock()
            self._take_up()
            self._closing = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._open is not None:
            self._open.close()
            shutil.rmtree(self._open.path, ignore_errors=True)
        wrong = isinstance(error, InputError) and not isinstance(error, Stopped)
        if error is None or wrong or not self.finished:
            shutil.rmtree(self.path, ignore_errors=True)
        # Of an error it makes the folders go that were made for this, and are empty.
        self._closing.__exit__(kind, error, trace)

    @property
    def next_chunk(self) -> int:
        """The first chunk that is not done."""
        return self.finished[-1].end_chunk if self.finished else 0

    @property
    def writer(self) -> CheckpointWriter:
        """The checkpoint that is being written."""
        if self._open is None:
            name = f"{len(self.finished):06d}.partial"
            self._open = CheckpointWriter(self.path / name, self.next_chunk, self._rig)
        return self._open

    def commit(self, state: State, end_chunk: int, counts: Sequence[dict[str, int]] = ()) -> None:
        """Finishes the checkpoint that is being written, with the sensors' state behind it."""
        self.finished.append(self.writer.finish(state, end_chunk, counts))
        self._open = None
        for checkpoint in self.finished[-_STATES_KEPT - 1 : -_STATES_KEPT]:
            # Makes room: a state is as large as the memory of all pixels.
            (checkpoint.path / _STATE).unlink(missing_ok=True)

    def _take_lock(self) -> None:
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError(
                f"{self._out}: another process is writing it: wait, or choose another output"
            ) from error

    def _take_up(self) -> None:
        # What a killed process left of a checkpoint, or of putting the sequence together.
        for folder in self.path.glob("*.partial"):
            shutil.rmtree(folder, ignore_errors=True)
        with work_folder(real(self._out)):
            pass
        job = self.path / _KEY
        if self._resume and job.exists():
            if _json(job) != self._made_of:
                raise InputError(
                    f"{self.path} holds unfinished work with other parameters, scene or "
                    "versions: finish it with those, or set resume=False to discard it"
                )
            self._find_checkpoints()
            return
        for entry in self.path.iterdir():
            if entry.is_dir():
                shutil.rmtree(entry)
        write_text(job, json.dumps(self._made_of))

    def _find_checkpoints(self) -> None:
        """The longest run of whole checkpoints from the start that ends with a state."""
        paths = sorted(path for path in self.path.iterdir() if path.is_dir())
        for path in paths:
            checkpoint = read_checkpoint(path)
            if checkpoint is None or checkpoint.first_chunk != self.next_chunk:
                self._notice(f"{path} is damaged: everything after it is simulated again")
                break
            self.finished.append(checkpoint)
        while self.finished and not self.finished[-1].has_state:
            self.finished.pop()
        for path in paths[len(self.finished) :]:
            shutil.rmtree(path)


def begun_with(out: Path) -> str | None:
    """The renderer of a target's unfinished work; None where there is none."""
    path = checkpoint_path(out) / _KEY
    job = _json(path) if path.is_file() else None
    return job.get("renderer") if isinstance(job, dict) else None


def checkpoint_path(out: Path) -> Path:
    """Where the unfinished work of a target lies."""
    place = real(out)
    return place.parent / f".{place.name}.work"


def _refuse_foreign(path: Path) -> None:
    """Refuses a link in the place of the work folder, and a folder with anything else in it."""
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise InputError(f"{path}: is not a folder, but unfinished work is kept there: remove it")
    names = (file.relative_to(path).as_posix() for file in path.rglob("*"))
    foreign = sorted(
        name for name in names if not _OURS.fullmatch(name) or (path / name).is_symlink()
    )
    if foreign:
        raise InputError(
            f"{path}: is for unfinished work, but contains {quoted(*foreign)}: move it away"
        )


def _opened(path: Path) -> IO[str]:
    """Opens a file to lock it, which is never a link to another."""
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o666), "w")


@dataclass(frozen=True)
class Checkpoint:
    """Chunks `first_chunk` up to and without `end_chunk`, in a folder.

    The last checkpoint also counts what became of all events, per camera.
    """

    path: Path
    first_chunk: int
    end_chunk: int
    events: int
    counts: tuple[dict[str, int], ...] = ()

    def readers(self, camera: int, rig: Rig) -> tuple[EventStoreReader, TruthReader]:
        """Opens one camera's events and ground truth."""
        seen, path = rig.cameras[camera], self.path / _file(camera, "events")
        events = EventStoreReader(path, seen.width_px, seen.height_px)
        return events, TruthReader(self.path / _file(camera, "truth"))

    def photos(self, camera: int) -> Iterator[Photo]:
        """One camera's pictures that were completed in this checkpoint."""
        path = self.path / _file(camera, "frames")
        return FrameReader(path).photos() if path.exists() else iter(())

    @property
    def has_state(self) -> bool:
        """Whether the simulation can go on behind this checkpoint."""
        return (self.path / _STATE).exists()

    def state(self) -> State:
        """The sensors' state behind the checkpoint."""
        with np.load(self.path / _STATE) as stored:
            return {name: stored[name] for name in stored.files}


class CheckpointWriter:
    """Writes one checkpoint, in a folder that does not count before it is renamed."""

    def __init__(self, path: Path, first_chunk: int, rig: Rig) -> None:
        self.path, self.first_chunk, self.events = path, first_chunk, 0
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
        self._files, self._rig = ExitStack(), rig
        self._frame_writers: dict[int, FrameWriter] = {}
        self._event_writers: list[EventStoreWriter] = []
        self._truth_writers: list[TruthWriter] = []
        for k, camera in enumerate(rig.cameras):
            size_px = camera.width_px, camera.height_px
            events = EventStoreWriter(path / _file(k, "events"), *size_px)
            self._event_writers.append(self._files.enter_context(events))
            truth = TruthWriter(path / _file(k, "truth"), *size_px)
            self._truth_writers.append(self._files.enter_context(truth))

    def append_events(self, camera: int, events: Events, **extra: NDArray[Any]) -> None:
        """Adds events and their optional columns, as `SequenceWriter` does."""
        self._event_writers[camera].append(events, extra)
        self.events += len(events)

    def append_truth(
        self, camera: int, t_us: int, depth_m: NDArray[np.float32], intensity: NDArray[np.uint8],
        optional: dict[str, NDArray[Any]],
    ) -> None:  # fmt: skip
        """Adds ground truth, as `SequenceWriter` does."""
        self._truth_writers[camera].append(t_us, depth_m, intensity, optional)

    def append_photo(self, camera: int, photo: Photo) -> None:
        """Adds a picture; the first one of a camera makes its file."""
        if camera not in self._frame_writers:
            seen = self._rig.cameras[camera]
            path = self.path / _file(camera, "frames")
            file = FrameWriter(path, seen.width_px, seen.height_px)
            self._frame_writers[camera] = self._files.enter_context(file)
        self._frame_writers[camera].append(photo)

    def close(self) -> None:
        """Closes its files."""
        self._files.close()

    def finish(
        self, state: State, end_chunk: int, counts: Sequence[dict[str, int]] = ()
    ) -> Checkpoint:
        """Adds state and hashes, flushes everything to the disk, and makes the checkpoint count."""
        self.close()
        np.savez(self.path / _STATE, **state)  # type: ignore[arg-type,unused-ignore]
        index = {
            "first_chunk": self.first_chunk,
            "end_chunk": end_chunk,
            "events": self.events,
            "counts": list(counts),
            "files": {file.name: hashed(file).sha256 for file in sorted(self.path.iterdir())},
        }
        (self.path / _INDEX).write_text(json.dumps(index, indent=1), encoding="utf-8")
        for file in (*self.path.iterdir(), self.path):
            _sync(file)
        whole = self.path.with_suffix("")
        self.path.rename(whole)
        _sync(whole.parent)
        return Checkpoint(whole, self.first_chunk, end_chunk, self.events, tuple(counts))


def read_checkpoint(path: Path) -> Checkpoint | None:
    """The checkpoint in a folder, or None where anything is missing or changed."""
    try:
        index = _json(path / _INDEX)
        for name, digest in index["files"].items():
            file = path / name
            if not (name == _STATE and not file.exists()) and hashed(file).sha256 != digest:
                return None
        first, end, events = (int(index[name]) for name in ("first_chunk", "end_chunk", "events"))
        return Checkpoint(path, first, end, events, tuple(index["counts"]))
    except (OSError, KeyError, TypeError, ValueError, AttributeError):
        return None


def _json(path: Path) -> Any:
    """A file's content; None where that is no JSON."""
    try:
        return parse_json(read_text(path, TABLE_BYTES))
    except ValueError:
        return None


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _file(camera: int, kind: str) -> str:
    return f"cam{camera}.{kind}.h5"
