"""Outputs: whole or not there, and nothing that was there is lost that was not ours.

The one place that decides what may be replaced. An output is claimed, so that no other run writes
it; made beside its place; and put there only after everything was checked once more. A folder is
replaced only where this program wrote all that is in it, and never where it is, holds or lies in
an input, the working directory, the home folder or a mounted file system.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import flush, made_parent, names_full_disk, umask
from eventsweep.emvs.utils.ownership import named, remove_ours, strangers

_ANOTHER = "choose another output"
_LOCK = b"eventsweep: a run is writing the output of this name\n"
Inputs = Iterable[Path | str | None]


@contextmanager
def atomic_dir(
    path: Path, *, force: bool = False, inputs: Inputs = (), claim: bool = True
) -> Iterator[Path]:
    """Yields an empty folder beside `path`; renames it to `path` at the end, removes it on error.

    An existing folder is replaced only with `force`, only at the end, and only as `check_output`
    allows. If it may not be replaced then, the finished output stays beside it, and the error says
    where. What a killed process left beside `path` is removed first.

    Args:
        path: the folder to make.
        force: whether one of ours is replaced.
        inputs: what the output is made from.
        claim: whether to keep other processes away; not where the caller does.

    Raises:
        InputError: what `check_output` refuses, another process writes the same output, or its
            folder cannot be written to.
    """
    path, inputs = Path(path), tuple(inputs)
    check_output(path, force=force, inputs=inputs)
    place = real(path)
    with claimed(path) if claim else made_parent(place):
        check_output(path, force=force, inputs=inputs)  # another run may just have ended
        remove_abandoned(path)
        with names_full_disk(path), _beside(place) as partial:
            yield partial
            partial.chmod(0o777 & ~umask())
            for file in partial.rglob("*"):
                flush(file)
            _put(partial, path, place, force=force, inputs=inputs, folder=True)


@contextmanager
def output_file(path: Path, *, force: bool = False, inputs: Inputs = ()) -> Iterator[Path]:
    """Yields where to write a file of the same name; puts it in its place at the end.

    Args:
        path: the file to make.
        force: whether a file that is there is replaced.
        inputs: what it is made from.

    Raises:
        InputError: as `atomic_dir`.
    """
    path, inputs = Path(path), tuple(inputs)
    check_output(path, force=force, inputs=inputs, folder=False)
    place = real(path)
    with claimed(path), names_full_disk(path), _beside(place) as partial:
        check_output(path, force=force, inputs=inputs, folder=False)
        staged = partial / place.name
        try:
            yield staged
        except InputError as error:
            raise type(error)(str(error).replace(str(staged), str(path))) from error
        flush(staged)
        _put(staged, path, place, force=force, inputs=inputs, folder=False)


@contextmanager
def output_folder(
    path: Path, names: Iterable[str] = (), *, force: bool = False, inputs: Inputs = ()
) -> Iterator[Path]:
    """Claims a folder that files are put into, beside others; on an error none is left empty.

    Args:
        path: the folder; made by what writes the files.
        names: of the files that will be written, or of their folders.
        force: whether files of ours are replaced.
        inputs: what they are made from.

    Raises:
        InputError: another process writes the same output, or a name is taken: by a file of ours
            and `force` is not set, or by anything else.
    """
    path, inputs = Path(path), tuple(inputs)
    check_files(path, names, force=force, inputs=inputs)
    with claimed(path), made_parent(real(path) / "file", make=False):
        yield path


@contextmanager
def files_together(folder: Path, names: Iterable[str], *, index: str = "") -> Iterator[Path]:
    """Yields a hidden folder to write files into; puts them into `folder` at the end, all or none.

    A kill may come between two of them: what is hidden then stays, says which files are ours
    (`emvs.utils.ownership`), and the next call of the same names removes it.

    Args:
        folder: where they belong, beside others.
        names: of all files, in the order in which they are put there; the last one is the same in
            every call for the same files.
        index: one of them that others are read by: while they are exchanged it is not there.

    Raises:
        InputError: the folder cannot be made or written to, or its disk is full.
    """
    names = list(names)
    folder = Path(folder)
    with made_parent(folder / names[-1]), names_full_disk(folder):
        place = real(folder)
        remove_abandoned(place / names[-1])
        with _beside(place / names[-1]) as staged:
            yield staged
            for name in names:
                (staged / name).chmod(0o666 & ~umask())
                flush(staged / name)
            if index:
                (place / index).unlink(missing_ok=True)
            for name in sorted(names, key=lambda name: name == index):
                (staged / name).replace(place / name)


def replace_dir(made: Path, path: Path, *, inputs: Inputs = ()) -> None:
    """Puts a finished folder, made beside `path`, in its place; the caller holds the claim.

    Raises:
        InputError: what is there may no longer be replaced; says where the finished output is.
    """
    _put(made, path, real(path), force=True, inputs=tuple(inputs), folder=True)


def check_output(path: Path, *, force: bool, inputs: Inputs = (), folder: bool = True) -> None:
    """Refuses an output that exists, unless `force` says to replace it, and it may be replaced.

    Args:
        path: the output.
        force: whether it is to be replaced.
        inputs: what it is made from; None and what does not exist are passed over.
        folder: whether the output is a folder; else it is a file.

    Raises:
        InputError: says why, and what helps.
    """
    path = Path(path)
    place = real(path)
    if not os.path.lexists(place):
        _check_parent(path, place)
        return
    why = _why_not(place, tuple(inputs), folder=folder)
    if why:
        raise InputError(f"{path} {why}: {_ANOTHER}")
    if not force:
        raise InputError(f"{path} exists: {_ANOTHER}, or set force=True to replace it")


def check_files(
    path: Path, names: Iterable[str], *, force: bool = False, inputs: Inputs = ()
) -> None:
    """Refuses files in a folder whose names are taken, by ours unless `force`, by others always.

    Raises:
        InputError: names them.
    """
    path = Path(path)
    place = real(path)
    if not os.path.lexists(place):
        _check_parent(path, place)
        return
    if not place.is_dir():
        raise InputError(f"{path} is a file, the output is a folder: {_ANOTHER}")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"cannot write to {path}: no permission, {_ANOTHER}")
    taken = [name for name in names if os.path.lexists(place / name)]
    theirs = strangers(place, taken)
    if theirs:
        raise InputError(
            f"{path} holds {named(theirs)}, which eventsweep did not write: {_ANOTHER}, or move "
            f"{'it' if len(theirs) == 1 else 'them'} away"
        )
    given = tuple(inputs)
    for name in taken:
        why = _touching(place / name, given)
        if why:
            raise InputError(f"{path / name} {why}: {_ANOTHER}")
        if not force:
            raise InputError(f"{path / name} exists: {_ANOTHER}, or set force=True to replace it")


def cure(path: Path, inputs: Inputs = ()) -> str:
    """What helps where an output is in the way: `force` only where it would be heeded."""
    why = _why_not(real(path), tuple(inputs), folder=True)
    return f"{_ANOTHER}, or set force=True to replace it" if not why else f"{_ANOTHER}; it {why}"


def real(path: Path) -> Path:
    """Where a path leads, links followed.

    Raises:
        InputError: links in a circle, or a name that no file can have.
    """
    try:
        return Path(path).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        shown = str(path) if str(path).isprintable() else ascii(str(path))
        raise InputError(f"{shown} is not a valid file name: {_ANOTHER}") from error


def inputs_of(path: Path) -> tuple[Path, ...]:
    """A recording, and the files that its descriptor names."""
    path = Path(path)
    descriptor = path / "recording.toml" if path.is_dir() else path
    if descriptor.suffix != ".toml":
        return (path,)
    try:
        content = tomllib.loads(descriptor.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return (path,)
    return (path, *(descriptor.parent / text for text in _texts(content) if "\0" not in text))


@contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Keeps other processes from the same output; folders above it are made, and go on an error.

    The claim is a lock on a hidden file beside the output, which the system lets go of when the
    process ends, however it ends.

    Raises:
        InputError: another process holds it, or the folder cannot be made or written to.
    """
    place = real(path)
    if place.is_dir() and not os.access(place.parent, os.W_OK):
        yield  # a folder that can only be written into: nothing can lie beside it
        return
    with made_parent(place):
        lock = _lock(path, place.parent / f".{place.name}.lock")
        try:
            yield
        finally:
            if lock is not None:
                _release(lock, place.parent / f".{place.name}.lock")


def remove_abandoned(path: Path) -> None:
    """Removes what killed processes left of the same target: folders that nobody holds locked."""
    path = real(path)
    left = re.compile(rf"\.{re.escape(path.name)}\.\w{{8}}\.partial")
    for folder in path.parent.iterdir():
        if not left.fullmatch(folder.name) or folder.is_symlink() or not folder.is_dir():
            continue
        with suppress(OSError):
            lock = os.open(folder, os.O_RDONLY)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder)
            finally:
                os.close(lock)


def _check_parent(path: Path, place: Path) -> None:
    """Refuses, without making anything, an output below a file or where nobody may write."""
    if path.is_symlink():
        raise InputError(f"{path} is a link to {place}, which is not there: {_ANOTHER}")
    parent = next(folder for folder in place.parents if os.path.lexists(folder))
    if not parent.is_dir():
        raise InputError(f"cannot make the folder {place.parent}: {parent} is a file; {_ANOTHER}")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"cannot write to {parent}: no permission, {_ANOTHER}")


def _why_not(place: Path, inputs: tuple[Path | str | None, ...], *, folder: bool) -> str:
    """Why something that exists is never replaced; empty where it may be."""
    mode = os.lstat(place).st_mode
    if not folder:
        if stat.S_ISDIR(mode):
            return "is a folder, the output is a file"
        if not stat.S_ISREG(mode):
            return "is no plain file"
        return _touching(place, inputs)
    if not stat.S_ISDIR(mode):
        return "is a file, the output is a folder"
    return _precious(place) or _touching(place, inputs) or _foreign(place)


def _precious(place: Path) -> str:
    """Whether a folder is, or holds, one that nobody means to replace."""
    for what, find in (("the working directory", Path.cwd), ("the home folder", Path.home)):
        try:
            one = find().resolve()
        except (OSError, RuntimeError):  # removed, or without a name
            continue
        if _is_in(one, place):
            return f"is {what}" if _same(one, place) else f"holds {what}"
    # Compared by name: looking at a file system whose server is gone may take for ever.
    if os.path.ismount(place) or any(place in (one, *one.parents) for one in _mounts()):
        return "is or holds a mounted file system"
    return ""


def _touching(place: Path, inputs: tuple[Path | str | None, ...]) -> str:
    """How an output and an input lie to each other, where they touch."""
    for given in inputs:
        one = None if given is None else real(Path(given))
        if one is None or not os.path.lexists(one):
            continue
        if _same(one, place):
            return "is the input itself"
        if _is_in(one, place):
            return f"holds the input {given}"
        if _is_in(place, one):
            return f"is part of the input {given}"
    return ""


def _foreign(place: Path) -> str:
    found = strangers(place)
    return f"holds what eventsweep did not write ({named(found)})" if found else ""


def _is_in(inner: Path, outer: Path) -> bool:
    """Whether one folder is, or lies in, another; by what they are, not by what they are called."""
    return any(_same(one, outer) for one in (inner, *inner.parents))


def _same(first: Path, second: Path) -> bool:
    try:
        return first.samefile(second)
    except (OSError, ValueError):
        return False


def _mounts() -> list[Path]:
    """Where file systems are mounted, as far as the system says so."""
    try:
        lines = Path("/proc/self/mountinfo").read_bytes().splitlines()
    except OSError:
        return []
    names = (re.sub(rb"\\([0-7]{3})", _byte, line.split()[4]) for line in lines)
    return [Path(os.fsdecode(name)) for name in names]


def _byte(match: re.Match[bytes]) -> bytes:
    return bytes([int(match[1], 8)])


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict | list):
        for one in content.values() if isinstance(content, dict) else content:
            yield from _texts(one)


@contextmanager
def _beside(place: Path) -> Iterator[Path]:
    """A new folder beside a place, locked as long as this process lives; removed at the end."""
    if not os.access(place.parent, os.W_OK):
        raise InputError(f"cannot write to {place.parent}: no permission, {_ANOTHER}")
    partial, lock = _locked_folder(place)
    try:
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        os.close(lock)


def _locked_folder(place: Path) -> tuple[Path, int]:
    while True:
        name = tempfile.mkdtemp(prefix=f".{place.name}.", suffix=".partial", dir=place.parent)
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


def _put(
    made: Path,
    path: Path,
    place: Path,
    *,
    force: bool,
    inputs: tuple[Path | str | None, ...],
    folder: bool,
) -> None:
    """Puts what was made in its place, after checking once more; else keeps it beside."""
    try:
        if real(path) != place:
            raise InputError(f"{path} now leads elsewhere, to {real(path)}")
        check_output(path, force=force, inputs=inputs, folder=folder)
        if folder:
            _swap(made, place)
        elif force:
            made.replace(place)
        else:
            _link(made, place)
    except (InputError, FileExistsError) as error:
        why = str(error) if isinstance(error, InputError) else f"{path} appeared meanwhile"
        raise InputError(f"{why} (the finished output is in {_kept(made, place)})") from error


def _link(made: Path, place: Path) -> None:
    """Gives a file its name, which must be free."""
    try:
        os.link(made, place)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if os.path.lexists(place):
            raise FileExistsError(str(place)) from None
        made.rename(place)


def _kept(made: Path, place: Path) -> Path:
    """Moves a finished output to a free name beside its place."""
    names = (f"{place.stem}.finished{n or ''}{place.suffix}" for n in range(1_000_000))
    free = next(one for one in map(place.with_name, names) if not os.path.lexists(one))
    made.rename(free)
    return free


def _swap(made: Path, place: Path) -> None:
    """Puts a folder in the place of another, of which only what is ours is then removed."""
    if not os.path.lexists(place):
        _rename(made, place)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{place.name}.", suffix=".old", dir=place.parent))
    aside = old / "replaced"
    try:
        place.rename(aside)
        # Out of everybody's way now: what came since the last check is found here.
        found = strangers(aside)
        if found:
            raise InputError(f"{place} now holds what eventsweep did not write ({named(found)})")
        _rename(made, place)
    finally:
        if not made.exists():
            remove_ours(aside)
        elif aside.exists() and not os.path.lexists(place):
            aside.rename(place)
        with suppress(OSError):
            old.rmdir()


def _rename(made: Path, place: Path) -> None:
    """Renames a folder; that another one came in between says so."""
    try:
        made.rename(place)
    except OSError as error:
        if os.path.lexists(place):
            raise FileExistsError(str(place)) from error
        raise


def _lock(path: Path, file: Path) -> int | None:
    """Locks a hidden file; None where the file system has no locks or lets nobody write."""
    while True:
        lock = _opened(file)
        if lock is None:
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Its last holder may have removed it before it was locked.
            if file.exists() and os.path.samestat(os.fstat(lock), os.lstat(file)):
                return lock
        except BlockingIOError as error:
            os.close(lock)
            raise InputError(
                f"{path}: another process is writing it: wait, or {_ANOTHER}"
            ) from error
        except OSError:
            os.close(lock)
            return None
        os.close(lock)


def _opened(file: Path) -> int | None:
    """The hidden file, new with our words in it, or as it is."""
    flags = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK
    while True:
        try:
            new = os.open(file, flags | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError:
            with suppress(FileNotFoundError):
                try:
                    return os.open(file, flags)
                except FileNotFoundError:
                    raise
                except OSError:
                    return None
        except OSError:
            return None
        else:
            os.write(new, _LOCK)
            return new


def _release(lock: int, file: Path) -> None:
    """Removes the hidden file, if it is ours, and lets go of it."""
    with suppress(OSError):
        if os.pread(lock, len(_LOCK) + 1, 0) == _LOCK:
            file.unlink()
    os.close(lock)
