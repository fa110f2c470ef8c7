"""Files and folders that are either whole or not there: write beside, flush, rename."""

from __future__ import annotations

import os
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

    An existing folder is replaced only with `force`, and only at the end.

    Raises:
        InputError: `path` exists and `force` is not set, or its folder cannot be written to.
    """
    path = Path(path)
    refuse_existing(path, force=force)
    _make_parent(path)
    partial = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent))
    try:
        yield partial
        partial.chmod(0o777 & ~_umask())
        for file in partial.rglob("*"):
            _flush(file)
        _swap(partial, path)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def refuse_existing(path: Path, *, force: bool) -> None:
    """Refuses an output that exists, unless `force` says to replace it.

    Raises:
        InputError: `path` exists and `force` is not set.
    """
    if path.exists() and not force:
        raise InputError(f"{path} exists: choose another output, or add --force to replace it")


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
