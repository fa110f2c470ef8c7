"""Files that are either whole or not there: write beside, flush, rename."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eventsweep.emvs.errors import InputError

_FULL = (errno.ENOSPC, errno.EDQUOT)
_UNITS = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


class DiskFull(InputError):
    """An output that its disk has no room for."""


@contextmanager
def names_full_disk(path: Path) -> Iterator[None]:
    """Says which output a disk had no room for: the system's error names no file at all.

    Args:
        path: of the output, as its user knows it; what is written may lie beside it meanwhile.

    Raises:
        DiskFull: instead of an `OSError` that says so, or of one that names a part of the output.
    """
    try:
        yield
    except (OSError, DiskFull) as error:
        if not (isinstance(error, DiskFull) or _is_full(error)):
            raise
        raise DiskFull(
            f"{path}: no space left on device, {bytes_text(free_bytes(path))} are free: free some "
            "room or choose another output"
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
    """Yields a temporary file beside `path`; renames it to `path` at the end, removes it on error.

    Raises:
        InputError: the folder of `path` cannot be written to, or its disk is full.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a folder, but the output is a file: choose another output")
    with made_parent(path), names_full_disk(path), _partial(path) as partial:
        yield partial
        partial.chmod(0o666 & ~umask())
        flush(partial)
        partial.replace(path)


@contextmanager
def _partial(path: Path) -> Iterator[Path]:
    handle, name = tempfile.mkstemp(
        prefix=f".{path.name}.", suffix=f".partial{path.suffix}", dir=path.parent
    )
    os.close(handle)
    partial = Path(name)
    try:
        yield partial
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def made_parent(path: Path, *, make: bool = True) -> Iterator[None]:
    """Makes the folder of `path`, and those above; on an error those go that nothing is in.

    Args:
        path: of a file or folder that is to be made.
        make: whether to make them now; else others may, and only the end is seen to.

    Raises:
        InputError: the folder cannot be made or written to.
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


def umask() -> int:
    """The process's file mode creation mask."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
