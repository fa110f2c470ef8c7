"""Files that are either whole or not there: write beside, flush, rename."""

from __future__ import annotations

import os
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
    if path.is_dir():
        raise InputError(f"{path} is a folder, a file is to be written: choose another output")
    with made_parent(path), _partial(path) as partial:
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
        with path.open("rb") as file, suppress(OSError):
            os.fsync(file.fileno())


def umask() -> int:
    """The process's file mode creation mask."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
