"""Files and folders that are either whole or not there: write beside, flush, rename."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from emvs.errors import InputError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yields a temporary file beside `path`; renames it to `path` at the end, removes it on error.

    Raises:
        InputError: the folder of `path` cannot be written to.
    """
    path = Path(path)
    _make_parent(path)
    handle, name = tempfile.mkstemp(
        prefix=f".{path.name}.", suffix=f".partial{path.suffix}", dir=path.parent
    )
    os.close(handle)
    partial = Path(name)
    try:
        yield partial
        partial.chmod(0o666 & ~_umask())
        _flush(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def atomic_dir(path: Path, *, force: bool = False) -> Iterator[Path]:
    """Yields an empty folder beside `path`; renames it to `path` at the end, removes it on error.

    An existing folder is replaced only with `force`, and only at the end. What a killed process
    left beside `path` is removed first.

    Raises:
        InputError: `path` exists and `force` is not set, or its folder cannot be written to.
    """
    path = Path(path)
    refuse_existing(path, force=force)
    _make_parent(path)
    _remove_abandoned(path)
    partial, lock = _locked_folder(path)
    try:
        yield partial
        partial.chmod(0o777 & ~_umask())
        for file in partial.rglob("*"):
            _flush(file)
        _swap(partial, path)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        os.close(lock)


def _locked_folder(path: Path) -> tuple[Path, int]:
    """A new folder beside `path`, and a lock on it that lasts as long as this process lives."""
    while True:
        name = tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent)
        try:
            lock = os.open(name, os.O_RDONLY)
        except FileNotFoundError:
            continue
        with suppress(OSError):
            # Where the file system has no locks, nothing is ever taken for abandoned either.
            fcntl.flock(lock, fcntl.LOCK_EX)
        # Another process may have taken it for abandoned before it was locked.
        if Path(name).exists():
            return Path(name), lock
        os.close(lock)


def _remove_abandoned(path: Path) -> None:
    """Removes what killed processes left of the same target: folders that nobody holds locked."""
    left = re.compile(rf"\.{re.escape(path.name)}\.\w{{8}}\.partial")
    for folder in path.parent.iterdir():
        if not left.fullmatch(folder.name) or not folder.is_dir():
            continue
        with suppress(OSError):
            lock = os.open(folder, os.O_RDONLY)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(lock)


def refuse_existing(path: Path, *, force: bool) -> None:
    """Refuses an output that exists, unless `force` says to replace it.

    Raises:
        InputError: `path` exists and `force` is not set.
    """
    if path.exists() and not force:
        raise InputError(f"{path} exists: choose another output, or set force=True to replace it")


def _swap(partial: Path, path: Path) -> None:
    """Puts `partial` in the place of `path`; what was there is deleted only when that is done."""
    if not path.exists():
        partial.rename(path)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".old", dir=path.parent))
    path.rename(old / "replaced")
    try:
        partial.rename(path)
    except OSError:
        (old / "replaced").rename(path)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


def _make_parent(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {path.parent}: {error.strerror}") from error
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"cannot write to {path.parent}: no permission, choose another output")


def _flush(path: Path) -> None:
    """Asks the system to put a file's bytes on the disk before its name changes."""
    if path.is_file():
        with path.open("rb") as file, suppress(OSError):
            os.fsync(file.fileno())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
