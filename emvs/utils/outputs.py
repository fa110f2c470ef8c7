"""Outputs: complete or absent, and what they replace is never lost.

The one door to the disk. An output is claimed, so that no other run writes it; made in a hidden
folder beside its place; and put there when it is done. What stands there then is removed only if
every file of it is listed by our own manifest and unchanged (`emvs.utils.output_manifest`), and no
input is, holds or lies in it. Otherwise it is renamed to `NAME.kept-1`, and a line says so.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from itertools import count
from pathlib import Path

from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.utils import output_manifest
from eventsweep.emvs.utils.address import address_of, is_address
from eventsweep.emvs.utils.files import (
    REPLACED,
    flush,
    link_new,
    made_parent,
    move_aside,
    names_full_disk,
    remove_leftovers,
    rename_away,
    work_folder,
)
from eventsweep.emvs.utils.inputs import command_inputs, inputs_of
from eventsweep.emvs.utils.output_manifest import OutputManifest, is_ours, survey

_ANOTHER = "choose another output"
CURE = f"{_ANOTHER}, or set force=True to replace it"
"""What helps where an output is in the way."""
_FOREIGN = "was not written by eventsweep, or was changed since"
_HELD = "which eventsweep did not write, or which was changed since"


@contextmanager
def atomic_dir(
    path: Path, *, force: bool = False, inputs: Iterable[object] = (), work: Path | None = None,
    manifest: bool = True, part_of: Path | None = None,
) -> Iterator[Path]:  # fmt: skip
    """Yields an empty folder; at the end lists what is in it, and puts it in the place of `path`.

    Args:
        path: the folder to make.
        force: whether what stands there is replaced, or kept under another name.
        inputs: what the output is made from: paths, and settings that hold some.
        work: what `claimed` yields, where the caller has claimed the output.
        manifest: whether to list what is in it; not where the caller wrote hashes of its own.
        part_of: the output that the folder is a part of.

    Raises:
        InputError: what `check_output` refuses, or another process writes the same output. If it
            comes at the end, the finished output stays beside its place, and the error says where.
    """
    with _making(path, inputs, work, force=force, into=part_of) as made:
        yield made
        if manifest:
            output_manifest.complete(made)
        if part_of is not None:
            output_manifest.add_part(part_of, _place(path).relative_to(real(part_of)).as_posix())


@contextmanager
def output_file(
    path: Path, *, force: bool = False, inputs: Iterable[object] = ()
) -> Iterator[Path]:
    """Yields where to write a file of the same name; puts it in its place as `atomic_dir` does.

    The manifest of its folder lists it, so that it is known to be ours.
    """
    with _making(path, inputs, None, force=force, name=_place(Path(path)).name) as made:
        yield made


@contextmanager
def _making(
    path: Path, inputs: Iterable[object], work: Path | None, *,
    force: bool, into: Path | None = None, name: str = "",
) -> Iterator[Path]:  # fmt: skip
    """Yields a hidden folder, or a file of a `name` in it; puts it in the output's place."""
    path = Path(path)
    check_output(path, force=force)
    place = _place(path)
    held = nullcontext(work) if work else work_folder(place)
    with made_parent(place), held as work, names_full_disk(path):
        check_output(path, force=force)  # another run may just have ended
        made = work / "new"
        made.mkdir()
        made /= name
        try:
            yield made
        except InputError as error:
            error.args = (str(error).replace(str(made), str(path)),)
            raise
        for file in (made, *made.rglob("*")):
            flush(file)
        alone = {place.name: output_manifest.facts_of(made)} if made.is_file() else {}
        with output_manifest.listing(place.parent, alone) if alone else nullcontext():
            _put(made, path, place, work, force=force, inputs=inputs, into=into)


@contextmanager
def output_folder(path: Path, names: Iterable[str] = (), *, force: bool = False) -> Iterator[Path]:
    """Claims a folder that files, or folders, of these names are put into, beside others.

    It is made by what writes the files; on an error none is left empty.

    Raises:
        InputError: what `check_files` refuses, or another process writes the same output.
    """
    path = Path(path)
    check_files(path, names, force=force)
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
    ordered, place = sorted(names, key=lambda name: name == index), real(folder)
    hidden = place / "files"
    with made_parent(hidden), names_full_disk(folder), work_folder(hidden, wait=True) as work:
        staged = work / "new"
        for name in ordered:
            (staged / name).parent.mkdir(parents=True, exist_ok=True)
        yield staged
        for name in ordered:
            flush(staged / name)
        facts = {name: output_manifest.facts_of(staged / name) for name in ordered}
        with output_manifest.listing(place, facts) as before:
            for name in ordered:
                _make_room(place, name, before)
            if index:
                (place / index).unlink(missing_ok=True)
            for name in ordered:
                (place / name).parent.mkdir(parents=True, exist_ok=True)
                put = Path.replace if os.path.lexists(place / name) else link_new
                put(staged / name, place / name)


def replace_dir(made: Path, path: Path, work: Path, *, inputs: Iterable[object] = ()) -> None:
    """Puts a finished folder, made beside `path`, in its place; `work` is what `claimed` yields."""
    _put(made, path, _place(path), work, force=True, inputs=inputs)


def discard(path: Path, work: Path | None = None) -> None:
    """Removes an output of ours; anything else is kept under another name.

    `work` is what `claimed` yields, where the caller has claimed the output.
    """
    place = _place(path)
    if os.path.lexists(place):
        with nullcontext(work) if work else work_folder(place) as work:
            _remove(_out_of_the_way(place, work, ()), place, work)


def check_output(path: Path, *, force: bool) -> None:
    """Refuses an output that exists, unless by `force`, and one that cannot be made.

    Raises:
        InputError: says why. Devices, the working directory, the home folder and what holds them
            are refused however asked.
    """
    place = _place(Path(path))
    if not os.path.lexists(place):
        check_parent(path)
        return
    kind = os.lstat(place).st_mode
    if not (stat.S_ISDIR(kind) or stat.S_ISREG(kind) or stat.S_ISLNK(kind)):
        raise InputError(f"{path} is a pipe, device or socket: {_ANOTHER}")
    for what, find in (("working directory", Path.cwd), ("home folder", Path.home)):
        with suppress(OSError, RuntimeError):  # removed, or without a name
            if _is_in(find().resolve(), place) and not place.is_symlink():
                raise InputError(f"{path} is or holds the {what}: {_ANOTHER}")
    if not force:
        raise InputError(f"{path} exists: {CURE}")
    if not os.access(place.parent, os.W_OK | os.X_OK) or place.is_mount():
        raise InputError(f"cannot move {path} away to replace it: no permission, {_ANOTHER}")


def check_files(path: Path, names: Iterable[str], *, force: bool = False) -> None:
    """Refuses a folder that cannot be written into, and names in it that are taken, but by `force`.

    What is taken is replaced where it is ours and unchanged, and else kept under another name.
    """
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
    if taken and not force:
        raise InputError(f"{path / taken[0]} exists: {CURE}")


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


@contextmanager
def claimed(path: Path, *, wait: bool = False) -> Iterator[Path | None]:
    """Keeps other processes from the same output; folders above it are made, and go on an error.

    Yields the hidden folder beside it, whose lock the system lets go of when the process ends,
    however it ends; None beside a folder that can only be written into.

    Raises:
        InputError: another process has it, unless to `wait` for that; or it is an address.
    """
    _check_local(path)
    place = real(path)
    if place.is_dir() and not os.access(place.parent, os.W_OK):
        yield None
        return
    with made_parent(place), work_folder(place, wait=wait) as work:
        yield work


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


def _check_local(path: Path) -> None:
    """Refuses an address, which the command line would have given a mirror."""
    if is_address(path):
        raise InputError(
            f"{address_of(path)}: an output lies on this machine: make it here, then send it"
        )


def _place(path: Path) -> Path:
    """Where an output will be: of links those above it are followed, but not itself."""
    _check_local(path)
    return real(path.parent) / path.name if path.name not in ("", "..") else real(path)


def _touching(place: Path, inputs: Iterable[object], *, into: Path | None = None) -> str:
    """How an output and an input lie to each other, where they touch.

    What a command adds to, `into`, it may read as well: that protects none of its parts.
    """
    of_command = command_inputs()
    for source in (*inputs_of(*inputs), *of_command):
        leads_to = Path(os.path.realpath(source))
        if not leads_to.exists():
            continue
        if _is_in(leads_to, place):
            return f"is or holds the input {source}"
        adds = into is not None and source in of_command and _is_in(into, leads_to)
        if not adds and _is_in(place, leads_to):
            return f"is part of the input {source}"
    return ""


def _is_in(inner: Path, outer: Path) -> bool:
    """Whether one is, or lies in, another; by what they are, not by what they are called."""
    for folder in (inner, *inner.parents):
        with suppress(OSError, ValueError):
            if folder.samefile(outer):
                return True
    return False


def _put(
    made: Path, path: Path, place: Path, work: Path, *,
    force: bool, inputs: Iterable[object] = (), into: Path | None = None,
) -> None:  # fmt: skip
    """Puts what was made in its place; where that cannot be, it is kept beside."""
    old = None
    try:
        if _place(path) != place:
            raise InputError(f"{path} now points elsewhere, to {_place(path)}")
        check_output(path, force=force)
        if made.is_file() and is_ours(place) and not _touching(place, inputs, into=into):
            made.replace(place)
            return
        old = _out_of_the_way(place, work, inputs, into=into)
        link_new(made, place)
    except BaseException as error:
        if old is not None and not os.path.lexists(place):
            old.rename(place)
        if not isinstance(error, InputError | FileExistsError):
            raise
        why = str(error) if isinstance(error, InputError) else f"{path} appeared meanwhile"
        names = (f"{place.stem}.finished{n or ''}{place.suffix}" for n in count())
        free = next(path for path in map(place.with_name, names) if not os.path.lexists(path))
        made.rename(free)
        raise InputError(f"{why} (the finished output is in {free})") from error
    _remove(old, place, work)


def _make_room(folder: Path, name: str, manifest: OutputManifest) -> None:
    """Keeps under another name what is in the way of a file in a folder, and is not ours."""
    for above in [folder / part for part in Path(name).parents][-2::-1]:
        if os.path.lexists(above) and (above.is_symlink() or not above.is_dir()):
            move_aside(above, above, "is in the way of a folder")
    place = folder / name
    why = "" if manifest.lists(folder, name) else _FOREIGN
    why = _touching(place, (), into=folder) or why
    if why and os.path.lexists(place):
        move_aside(place, place, why)


def _out_of_the_way(
    place: Path, work: Path, inputs: Iterable[object], *, into: Path | None = None
) -> Path | None:
    """Renames what stands at a place: into the work folder what may be removed, else aside."""
    if not os.path.lexists(place):
        return None
    why = _touching(place, inputs, into=into)
    if place.is_symlink() or not place.is_dir():
        why = why or ("is a link" if place.is_symlink() else _FOREIGN)
    if why:
        return move_aside(place, place, why)
    rename_away(place, work / REPLACED)
    return work / REPLACED


def _remove(old: Path | None, place: Path, work: Path) -> None:
    """Removes a folder that was replaced, if all in it is ours; else it is kept beside its place.

    What comes into it meanwhile is kept, too.
    """
    if old != work / REPLACED:
        return
    ours = []
    for name, is_ours_too in survey(old):
        if not is_ours_too:
            move_aside(old, place, f"holds {quoted(name)}, {_HELD}")
            return
        ours.append(name)
    doomed = old.rename(work / "old")
    for name in ours:
        with suppress(OSError):
            (doomed / name).unlink()
    for parent, _, _ in os.walk(doomed, topdown=False):
        with suppress(OSError):  # somebody's file is in it
            Path(parent).rmdir()
    if os.path.lexists(doomed):
        move_aside(doomed, place, "was added to while it was replaced")
