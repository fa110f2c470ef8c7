"""A content-addressed store of what was made before: whole, verified by hash, shared by processes.

An entry is a folder named by its key, a hash over everything that decides its content. It appears
complete or not at all, and is read only after its hashes agreed. Its `entry.json` holds the facts
that the key is made of: a folder whose name they do not give is somebody else's.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import default_cache as default_cache
from eventsweep.emvs.utils.files import move_aside
from eventsweep.emvs.utils.inputs import TABLE_BYTES, inside, parse_json, read_text
from eventsweep.emvs.utils.output_manifest import digest_of, files_below
from eventsweep.emvs.utils.outputs import atomic_dir, check_parent, claimed

_FORMAT = 1
_ENTRY, _DATA = "entry.json", "data"

Fill = Callable[[Path], None]
"""Writes an entry's files, at least one, into the empty folder that it is given."""


@dataclass(frozen=True)
class CacheEntry:
    """What was made.

    Attributes:
        key: name of the entry.
        path: folder of its files.
        digest: hash over all of them: equal where the data are equal.
        seconds: what making it took, s; `cpu_seconds` of processors, 0 where it is not known.
        found: whether it was there already.
        files: names of its files below `path`; one that is gone was deleted by someone since.
    """

    key: str
    path: Path
    digest: str
    seconds: float
    found: bool
    files: tuple[str, ...]
    cpu_seconds: float = 0.0


def key_of(facts: Any) -> str:
    """The name of whatever these facts (plain JSON values) decide."""
    text = json.dumps([_FORMAT, facts], sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


class Cache:
    """A folder of entries; any number of processes may use it at once.

    Args:
        folder: made when first written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder).absolute()
        self._whole: dict[str, tuple[list[Any], CacheEntry]] = {}
        if not self.folder.is_dir():
            check_parent(self.folder / "entry")

    def get(self, key: str, facts: Any, fill: Fill) -> CacheEntry:
        """The entry called `key`, filled now if it is not there or damaged.

        Two processes that want the same entry do the work once: the second waits for the first.

        Args:
            key: `key_of(facts)`.
            facts: everything that decides the entry, kept beside it.
            fill: makes the entry's files; what it raises passes through, and nothing stays behind.
        """
        path = self.path_of(key)
        with claimed(path, wait=True) as work:
            entry = self._read(key)
            if entry is not None:
                return entry
            with suppress(OSError, ValueError, AttributeError):
                _remove(path)
            if os.path.lexists(path):  # what is not ours, or not known
                move_aside(path, path, "is a damaged entry of the cache")
            return self._make(key, facts, fill, work)

    def find(self, key: str) -> CacheEntry | None:
        """The entry called `key`, if it is there and whole."""
        return self._read(key)

    def path_of(self, key: str) -> Path:
        """Where an entry lies or would lie."""
        return self.folder / key[:2] / key

    def size_bytes(self) -> int:
        """Bytes of all entries."""
        return sum(map(_bytes, self._entries()))

    def prune(self, keep_bytes: int) -> int:
        """Removes the entries that were not used for longest until `keep_bytes` are left.

        Returns:
            The bytes that were freed.
        """
        oldest_first = sorted(self._entries(), key=lambda path: (path / _ENTRY).stat().st_mtime)
        sizes = {path: _bytes(path) for path in oldest_first}
        left, freed = sum(sizes.values()), 0
        for path in oldest_first:
            if left - freed <= keep_bytes:
                break
            with claimed(path, wait=True):
                _remove(path)
            freed += sizes[path]
        return freed

    def _make(self, key: str, facts: Any, fill: Fill, work: Path | None) -> CacheEntry:
        started_s, started_cpu_s = time.monotonic(), time.process_time()
        with atomic_dir(self.path_of(key), work=work, manifest=False) as folder:
            data = folder / _DATA
            data.mkdir()
            fill(data)
            files = _files(data)
            if not files:
                raise FileNotFoundError(f"{data}: what was written there is gone")
            # Beside the clock's time, that of processors: others at work hardly change it.
            took = {
                "seconds": round(time.monotonic() - started_s, 3),
                "cpu_seconds": round(time.process_time() - started_cpu_s, 3),
            }
            content = {"facts": facts, "files": files, **took}
            (folder / _ENTRY).write_text(json.dumps(content, indent=1), encoding="utf-8")
        made = self._entry(key, files, found=False, **took)
        self._whole[key] = _state(self.path_of(key)), replace(made, found=True)
        return made

    def _read(self, key: str) -> CacheEntry | None:
        """The entry, if it is there and whole; a damaged one is as good as none.

        Its hashes are compared once in a process, and again if a file's size or time changed.
        """
        path, known = self.path_of(key), self._whole.get(key)
        same = known is not None and known[0] == _state(path)
        entry = known[1] if known is not None and same else self._verified(key)
        if entry is None:
            self._whole.pop(key, None)
            return None
        with suppress(OSError):
            os.utime(path / _ENTRY)  # for `prune`: when it was last of use
        self._whole[key] = _state(path), entry
        return entry

    def _verified(self, key: str) -> CacheEntry | None:
        path = self.path_of(key)
        try:
            content = _stored(path)
            files = content["files"]
            there = _files(path / _DATA)
            took = {name: float(content.get(name, 0.0)) for name in ("seconds", "cpu_seconds")}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
            return None
        if there != files:
            return None
        return self._entry(key, files, found=True, **took)

    def _entry(self, key: str, files: dict[str, Any], **rest: Any) -> CacheEntry:
        path = self.path_of(key) / _DATA
        return CacheEntry(key, path, _digest(files), files=tuple(files), **rest)

    def _entries(self) -> Iterator[Path]:
        for index in self.folder.glob(f"??/*/{_ENTRY}"):
            with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
                if key_of(_stored(index.parent)["facts"]) == index.parent.name:
                    yield index.parent


def _state(entry: Path) -> list[Any]:
    """What changes with any file of an entry."""
    with suppress(OSError):
        files = [entry / _ENTRY, *sorted((entry / _DATA).rglob("*"))]
        return [(path, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    return []


def _stored(entry: Path) -> Any:
    return parse_json(read_text(inside(entry, _ENTRY), TABLE_BYTES))


def _bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def _remove(path: Path) -> None:
    """Removes an entry's files, its index last, and no other."""
    names = _stored(path).get("files")
    for name in names if isinstance(names, dict) else ():
        with suppress(OSError, InputError):  # not a file of the entry
            inside(path / _DATA, name).unlink()
    (path / _ENTRY).unlink(missing_ok=True)
    for parent, _, _ in os.walk(path, topdown=False):
        with suppress(OSError):  # somebody's file is in it
            Path(parent).rmdir()


def _files(data: Path) -> dict[str, dict[str, Any]]:
    return {name: facts._asdict() for name, facts in files_below(data).items()}


def _digest(files: dict[str, Any]) -> str:
    return digest_of({name: entry["sha256"] for name, entry in files.items()})
