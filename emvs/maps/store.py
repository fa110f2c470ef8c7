"""A map folder that grows window by window, usable at every moment, and resumes after a kill.

`map.json` is there from the first moment, with the windows finished when it was last written. Each
window's folder appears whole, with its entry beside its arrays (`window.json`); what is on disk is
therefore the only memory of a run.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.maps.folder import MapInfo, WindowInfo, read_info
from emvs.utils.files import atomic_dir, atomic_path
from emvs.utils.inputs import TABLE_BYTES, read_text

_INDEX, _ENTRY = "map.json", "window.json"
_ENTRIES = '  "windows": []'
_INDEX_EVERY_S, _INDEX_SHARE = 2.0, 0.05


class MapStore:
    """The folder of one run.

    Attributes:
        path: the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._next_index_s = 0.0

    def begin(self, head: MapInfo, *, anew: bool) -> None:
        """Writes a first `map.json` where there is none, or, `anew`, instead of all there is."""
        if anew:
            _empty(self.path)
        if not (self.path / _INDEX).exists():
            self.write_index(head, ())

    def has(self, name: str) -> bool:
        """Whether a window is finished."""
        return (self.path / name / _ENTRY).is_file()

    @contextmanager
    def window(self, name: str) -> Iterator[Path]:
        """Yields a folder to write a window into; it takes its place when it is whole."""
        with atomic_dir(self.path / name, force=True) as folder:
            yield folder

    def write_index(self, head: MapInfo, names: Iterable[str]) -> None:
        """Writes `map.json` anew from the windows' entries, one at a time.

        Args:
            head: everything but the windows.
            names: the finished windows, in order.
        """
        before, after = _text(head.model_dump(mode="json")).split(_ENTRIES)
        started_s = time.monotonic()
        with atomic_path(self.path / _INDEX) as path, path.open("w", encoding="utf-8") as file:
            file.write(before + '  "windows": [')
            separator = "\n"
            for name in names:
                entry = (self.path / name / _ENTRY).read_text(encoding="utf-8")
                file.write(separator + "    " + entry.rstrip().replace("\n", "\n    "))
                separator = ",\n"
            file.write(("]" if separator == "\n" else "\n  ]") + after)
        now_s = time.monotonic()
        self._next_index_s = now_s + max(_INDEX_EVERY_S, (now_s - started_s) / _INDEX_SHARE)

    def index_is_due(self) -> bool:
        """Whether `map.json` was last written long enough ago: in a long run it is long itself."""
        return time.monotonic() >= self._next_index_s


@contextmanager
def open_store(path: Path, head: MapInfo, *, force: bool = False) -> Iterator[MapStore]:
    """Opens the folder of a run, new or unfinished, for this process alone.

    Args:
        path: the folder.
        head: what the run maps, with what settings; no windows.
        force: whether the folder may hold another run, which `MapStore.begin` then removes.

    Raises:
        InputError: a folder of another run, no map, or one that another process writes.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is a file; choose another output")
    if path.is_dir() and any(path.iterdir()) and not force:
        _check_same(path, read_info(path), head)
    _make(path)
    lock = os.open(path, os.O_RDONLY)
    try:
        _lock(path, lock)
        yield MapStore(path)
    finally:
        os.close(lock)


def identity(recording: Recording) -> str:
    """A hash of a recording's calibration, poses and spans: quick, whatever its length."""
    digest = hashlib.sha256(json.dumps(recording.rig.to_json(), sort_keys=True).encode())
    poses = recording.trajectory
    for column in (poses.t_us, poses.positions_m, poses.quats_xyzw):
        digest.update(column.tobytes())
    spans = [recording.event_span_us(camera) for camera in range(len(recording.rig))]
    count = getattr(recording, "event_count", None)
    counts = [] if count is None else [int(count(camera)) for camera in range(len(recording.rig))]
    digest.update(repr((spans, counts)).encode())
    return digest.hexdigest()


def _check_same(path: Path, found: MapInfo, wanted: MapInfo) -> None:
    """Refuses to go on with other settings; says which one differs first."""
    difference = next(_differences(found, wanted), None)
    if difference is not None:
        raise InputError(
            f"{path}: was begun with {difference}: choose another output, or set "
            "force=True to replace it"
        )


def _differences(found: MapInfo, wanted: MapInfo) -> Iterator[str]:
    name, wanted_name = found.recording.name, wanted.recording.name
    if name != wanted_name:
        yield f"the recording {name}, not {wanted_name}"
    if _hashes(found) != _hashes(wanted):
        yield f"another recording of the name {name}"
    before, now = found.config.model_dump(), wanted.config.model_dump()
    for name, value in now.items():
        # Results do not depend on the number of threads.
        if name != "threads" and before[name] != value:
            yield f"{name} {before[name]}, not {value}"
    for name, version in wanted.versions.items():
        if found.versions.get(name) != version:
            yield f"{name} {found.versions.get(name)}, not {version}"


def _hashes(info: MapInfo) -> tuple[str | None, str | None]:
    return info.recording.manifest_sha256, info.recording_sha256


def write_entry(path: Path, info: WindowInfo) -> None:
    """Writes a window's entry of `map.json` into a folder: the last file of a window."""
    (path / _ENTRY).write_text(_text(info.model_dump(mode="json")), encoding="utf-8")


def read_entry(path: Path) -> WindowInfo:
    """Reads a finished window's entry.

    Raises:
        InputError: a damaged file.
    """
    try:
        return WindowInfo.model_validate_json(read_text(path / _ENTRY, TABLE_BYTES))
    except (OSError, ValueError) as error:
        line = str(error).splitlines()[0]
        raise InputError(f"{path / _ENTRY}: {line}; remove {path} and map again") from error


def _make(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {path}: {error.strerror}") from error
    if not os.access(path, os.W_OK):
        raise InputError(f"cannot write to {path}: no permission, choose another output")


def _lock(path: Path, handle: int) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(
            f"{path}: another process maps into it; wait for it, or stop it"
        ) from error
    except OSError:
        # A file system without locks: nothing tells, and nothing is lost by going on.
        return


def _empty(path: Path) -> None:
    for child in path.iterdir():
        if child.is_dir() and not child.is_symlink():
            shutil.rmtree(child)
        else:
            with suppress(FileNotFoundError):
                child.unlink()


def _text(values: object) -> str:
    return json.dumps(values, indent=2, ensure_ascii=False) + "\n"
