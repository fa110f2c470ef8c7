"""Files that are either complete or absent: made in a hidden folder beside, flushed, renamed.

A hidden work folder is ours because of the mark in it, which is there before anything else, and in
use as long as a process holds its lock. One that nobody holds was left by a killed process: the
next one that writes the same output removes it.
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eventsweep.emvs.errors import InputError

MARK = ".eventsweep-work"
"""An empty file in every hidden work folder; its creation is atomic."""
REPLACED = "replaced"
"""What lies in a work folder until the output that takes its place is there; removed last."""
_FULL = (errno.ENOSPC, errno.EDQUOT)
_UNITS = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


class DiskFull(InputError):
    """An output that its disk has no room for."""


@contextmanager
def names_full_disk(path: Path) -> Iterator[None]:
    """Says which output a disk had no room for: the system's error names no file at all.

    What is written may lie beside `path` meanwhile.

    Raises:
        DiskFull: instead of an `OSError` that says so, or of one that names a part of the output.
    """
    try:
        yield
    except (OSError, DiskFull) as error:
        if not (isinstance(error, DiskFull) or _is_full(error)):
            raise
        raise DiskFull(
            f"{path}: no space left on device, {bytes_text(free_bytes(path))} are free: free "
            "some space or choose another output"
        ) from error


def _is_full(error: OSError) -> bool:
    # HDF5 keeps the number to itself.
    return error.errno in _FULL or os.strerror(errno.ENOSPC) in str(error)


def free_bytes(path: Path) -> int:
    """How much a user may still write to the disk that holds a path, or that will."""
    there = next(place for place in (path, *Path(path).absolute().parents) if place.exists())
    return shutil.disk_usage(there).free


def bytes_text(count: float) -> str:
    """A size in the unit that suits it, to three digits: 512 bytes, 3.2 MB, 1.05 GB."""
    power = 0
    while abs(count) >= 999.5 and power < len(_UNITS) - 1:
        count, power = count / 1000, power + 1
    return f"{count:.3g} {_UNITS[power]}"


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yields a file of the same name in a hidden folder; renames it to `path` at the end.

    Raises:
        InputError: `path` is no plain file, its folder cannot be written to, or its disk is full.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        what = "a folder" if path.is_dir() else "a pipe, device or socket"
        raise InputError(f"{path} is {what}, but the output is a file: choose another output")
    with made_parent(path), names_full_disk(path), work_folder(path) as work:
        yield work / path.name
        flush(work / path.name)
        (work / path.name).replace(path)


def write_text(path: Path, text: str) -> None:
    """Writes a text file as `atomic_path` does."""
    with atomic_path(path) as partial:
        partial.write_text(text, encoding="utf-8")


@contextmanager
def work_folder(place: Path, *, resume: bool = False) -> Iterator[Path]:
    """Makes a hidden folder beside a place, for this process alone; removes it at the end.

    What killed processes left of the same place is removed first; with `resume` their folder is
    yielded instead, if there is one, and is kept after an error.
    """
    if not os.access(place.parent, os.W_OK):
        raise InputError(f"cannot write to {place.parent}: no permission, choose another output")
    own = f".{place.name}."
    left = next(leftovers(place.parent, own), None) if resume else None
    if not resume:
        remove_leftovers(place.parent, own)
    work, lock = left or _new_work_folder(place)
    try:
        yield work
    except BaseException:
        if not resume or [path.name for path in work.iterdir()] == [MARK]:
            remove_work(work)
        raise
    else:
        remove_work(work)
    finally:
        os.close(lock)


def leftovers(folder: Path, start: str = ".") -> Iterator[tuple[Path, int]]:
    """Work folders that killed processes left in a folder, locked; the caller closes the lock.

    Names of one output's begin with `.NAME.`.
    """
    for work in list(folder.iterdir()):
        is_named = work.name.startswith(start) and work.name.endswith(".partial")
        if is_named and is_work_folder(work):
            with suppress(OSError):
                lock = os.open(work, os.O_RDONLY | os.O_NOFOLLOW)
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError:
                    os.close(lock)
                else:
                    yield work, lock


def remove_leftovers(folder: Path, start: str = ".") -> None:
    """Removes what killed processes left in a folder; arguments as `leftovers`."""
    for work, lock in leftovers(folder, start):
        remove_work(work)
        os.close(lock)


def is_work_folder(path: Path) -> bool:
    """Whether a folder carries our mark; an empty one may be about to, and holds nothing."""
    with suppress(OSError):
        if not path.is_symlink() and path.is_dir():
            return (path / MARK).is_file() or not any(path.iterdir())
    return False


def remove_work(work: Path) -> None:
    """Removes a work folder, its mark last; not one that holds what a kill kept from its place."""
    with suppress(OSError):
        for path in [path for path in work.iterdir() if path.name not in (MARK, REPLACED)]:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()
        if not os.path.lexists(work / REPLACED):
            (work / MARK).unlink(missing_ok=True)
            work.rmdir()


def _new_work_folder(place: Path) -> tuple[Path, int]:
    while True:
        name = tempfile.mkdtemp(prefix=f".{place.name}.", suffix=".partial", dir=place.parent)
        # Another process may take it for a leftover before it is locked and marked.
        with suppress(FileNotFoundError):
            lock = os.open(name, os.O_RDONLY)
            with suppress(OSError):
                # Where the file system has no locks, nothing is ever taken for a leftover either.
                fcntl.flock(lock, fcntl.LOCK_EX)
            try:
                os.close(os.open(Path(name, MARK), os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            except FileNotFoundError:
                os.close(lock)
                raise
            return Path(name), lock


def link_new(made: Path, place: Path) -> None:
    """Gives a file its name, which must be free."""
    try:
        os.link(made, place)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if os.path.lexists(place):
            raise FileExistsError(str(place)) from None
        made.rename(place)
    else:
        made.unlink()


@contextmanager
def made_parent(path: Path, *, make: bool = True) -> Iterator[None]:
    """Makes the folder of `path`, and those above; on an error those go that nothing is in.

    Unless `make`, others may make them, and only the end is seen to.
    """
    missing = [folder for folder in path.parents if not os.path.lexists(folder)]
    try:
        if make:
            _make_parent(path)
        yield
    except BaseException:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()
        raise


def _make_parent(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {path.parent}: {error.strerror}") from error
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"cannot write to {path.parent}: no permission, choose another output")


def flush(path: Path) -> None:
    """Asks the system to put a file's bytes on the disk before its name changes."""
    if path.is_file():
        with path.open("rb") as file:
            try:
                os.fsync(file.fileno())
            except OSError as error:
                if _is_full(error):
                    raise


def link_tree(source: Path, target: Path) -> None:
    """Makes a copy of a folder that shares its files' bytes where the file system can do that."""
    shutil.copytree(source, target, copy_function=_link)


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        shutil.copy2(source, target)
