"""Where compiled kernels are kept: a folder for each version of all the code they are made from.

Numba asks only whether a kernel's own file changed. A kernel holds the machine code of what it
calls in other files, too, and the values of their constants; after an edit there it would go on as
before. So the folder is named by a hash over every file with compiled functions.

Every file in it begins with a hash over the rest: one that is damaged is compiled anew, and one
without it was not written here. Of processes that need a kernel at the same time one compiles it,
and the others wait.
"""

from __future__ import annotations

import fcntl
import hashlib
import io
import os
import pickle
import platform
import re
import struct
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import llvmlite
import numba
from numba.core import caching

from eventsweep.emvs.errors import InputError

_ROOT = Path(__file__).parents[2]
_PACKAGES = ("emvs", "sim", "eval", "plugins")
_NO_CODE = {"__pycache__", "tests"}
_GPU = b"from numba import cuda"
_VERSION = re.compile(r"eventsweep-[0-9a-f]{16}")
_MARK = "last-used"
_HEAD = b"eventsweep kernel 1\n"
_HASH_BYTES = 32
_KEEP = 8  # a version takes 10 MB
_BUSY_S, _OLD_S = 86_400, 30 * 86_400
_PATIENCE_S = 20.0  # with a process that is stopped
_STOPPED = "Tt"  # by a signal, by a debugger
_FLOCK = "hhqqi"  # the system's structure: type, whence, start, length, process


def use_kernel_cache() -> Path:
    """Tells numba where kernels lie; to be called before the first of them is decorated.

    It is a folder below `NUMBA_CACHE_DIR`, or the user's cache folder, or, where that cannot be
    written to, one of the user's own among the temporary files.
    """
    name = f"eventsweep-{kernel_version()}"
    chosen = Path(numba.config.CACHE_DIR) if numba.config.CACHE_DIR else None  # type: ignore[attr-defined]
    for home in _homes(chosen):
        folder = home / name
        is_new = not folder.exists()
        if _claim(folder, trusted=home == chosen):
            setattr(caching, "IndexDataCacheFile", VerifiedKernels)  # noqa: B010 (a type to mypy)
            numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
            if is_new:
                _remove_old(home, folder)
            return folder
    raise InputError("no writable folder for compiled kernels: set NUMBA_CACHE_DIR to one")


def has_kernel(name: str) -> bool:
    """Whether a function, `module.function` with its folder left out, was ever compiled here."""
    folder = Path(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
    return any(folder.glob(f"*/{name}-*.nbi"))


def kernel_version() -> str:
    """16 hexadecimal digits over the files of compiled functions and over who compiles them."""
    parts = [repr(_HEAD), platform.python_implementation(), platform.python_version()]
    # Numba's own name of a kernel does not say whether its indices are checked.
    checked: Any = numba.config.BOUNDSCHECK  # type: ignore[attr-defined]
    parts += [numba.__version__, llvmlite.__version__, f"bounds checked: {checked}"]
    parts += digests(kernel_files(), _ROOT)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def digests(paths: Iterable[Path], root: Path) -> list[str]:
    """One line for each file, sorted: its path below `root`, and the sha256 of its bytes."""
    return sorted(
        f"{path.relative_to(root).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        for path in paths
    )


def kernel_files() -> list[Path]:
    """Every file with compiled functions, or with what they take from elsewhere.

    Kernels of a GPU call what depends on the device: all files beside them count.
    """
    files = []
    for package in _PACKAGES:
        for folder, inner, names in os.walk(_ROOT / package):
            inner[:] = [name for name in inner if name.isidentifier() and name not in _NO_CODE]
            kernels = [Path(folder, name) for name in names if name.endswith("_kernels.py")]
            whole = any(_GPU in path.read_bytes() for path in kernels)
            files += sorted(Path(folder).glob("*.py")) if whole else kernels
    return sorted(files)


def _homes(chosen: Path | None) -> Iterator[Path]:
    if chosen is not None:
        yield chosen
    with suppress(RuntimeError):  # nobody's home
        xdg = os.environ.get("XDG_CACHE_HOME")
        yield (Path(xdg) if xdg else Path.home() / ".cache") / "eventsweep-kernels"
    with suppress(OSError):  # no temporary files either
        yield Path(tempfile.gettempdir()) / f"eventsweep-kernels-{os.getuid()}"


def _claim(folder: Path, *, trusted: bool) -> bool:
    """Makes the folder and says that it is in use; False where that does not work.

    Compiled code is run as it is found: from a folder that nobody else could have filled, unless
    the user chose it.
    """
    try:
        for each in (folder.parent, folder):
            each.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not trusted and not _is_private(each):
                return False
        (folder / _MARK).touch()
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_private(folder: Path) -> bool:
    seen = folder.lstat()
    return seen.st_uid == os.getuid() and not folder.is_symlink() and not seen.st_mode & 0o022


def _remove_old(home: Path, present: Path) -> None:
    """Removes versions that nobody has used for a month, and of the others all but a few.

    What was used within a day stays: a process may be writing there.
    """
    ages = sorted((age, path) for path, age in _versions(home) if path != present)
    for place, (age_s, path) in enumerate(ages, start=1):
        if age_s > _OLD_S or (place >= _KEEP and age_s > _BUSY_S):
            _remove(path)


def _versions(home: Path) -> Iterator[tuple[Path, float]]:
    """Folders of versions; seconds since use."""
    now = time.time()
    for path in home.iterdir():
        if _VERSION.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
            with suppress(OSError):  # not marked: not ours, or being removed by someone else
                yield path, now - (path / _MARK).stat().st_mtime


def _remove(path: Path) -> None:
    """Removes the kernels in a folder, its mark last, and no other file."""
    for file in path.glob("*/*"):
        if _is_kernel(file):
            file.unlink(missing_ok=True)
    for folder in [child for child in path.iterdir() if child.is_dir() and not child.is_symlink()]:
        with suppress(OSError):
            folder.rmdir()
    with suppress(OSError):
        if [child.name for child in path.iterdir()] == [_MARK]:
            (path / _MARK).unlink()
            path.rmdir()


def _is_kernel(file: Path) -> bool:
    if file.is_symlink() or not file.is_file():
        return False
    with file.open("rb") as stream:
        return stream.read(len(_HEAD)) == _HEAD


def give_up(dispatcher: Any) -> None:
    """Lets other processes compile a function that failed here, or was interrupted."""
    kept = getattr(dispatcher, "_cache", None)  # none where it is not cached
    if isinstance(file := getattr(kept, "_cache_file", None), VerifiedKernels):
        file.unlock()


class VerifiedKernels(caching.IndexDataCacheFile):
    """Numba's files of one function, each with a hash; a damaged one is as good as none."""

    def load(self, key: Any) -> Any:
        """What was compiled; None makes it this process's turn to compile, until it saves."""
        found = super().load(key)
        if found is None:
            self._wait()
            found = super().load(key)
            if found is not None:
                self.unlock()
        return found

    def save(self, key: Any, data: Any) -> None:
        """Keeps what was compiled, and lets other processes have it."""
        try:
            super().save(key, data)
        finally:
            self.unlock()

    def unlock(self) -> None:
        """Lets another process have its turn."""
        self._lock(fcntl.LOCK_UN)

    def _wait(self) -> None:
        """Waits while another process compiles this function, however long that takes.

        Not for one that is stopped, or cannot be seen, all the time of our patience. Whether it
        gets time of a processor says nothing: on a busy machine it may get none for long, and it
        may wait for what a third process compiles.
        """
        seen_s = time.monotonic()
        while not self._lock(fcntl.LOCK_EX | fcntl.LOCK_NB):
            if self._is_compiling():
                seen_s = time.monotonic()
            elif time.monotonic() - seen_s >= _PATIENCE_S:
                return
            time.sleep(0.05)

    def _is_compiling(self) -> bool:
        """Whether the process that has this function's lock is seen, and not stopped."""
        try:
            asked = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, self._byte(), 1, 0)
            found = fcntl.fcntl(self._mark(), fcntl.F_GETLK, asked)
            holder = struct.unpack(_FLOCK, found)[-1]
            state = Path(f"/proc/{holder}/stat").read_text("utf-8").rpartition(")")[2].split()[0]
        except OSError:  # it has ended, or runs on another machine
            return False
        return state not in _STOPPED

    def _byte(self) -> int:
        return int.from_bytes(hashlib.sha256(self._index_path.encode()).digest()[:7], "big")

    def _mark(self) -> int:
        return _opened(Path(self._cache_path).parent / _MARK)

    def _lock(self, kind: int) -> bool:
        """Locks a byte of the folder's mark, which stands for this function; or unlocks it."""
        try:
            fcntl.lockf(self._mark(), kind, 1, self._byte())
        except BlockingIOError:
            return False
        except OSError:  # no locks on this disk: each process compiles for itself
            pass
        return True

    def _load_index(self) -> dict[Any, Any]:
        content = _verified(Path(self._index_path))
        if content is None:
            return {}
        version, (stamp, overloads) = pickle.loads(content)
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, Any]) -> None:
        content = pickle.dumps((self._version, (self._source_stamp, overloads)), protocol=-1)
        with self._open_for_write(self._index_path) as file:
            file.write(content)

    def _load_data(self, name: str) -> Any:
        content = _verified(Path(self._cache_path, name))
        return None if content is None else pickle.loads(content)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BinaryIO]:
        content = io.BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(_HEAD + hashlib.sha256(content.getvalue()).digest())
            file.write(content.getvalue())


def _verified(path: Path) -> bytes | None:
    """What a file holds behind its hash; None where that does not agree, or nothing is there."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    start = len(_HEAD) + _HASH_BYTES
    body = content[start:]
    return body if content[:start] == _HEAD + hashlib.sha256(body).digest() else None


@cache
def _opened(mark: Path) -> int:
    """A descriptor that stays open: closing one would undo the process's locks on its file."""
    return os.open(mark, os.O_RDWR | os.O_CLOEXEC)
