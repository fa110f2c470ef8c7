"""Outputs: complete or absent, and nothing is lost that this program did not write.

The one door to the disk. An output is claimed, so that no other run writes it; made in a hidden
folder beside its place; and put there only after everything was checked once more. What it replaces
is moved aside first and removed last. A folder is replaced only where its manifest lists all that
is in it, unchanged (`emvs.utils.output_manifest`), and never where it is, holds or lies in an
input, the working directory, the home folder or a mounted file system.
"""

from __future__ import annotations

import fcntl
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils import output_manifest
from eventsweep.emvs.utils.files import (
    REPLACED,
    flush,
    leftovers,
    link_new,
    made_parent,
    names_full_disk,
    remove_leftovers,
    remove_work,
    work_folder,
)
from eventsweep.emvs.utils.output_manifest import (
    LOCK,
    check_ours,
    named,
    remove_ours,
    strangers,
)

_ANOTHER = "choose another output"
Inputs = Iterable[Path | str | None]


@contextmanager
def atomic_dir(
    path: Path, *, force: bool = False, inputs: Inputs = (), claim: bool = True,
    manifest: bool = True, part_of: Path | None = None,
) -> Iterator[Path]:  # fmt: skip
    """Yields an empty folder; at the end lists what is in it, and puts it in the place of `path`.

    An existing folder is replaced only with `force`, only at the end, and only as `check_output`
    allows. If it may not be replaced then, the finished output stays beside it, and the error says
    where. What a killed process left of `path` is removed first.

    Args:
        path: the folder to make.
        force: whether an output of ours is replaced.
        inputs: what the output is made from.
        claim: whether to keep other processes away; not where the caller does.
        manifest: whether to list what is in it; not where the caller wrote hashes of its own.
        part_of: the output that the folder is a part of, and which the caller has claimed.

    Raises:
        InputError: what `check_output` refuses, or another process writes the same output.
    """
    path, inputs = Path(path), tuple(inputs)
    check_output(path, force=force, inputs=inputs)
    place = real(path)
    with claimed(path) if claim else made_parent(place):
        if not claim:
            _restore(place)
        check_output(path, force=force, inputs=inputs)  # another run may just have ended
        with names_full_disk(path), work_folder(place) as work:
            made = work / "new"
            made.mkdir()
            yield made
            if manifest:
                output_manifest.complete(made)
            for file in made.rglob("*"):
                flush(file)
            if part_of is not None:
                output_manifest.add_part(part_of, place.relative_to(real(part_of)).as_posix())
            _put(made, path, place, work, force=force, inputs=inputs, folder=True)


@contextmanager
def output_file(
    path: Path, *, force: bool = False, inputs: Inputs = (), listed: bool = False
) -> Iterator[Path]:
    """Yields where to write a file of the same name; puts it in its place as `atomic_dir` does.

    With `listed` the manifest of its folder lists it, so that it is known to be ours.
    """
    path, inputs = Path(path), tuple(inputs)
    check_output(path, force=force, inputs=inputs, folder=False)
    place = real(path)
    with claimed(path), names_full_disk(path), work_folder(place) as work:
        check_output(path, force=force, inputs=inputs, folder=False)
        made = work / place.name
        try:
            yield made
        except InputError as error:
            raise type(error)(str(error).replace(str(made), str(path))) from error
        flush(made)
        files = {place.name: output_manifest.facts_of(made)} if listed else {}
        with output_manifest.listing(place.parent, files) if listed else nullcontext():
            _put(made, path, place, work, force=force, inputs=inputs, folder=False)


@contextmanager
def output_folder(
    path: Path, names: Iterable[str] = (), *, force: bool = False, inputs: Inputs = ()
) -> Iterator[Path]:
    """Claims a folder that files, or folders, of these names are put into, beside others.

    It is made by what writes the files; on an error none is left empty.

    Raises:
        InputError: what `check_files` refuses, or another process writes the same output.
    """
    path, inputs = Path(path), tuple(inputs)
    check_files(path, names, force=force, inputs=inputs)
    with claimed(path), made_parent(real(path) / "file", make=False):
        if path.is_dir():
            remove_leftovers(path)
        yield path


@contextmanager
def files_together(folder: Path, names: Iterable[str], *, index: str = "") -> Iterator[Path]:
    """Yields a hidden folder to write files into; at the end lists and puts them into `folder`.

    A kill may come between two of them: they are listed before, and the next call of the same names
    goes on from there. While they are exchanged `index`, by which others are read, is not there.
    """
    names, place = list(names), real(folder)
    hidden = place / output_manifest.NAME
    with made_parent(hidden), names_full_disk(folder), work_folder(hidden) as work:
        staged = work / "new"
        staged.mkdir()
        for name in names:
            (staged / name).parent.mkdir(parents=True, exist_ok=True)
        yield staged
        output_manifest.exchange(staged, place, names, index)


def replace_dir(made: Path, path: Path, *, inputs: Inputs = ()) -> None:
    """Puts a finished folder, made beside `path`, in its place; the caller holds the claim."""
    place = real(path)
    with work_folder(place) as work:
        _put(made, path, place, work, force=True, inputs=tuple(inputs), folder=True)


def check_output(path: Path, *, force: bool, inputs: Inputs = (), folder: bool = True) -> None:
    """Refuses an output that exists, unless `force` says to replace it, and it may be replaced.

    `folder` says whether it is to be a folder; inputs that do not exist are passed over.
    """
    path = Path(path)
    place = real(path)
    if not os.path.lexists(place):
        check_parent(path)
        return
    why = _why_not(place, tuple(inputs), folder=folder)
    if why:
        raise InputError(f"{path} {why}: {_ANOTHER}")
    if not force:
        raise InputError(f"{path} exists: {_ANOTHER}, or set force=True to replace it")


def check_files(
    path: Path, names: Iterable[str], *, force: bool = False, inputs: Inputs = ()
) -> None:
    """Refuses files in a folder whose names are taken, by ours unless `force`, by others always."""
    path = Path(path)
    place = real(path)
    if not os.path.lexists(place):
        check_parent(path)
        return
    if not place.is_dir():
        raise InputError(f"{path} is a file, the output is a folder: {_ANOTHER}")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"cannot write to {path}: no permission, {_ANOTHER}")
    taken = [name for name in names if os.path.lexists(place / name)]
    check_ours(place, taken)
    given = tuple(inputs)
    for name in taken:
        why = _touching(place / name, given)
        if why:
            raise InputError(f"{path / name} {why}: {_ANOTHER}")
        if not force:
            raise InputError(f"{path / name} exists: {_ANOTHER}, or set force=True to replace it")


def cure(path: Path) -> str:
    """What helps where an output is in the way: `force` only where it would be heeded."""
    why = _why_not(real(path), (), folder=True)
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
def claimed(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Keeps other processes from the same output; folders above it are made, and go on an error.

    The claim is a lock on a hidden file beside the output, which the system lets go of when the
    process ends, however it ends. Another process's is an error, unless to `wait` for it.
    """
    place = real(path)
    if place.is_dir() and not os.access(place.parent, os.W_OK):
        yield  # a folder that can only be written into: nothing can lie beside it
        return
    with made_parent(place):
        file = place.parent / f".{place.name}.lock"
        remove_leftovers(place.parent, f".{file.name}.")
        lock = _lock(path, file, wait=wait)
        try:
            _restore(place)
            yield
        finally:
            if lock is not None:
                _release(lock, file)


def check_parent(path: Path) -> None:
    """Refuses, without making anything, an output below a file or where nobody may write."""
    place = real(path)
    if path.is_symlink():
        raise InputError(f"{path} is a broken link to {place}: {_ANOTHER}")
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
            return "is not a regular file"
        return _touching(place, inputs)
    if not stat.S_ISDIR(mode):
        return "is a file, the output is a folder"
    return _precious(place) or _touching(place, inputs) or _foreign(place)


def _precious(place: Path) -> str:
    """Whether a folder is, or holds, one that nobody means to replace."""
    for what, find in (("the working directory", Path.cwd), ("the home folder", Path.home)):
        try:
            folder = find().resolve()
        except (OSError, RuntimeError):  # removed, or without a name
            continue
        if _is_in(folder, place):
            return f"is {what}" if _same(folder, place) else f"holds {what}"
    # Compared by name: looking at a file system whose server is gone may take for ever.
    if os.path.ismount(place) or any(place in (mount, *mount.parents) for mount in _mounts()):
        return "is or holds a mounted file system"
    return ""


def _touching(place: Path, inputs: tuple[Path | str | None, ...]) -> str:
    """How an output and an input lie to each other, where they touch."""
    for given in inputs:
        source = None if given is None else real(Path(given))
        if source is None or not os.path.lexists(source):
            continue
        if _same(source, place):
            return "is the input itself"
        if _is_in(source, place):
            return f"holds the input {given}"
        if _is_in(place, source):
            return f"is part of the input {given}"
    return ""


def _foreign(place: Path) -> str:
    foreign = strangers(place)
    what = "which eventsweep did not write, or which was changed since"
    return f"holds {named(foreign)}, {what}" if foreign else ""


def _is_in(inner: Path, outer: Path) -> bool:
    """Whether one folder is, or lies in, another; by what they are, not by what they are called."""
    return any(_same(folder, outer) for folder in (inner, *inner.parents))


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
    octal = re.compile(rb"\\([0-7]{3})")
    names = (octal.sub(lambda code: bytes([int(code[1], 8)]), line.split()[4]) for line in lines)
    return [Path(os.fsdecode(name)) for name in names]


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict | list):
        for value in content.values() if isinstance(content, dict) else content:
            yield from _texts(value)


def _put(
    made: Path, path: Path, place: Path, work: Path, *,
    force: bool, inputs: tuple[Path | str | None, ...], folder: bool,
) -> None:  # fmt: skip
    """Puts what was made in its place, after checking once more; else keeps it beside."""
    try:
        if real(path) != place:
            raise InputError(f"{path} now points elsewhere, to {real(path)}")
        check_output(path, force=force, inputs=inputs, folder=folder)
        if folder:
            _swap(made, place, work / REPLACED)
        elif force:
            made.replace(place)
        else:
            link_new(made, place)
    except (InputError, FileExistsError) as error:
        why = str(error) if isinstance(error, InputError) else f"{path} appeared meanwhile"
        raise InputError(f"{why} (the finished output is in {_kept(made, place)})") from error


def _kept(made: Path, place: Path) -> Path:
    """Moves a finished output to a free name beside its place."""
    names = (f"{place.stem}.finished{n or ''}{place.suffix}" for n in range(1_000_000))
    free = next(path for path in map(place.with_name, names) if not os.path.lexists(path))
    made.rename(free)
    return free


def _swap(made: Path, place: Path, replaced: Path) -> None:
    """Puts a folder in the place of another, of which only what is ours is then removed."""
    if not os.path.lexists(place):
        _rename(made, place)
        return
    try:
        place.rename(replaced)
        # Out of everybody's way now: what came since the last check is found here.
        theirs = strangers(replaced)
        if theirs:
            raise InputError(
                f"{place} now contains files that eventsweep did not write ({named(theirs)})"
            )
        _rename(made, place)
    finally:
        if not made.exists():
            remove_ours(replaced)
        elif replaced.exists() and not os.path.lexists(place):
            replaced.rename(place)


def _restore(place: Path) -> None:
    """Undoes, or ends, what a killed process was doing with the folder that it replaced."""
    for work, lock in leftovers(place.parent, f".{place.name}."):
        replaced = work / REPLACED
        if os.path.lexists(replaced) and not os.path.lexists(place):
            replaced.rename(place)
        elif replaced.exists():
            remove_ours(replaced)
        remove_work(work)
        os.close(lock)


def _rename(made: Path, place: Path) -> None:
    """Renames a folder; that another one came in between says so."""
    try:
        made.rename(place)
    except OSError as error:
        if os.path.lexists(place):
            raise FileExistsError(str(place)) from error
        raise


def _lock(path: Path, file: Path, *, wait: bool) -> int | None:
    """Locks a hidden file; None where the file system has no locks or lets nobody write."""
    while True:
        lock = _opened(file)
        if lock is None:
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
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
    """The hidden file as it is, or a new one that appears with our words in it."""
    while True:
        with suppress(FileNotFoundError):
            try:
                return os.open(file, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
            except FileNotFoundError:
                raise
            except OSError:
                return None
        try:
            with work_folder(file) as work:
                (work / "lock").write_bytes(LOCK)
                link_new(work / "lock", file)
        except FileExistsError:
            continue
        except (OSError, InputError):
            return None


def _release(lock: int, file: Path) -> None:
    """Removes the hidden file, if it is ours, and lets go of it."""
    with suppress(OSError):
        if os.pread(lock, len(LOCK) + 1, 0) == LOCK:
            file.unlink()
    os.close(lock)
