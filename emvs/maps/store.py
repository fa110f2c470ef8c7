"""A map folder that grows window by window, usable at every moment, and resumes after a kill.

`map.json` is there from the first moment, with the windows finished when it was last written. Each
window's folder appears whole, with its entry beside its arrays (`window.json`); what is on disk is
therefore the only memory of a run.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.folder import MapInfo, WindowInfo, read_info, text_of
from eventsweep.emvs.utils.files import made_parent, remove_leftovers
from eventsweep.emvs.utils.inputs import TABLE_BYTES, read_text
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.emvs.utils.outputs import (
    CURE,
    atomic_dir,
    check_output,
    claimed,
    discard,
    files_together,
    real,
    replace_dir,
)

_INDEX, _ENTRY = "map.json", "window.json"
_ENTRIES = '  "windows": []'
_INDEX_EVERY_S, _INDEX_SHARE = 2.0, 0.05


class MapStore:
    """The folder of one run; with `force`, beside the one that it takes the place of in the end."""

    def __init__(self, path: Path, *, anew: bool = False, work: Path | None = None) -> None:
        self.path, self._anew, self._work = path, anew, work
        self._next_index_s = 0.0

    def begin(self, head: MapInfo) -> None:
        """Writes a first `map.json` where there is none, or instead of another, empty run's."""
        if self._anew:
            discard(self.path, self._work)
        if self.path.is_dir():
            remove_leftovers(self.path)
        if not (self.path / _INDEX).exists():
            self.write_index(head, ())

    def has(self, name: str) -> bool:
        """Whether a window is finished."""
        return (self.path / name / _ENTRY).is_file()

    def window(self, name: str) -> AbstractContextManager[Path]:
        """A folder to write a window into; it takes its place when it is whole."""
        return atomic_dir(self.path / name, part_of=self.path)

    def write_index(self, head: MapInfo, names: Iterable[str]) -> None:
        """Writes `map.json` anew: `head`, and the entries of these windows, one at a time."""
        before, after = text_of(head).split(_ENTRIES)
        started_s = time.monotonic()
        with (
            files_together(self.path, [_INDEX]) as staged,
            (staged / _INDEX).open("w", encoding="utf-8") as file,
        ):
            file.write(before + '  "windows": [')
            separator = "\n"
            for name in names:
                entry = (self.path / name / _ENTRY).read_text(encoding="utf-8")
                file.write(separator + "    " + entry.rstrip().replace("\n", "\n    "))
                separator = ",\n"
            file.write(("]" if separator == "\n" else "\n  ]") + after)
        now_s = time.monotonic()
        self._next_index_s = now_s + max(_INDEX_EVERY_S, (now_s - started_s) / _INDEX_SHARE)

    @property
    def index_is_due(self) -> bool:
        """Whether `map.json` was last written long enough ago: in a long run it is long itself."""
        return time.monotonic() >= self._next_index_s


@contextmanager
def open_store(
    path: Path, head: MapInfo, *, force: bool = False, inputs: Iterable[object] = ()
) -> Iterator[MapStore]:
    """Opens the folder of a run, new or unfinished, for this process alone; it makes nothing yet.

    Args:
        path: the folder.
        head: what the run maps, with what settings; no windows.
        force: whether the folder may hold another run. The new one then grows in `.NAME.next`
            beside it, is taken up from there, and takes its place when the context ends well.
        inputs: what is mapped, and settings that name files: they are never removed.
    """
    path = Path(path)
    place = real(path)
    if place.exists() and not (place.is_dir() or force):
        raise InputError(f"{path}: is a file; choose another output")
    with claimed(path) as work:
        if not place.exists() or (place.is_dir() and not any(place.iterdir())):
            with made_parent(place / _INDEX, make=False):
                yield MapStore(place)
        elif force and work is not None:
            check_output(path, force=True)
            following = place.with_name(f".{place.name}.next")
            store = MapStore(following, anew=_is_to_be_begun(following, head))
            try:
                yield store
            except BaseException:
                if following.is_dir() and not any(following.glob(f"*/{_ENTRY}")):
                    discard(following)
                raise
            replace_dir(following, path, work, inputs=inputs)
        else:
            yield MapStore(place, anew=_check_same(path, read_info(place), head), work=work)


def _is_to_be_begun(path: Path, head: MapInfo) -> bool:
    """Whether what is left of a run that was to replace another is no beginning of this one."""
    if not os.path.lexists(path):
        return False
    try:
        if path.is_symlink() or strangers(path):
            return True
        return next(_differences(read_info(path), head), None) is not None
    except InputError:
        return True


def _check_same(path: Path, stored: MapInfo, asked: MapInfo) -> bool:
    """Refuses to go on with other settings; says which one differs first.

    Returns:
        Whether it is to be begun anew: of another run, in which no window was ever finished.
    """
    difference = next(_differences(stored, asked), None)
    if difference is None:
        return False
    if not stored.windows and not any(path.glob(f"*/{_ENTRY}")) and not strangers(path):
        return True
    raise InputError(f"{path}: was begun with {difference}: {CURE}")


def _differences(stored: MapInfo, asked: MapInfo) -> Iterator[str]:
    old, new = stored.recording, asked.recording
    if old.name != new.name:
        yield f"the recording {old.name}, not {new.name}"
    hashes = old.manifest_sha256, stored.recording_sha256
    if hashes != (new.manifest_sha256, asked.recording_sha256):
        yield f"another recording of the name {old.name}"
    before, now = stored.config.model_dump(), asked.config.model_dump()
    for name, value in now.items():
        # Results do not depend on the number of threads.
        if name != "threads" and before[name] != value:
            yield f"{name} {before[name]}, not {value}"
    for name, version in asked.versions.items():
        if stored.versions.get(name) != version:
            yield f"{name} {stored.versions.get(name)}, not {version}"


def write_entry(path: Path, info: WindowInfo) -> None:
    """Writes a window's entry of `map.json` into a folder: the last file of a window."""
    (path / _ENTRY).write_text(text_of(info), encoding="utf-8")


def read_entry(path: Path) -> WindowInfo:
    """Reads a finished window's entry."""
    try:
        return WindowInfo.model_validate_json(read_text(path / _ENTRY, TABLE_BYTES))
    except (OSError, ValueError) as error:
        line = str(error).splitlines()[0]
        raise InputError(f"{path / _ENTRY}: {line}; remove {path} and map again") from error
