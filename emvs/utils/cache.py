"""A content-addressed store of what was made before: whole, verified by hash, shared by processes.

An entry is a folder named by its key, which says everything that decides its content. It appears
complete or not at all, and is read only after its hashes agreed.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.outputs import atomic_dir

_FORMAT = 1
_ENTRY, _DATA, _LOCKS = "entry.json", "data", "locks"

Fill = Callable[[Path], None]
"""Writes an entry's files into the empty folder that it is given."""


@dataclass(frozen=True)
class CacheEntry:
    """What was made.

    Attributes:
        key: name of the entry.
        path: folder of its files.
        digest: hash over all of them: equal where the data are equal.
        seconds: what making it took, s.
        found: whether it was there already.
        files: names of its files below `path`; one that is gone was deleted by someone since.
        cpu_seconds: time of processors that making it took, s; 0 where it is not known.
    """

    key: str
    path: Path
    digest: str
    seconds: float
    found: bool
    files: tuple[str, ...]
    cpu_seconds: float = 0.0


def default_cache() -> Path:
    """`$EVENTSWEEP_CACHE`, or `eventsweep` in the user's cache folder (XDG)."""
    chosen = os.environ.get("EVENTSWEEP_CACHE")
    home = os.environ.get("XDG_CACHE_HOME")
    if chosen:
        return Path(chosen)
    return (Path(home) if home else Path.home() / ".cache") / "eventsweep"


def key_of(facts: Any) -> str:
    """The name of whatever these facts (plain JSON values) decide."""
    text = json.dumps([_FORMAT, facts], sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


class Cache:
    """A folder of entries; any number of processes may use it at once.

    Args:
        folder: made when first written to.

    Raises:
        InputError: the folder cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder).absolute()
        try:
            (self.folder / _LOCKS).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cache {folder}: cannot be made ({error.strerror}): choose another"
            ) from error

    def get(self, key: str, facts: Any, fill: Fill) -> CacheEntry:
        """The entry called `key`, filled now if it is not there or damaged.

        Two processes that want the same entry do the work once: the second waits for the first.

        Args:
            key: `key_of(facts)`.
            facts: what decides the entry, kept beside it for people to read.
            fill: makes the entry's files; what it raises passes through, and nothing stays behind.
        """
        with self._locked(key):
            found = self._read(key)
            if found is not None:
                return found
            self._clear(key)
            return self._make(key, facts, fill)

    def find(self, key: str) -> CacheEntry | None:
        """The entry called `key`, if it is there and whole."""
        return self._read(key)

    def path_of(self, key: str) -> Path:
        """Where an entry lies or would lie."""
        return self.folder / key[:2] / key

    def size_bytes(self) -> int:
        """Bytes of all entries."""
        return sum(self._bytes(path) for path in self._entries())

    def prune(self, keep_bytes: int) -> int:
        """Removes the entries that were not used for longest until `keep_bytes` are left.

        Returns:
            The bytes that were freed.
        """
        oldest_first = sorted(self._entries(), key=lambda path: (path / _ENTRY).stat().st_mtime)
        sizes = {path: self._bytes(path) for path in oldest_first}
        left, freed = sum(sizes.values()), 0
        for path in oldest_first:
            if left - freed <= keep_bytes:
                break
            with self._locked(path.name):
                self._clear(path.name)
            freed += sizes[path]
        return freed

    def _make(self, key: str, facts: Any, fill: Fill) -> CacheEntry:
        started_s, started_cpu_s = time.monotonic(), time.process_time()
        with atomic_dir(self.path_of(key)) as folder:
            data = folder / _DATA
            data.mkdir()
            fill(data)
            files = _files(data)
            # Beside the clock's time, that of processors: others at work hardly change it.
            took = {
                "seconds": round(time.monotonic() - started_s, 3),
                "cpu_seconds": round(time.process_time() - started_cpu_s, 3),
            }
            content = {"facts": facts, "files": files, **took}
            (folder / _ENTRY).write_text(json.dumps(content, indent=1), encoding="utf-8")
        return self._entry(key, files, found=False, **took)

    def _read(self, key: str) -> CacheEntry | None:
        """The entry, if it is there and whole; a damaged one is as good as none."""
        path = self.path_of(key)
        try:
            content = json.loads((path / _ENTRY).read_text(encoding="utf-8"))
            files = content["files"]
            there = _files(path / _DATA)
            took = {name: float(content.get(name, 0.0)) for name in ("seconds", "cpu_seconds")}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        if there != files:
            return None
        with suppress(OSError):
            os.utime(path / _ENTRY)  # for `prune`: when it was last of use
        return self._entry(key, files, found=True, **took)

    def _entry(self, key: str, files: dict[str, Any], **rest: Any) -> CacheEntry:
        path = self.path_of(key) / _DATA
        return CacheEntry(key, path, _digest(files), files=tuple(files), **rest)

    def _clear(self, key: str) -> None:
        """Removes a damaged entry, and what a killed process left of it; under the lock."""
        path = self.path_of(key)
        for remains in (path, *path.parent.glob(f".{key}.*")):
            shutil.rmtree(remains, ignore_errors=True)

    def _entries(self) -> Iterator[Path]:
        for entry in self.folder.glob(f"??/*/{_ENTRY}"):
            yield entry.parent

    @staticmethod
    def _bytes(path: Path) -> int:
        return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())

    @contextmanager
    def _locked(self, key: str) -> Iterator[None]:
        """One process at a time; the system lets go of a lock whose holder was killed."""
        with (self.folder / _LOCKS / key).open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield


def _files(data: Path) -> dict[str, dict[str, Any]]:
    """Size and hash of every file."""
    found = {}
    for path in sorted(path for path in data.rglob("*") if path.is_file()):
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        name = path.relative_to(data).as_posix()
        found[name] = {"sha256": sha256, "bytes": path.stat().st_size}
    return found


def _digest(files: dict[str, Any]) -> str:
    lines = "".join(f"{name} {entry['sha256']}\n" for name, entry in sorted(files.items()))
    return hashlib.sha256(lines.encode()).hexdigest()
