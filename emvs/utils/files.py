"""Files that are either complete or absent: made in a hidden folder beside, flushed, renamed.

The hidden folder `.NAME.partial` is ours because of the mark in it, which is there before anything
else, and in use as long as a process holds its lock: no other one writes the same output then. One
that nobody holds was left by a killed process, and the next that writes the output takes it over.
What a killed process can go on from lies in `.NAME.unfinished`, which nothing else removes.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from eventsweep.emvs.errors import InputError

MARK = ".eventsweep-work"
"""An empty file in every hidden work folder; its creation is atomic."""
REPLACED = "replaced"
"""What lies in a work folder until the output that takes its place is there."""
_ENDING, _RESUMED = ".partial", ".unfinished"
_LIMITS = (errno.EDQUOT, errno.EFBIG)
"""A limit of the user or of one file, whatever is free on the disk."""
_SHORT = re.compile(r"\d+ requested and \d+ written")
_UNITS = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")
_log = logging.getLogger(__name__)


class DiskFull(InputError):
    """An output that its disk has no room for."""

    @property
    def fault(self) -> str:
        """Which output, and what the system says, without the cure."""
        return str(self).rpartition(": ")[0]


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
        origin = error.__cause__ if isinstance(error, DiskFull) else error
        code = getattr(origin, "errno", None)
        fault, cure = "no space left on device", "free some space"
        if code in _LIMITS:
            fault, cure = os.strerror(code).lower(), "raise that limit"
        else:
            fault += f", {bytes_text(free_bytes(path))} are free"
        raise DiskFull(f"{path}: {fault}: {cure} or choose another output") from origin


def _is_full(error: OSError) -> bool:
    # HDF5 keeps the number to itself, and numpy says only how much it could write.
    says = os.strerror(errno.ENOSPC) in str(error) or _SHORT.fullmatch(str(error))
    return error.errno in (errno.ENOSPC, *_LIMITS) or bool(says)


def free_bytes(path: Path) -> int:
    """How much a user may still write to the disk that holds a path, or that will."""
    there = next(place for place in (path, *Path(path).absolute().parents) if place.exists())
    return shutil.disk_usage(there).free


def bytes_text(size: float) -> str:
    """A size in the unit that suits it, to three digits: 512 bytes, 3.2 MB, 1.05 GB."""
    power = 0
    while abs(size) >= 999.5 and power < len(_UNITS) - 1:
        size, power = size / 1000, power + 1
    return f"{size:.3g} {_UNITS[power]}"


def default_cache() -> Path:
    """`$EVENTSWEEP_CACHE`, or `eventsweep` in the user's cache folder (XDG)."""
    chosen = os.environ.get("EVENTSWEEP_CACHE")
    home = os.environ.get("XDG_CACHE_HOME")
    if chosen:
        return Path(chosen)
    return (Path(home) if home else Path.home() / ".cache") / "eventsweep"


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
    with made_parent(path), names_full_disk(path), work_folder(path, wait=True) as work:
        yield work / path.name
        flush(work / path.name)
        (work / path.name).replace(path)


def write_text(path: Path, text: str) -> None:
    """Writes a text file as `atomic_path` does."""
    with atomic_path(path) as partial:
        partial.write_text(text, encoding="utf-8")


def move_aside(source: Path, place: Path, why: str) -> Path:
    """Renames what stands, or stood, at a place to the first free `NAME.kept-1`; says so.

    A link is renamed itself, whatever it leads to.

    Raises:
        InputError: the system does not allow it.
    """
    names = (f"{place.name}.kept-{number}" for number in count(1))
    kept = next(path for path in map(place.with_name, names) if not os.path.lexists(path))
    rename_away(source, kept)
    _log.warning("%s %s: it is kept as %s", place, why, kept)
    return kept


def rename_away(source: Path, to: Path) -> None:
    """Renames what an output takes the place of; a refusal of the system is one line."""
    try:
        source.rename(to)
    except OSError as error:
        raise InputError(
            f"cannot move {source} away ({error.strerror}): choose another output"
        ) from error


@contextmanager
def work_folder(place: Path, *, wait: bool = False, resume: bool = False) -> Iterator[Path]:
    """Makes a hidden folder beside a place, for this process alone; removes it at the end.

    What a killed process left in it is removed first. With `resume` it is another folder: what is
    in it is kept, also after an error, until the work it belongs to is taken up and ends well.

    Raises:
        InputError: another process has it, unless to `wait` for that; or it cannot be made.
    """
    if not os.access(place.parent, os.W_OK):
        raise InputError(f"cannot write to {place.parent}: no permission, choose another output")
    work = place.with_name(f".{place.name}{_RESUMED if resume else _ENDING}")
    if _is_foreign(work):
        move_aside(work, work, "has the name of unfinished work")
    lock = _locked(work, make=True, wait=wait)
    if lock is None:
        raise InputError(f"{place}: another process is writing it: wait, or choose another output")
    try:
        if not resume:
            _empty(work)
        yield work
    except BaseException:
        if not resume or [path.name for path in work.iterdir()] == [MARK]:
            _remove(work)
        raise
    else:
        _remove(work)
    finally:
        os.close(lock)


def remove_leftovers(folder: Path) -> None:
    """Removes what killed processes left in a folder, but for what they can go on from."""
    for work in [path for path in folder.glob(f".*{_ENDING}") if is_work_folder(path)]:
        lock = _locked(work)
        if lock is not None:
            _remove(work)
            os.close(lock)


def _is_foreign(work: Path) -> bool:
    """Whether something else has the name; one look, for others may be making or removing ours."""
    try:
        inside = [path.name for path in work.iterdir()]
    except FileNotFoundError:
        return work.is_symlink()
    except OSError:  # no folder
        return True
    return work.is_symlink() or (bool(inside) and MARK not in inside)


def is_work_folder(path: Path) -> bool:
    """Whether a folder carries our mark; an empty one may be about to, and holds nothing."""
    with suppress(OSError):
        if not path.is_symlink() and path.is_dir():
            return (path / MARK).is_file() or not any(path.iterdir())
    return False


def _locked(work: Path, *, make: bool = False, wait: bool = False) -> int | None:
    """Locks a work folder, after making it if need be; None while another process has it."""
    while True:
        is_new = False
        if make:
            with suppress(FileExistsError):
                work.mkdir()
                is_new = True
        try:
            lock = os.open(work, os.O_RDONLY | os.O_NOFOLLOW)
        except FileNotFoundError:
            if make:
                continue
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            # On a disk without locks one that was there may be in use for all we know.
            if error.errno == errno.EWOULDBLOCK or not is_new:
                os.close(lock)
                return None
        with suppress(FileNotFoundError):  # its last holder has removed it meanwhile
            if os.path.samestat(os.fstat(lock), os.lstat(work)):
                (work / MARK).touch()
                return lock
        os.close(lock)


def _empty(work: Path) -> None:
    """Removes all but the mark; what was being replaced goes back, or beside its successor."""
    replaced, place = work / REPLACED, work.with_name(work.name[1:].rpartition(".")[0])
    if os.path.lexists(replaced) and not os.path.lexists(place):
        replaced.rename(place)
    elif os.path.lexists(replaced):
        move_aside(replaced, place, "was being replaced when a process was killed")
    for path in [path for path in work.iterdir() if path.name not in (MARK, REPLACED)]:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


def _remove(work: Path) -> None:
    with suppress(OSError):
        _empty(work)
        (work / MARK).unlink()
        work.rmdir()


def link_new(made: Path, place: Path) -> None:
    """Gives a file or folder its name, which must be free."""
    try:
        os.link(made, place)
    except FileExistsError:
        raise
    except OSError:  # a folder, or a file system without links
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
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(
                    f"cannot make the folder {path.parent}: {error.strerror}"
                ) from error
            if not os.access(path.parent, os.W_OK):
                raise InputError(
                    f"cannot write to {path.parent}: no permission, choose another output"
                )
        yield
    except BaseException:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()
        raise


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
    shutil.copytree(source, target, copy_function=_link, dirs_exist_ok=True)


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        shutil.copy2(source, target)
