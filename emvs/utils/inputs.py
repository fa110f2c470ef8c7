"""Small files that others wrote, read without trust: regular files only, of bounded size and depth.

A pipe would hang whoever opens it, a device never ends, and a text can be nested more deeply than
Python's stack.
"""

from __future__ import annotations

import codecs
import json
import os
import re
import stat
import tomllib
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from eventsweep.emvs.errors import InputError, quoted

if TYPE_CHECKING:
    from numpy.lib.npyio import NpzFile
    from numpy.typing import NDArray

SETTINGS_BYTES = 1 << 18
"""More than any calibration, rig or table of settings."""
TABLE_BYTES = 1 << 28
"""More than any list of poses, results or files."""
_LFS = b"version https://git-lfs.github.com/spec/"
_WEB_PAGE = re.compile(rb"(\xef\xbb\xbf)?\s*<(!doctype\s+html|html[\s>])", re.IGNORECASE)
_HEAD_BYTES = 64
NPZ_BYTES = 1 << 30
"""More than the arrays of any depth map or slice take, unpacked."""
_MOST_VALUES, _MOST_DEPTH = 1_000_000, 64


_OUTPUTS = ("out", "picture", "junit", "markdown")
"""Arguments and fields that name what is written."""
_NOTHING: tuple[int, tuple[Path, ...]] = (0, ())
_OF_COMMAND = ContextVar("_OF_COMMAND", default=_NOTHING)
"""How many formats were known that name others, and what the command is known to read."""


def inputs_of(*values: object) -> tuple[Path, ...]:
    """Every file and folder that values name, however deep in groups of settings.

    A text counts if it names a file, also as `NAME=FILE` or `FILE:FUNCTION`. Of a TOML file, of a
    recording with a descriptor, and of what `names_others` tells, all that is named in it counts,
    and what that names in turn.
    """
    found, opened = dict.fromkeys(_paths(values)), set[str]()
    new = list(found)
    for path in new:  # which grows
        named = [other for other in _named_in(path, opened) if other not in found]
        found |= dict.fromkeys(named)
        new += named
    return tuple(found)


def names_others(suffixes: Iterable[str], named: Callable[[Path], Iterable[Path]]) -> None:
    """Tells what finds the files that one of a format names, such as the textures of a model."""
    _NAMED.update(dict.fromkeys(suffixes, named))


@contextmanager
def command() -> Iterator[None]:
    """The extent of a command, for which `also_read` holds; outside of any it does for good."""
    before = _OF_COMMAND.set(_NOTHING)
    try:
        yield
    finally:
        _OF_COMMAND.reset(before)


def also_read(*values: object) -> None:
    """Says what is read: no output removes an input that these values name."""
    _OF_COMMAND.set((len(_NAMED), inputs_of(*_OF_COMMAND.get()[1], *values)))


def command_inputs() -> tuple[Path, ...]:
    """What the command that runs reads, and by now is known to be named in that."""
    formats, _ = _OF_COMMAND.get()
    if formats != len(_NAMED):  # the reader of models may be imported by the command itself
        also_read()
    return _OF_COMMAND.get()[1]


def _paths(value: object) -> Iterator[Path]:
    if isinstance(value, Path):
        yield value
    elif isinstance(value, str):
        # Only after a name is a folder meant for sure: a scene may be called like one.
        for text, is_place in zip(_forms(value), (False, True, False), strict=True):
            yield from [Path(text)] if _is_input(text, is_place=is_place) else ()
    elif isinstance(value, Mapping):
        yield from _paths([item for name, item in value.items() if name not in _OUTPUTS])
    elif isinstance(value, list | tuple | set | frozenset):
        for item in value:
            yield from _paths(item)
    elif is_dataclass(value) or isinstance(value, BaseModel):
        yield from _paths(vars(value))


def _forms(text: str) -> tuple[str, ...]:
    """Where a text may hold a path: all of it, `NAME=FILE`, `FILE:FUNCTION`."""
    return text, text.partition("=")[2], text.rpartition(":")[0]


def _is_input(text: str, *, is_place: bool) -> bool:
    # Unlike those of `Path`, these functions bear a text that is no file name.
    is_file = os.path.isfile(text)  # noqa: PTH113
    return is_file or ((is_place or os.sep in text) and os.path.exists(text))  # noqa: PTH110


def _named_in(path: Path, opened: set[str]) -> Iterator[Path]:
    """What a file names; a damaged one names nothing, and files that name each other end here."""
    with suppress(OSError, ValueError):
        file = path / "recording.toml" if path.is_dir() else path
        named = _NAMED.get(file.suffix.lower())
        # A path that leads nowhere may be resolved to the place of a file.
        if named is None or not file.is_file() or (place := os.path.realpath(file)) in opened:
            return
        opened.add(place)
        yield from named(file)


def _named_in_toml(file: Path) -> Iterator[Path]:
    """What a TOML file names, from its own folder or from the working directory."""
    for text in _texts(parse_toml(read_text(file, SETTINGS_BYTES))):
        for form in _forms(text):
            yield from (Path(form), file.parent / form) if form.strip("./") else ()


_NAMED: dict[str, Callable[[Path], Iterable[Path]]] = {".toml": _named_in_toml}


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str) and "\0" not in content:
        yield content
    elif isinstance(content, dict | list):
        for value in content.values() if isinstance(content, dict) else content:
            yield from _texts(value)


def check_file(path: Path, most_bytes: int | None = None) -> None:
    """Refuses what cannot be read to its end, or only stands for a file; looks before it opens.

    Symbolic links are followed; of a file that is read piece by piece `most_bytes` is None.

    Raises:
        InputError: a pipe, a device, a socket, a folder or a file that the system makes up, as in
            `/proc`; a name with a NUL, or too large; a pointer of Git LFS, or a web page that was
            saved instead of a file.
        OSError: nothing there, or it cannot be looked at.
    """
    try:
        seen = Path(path).stat()
    except ValueError as error:
        raise InputError(
            f"{str(path)!r}: is not a valid file name ({error}); correct it"
        ) from error
    if (kind := _strange(seen)) is not None:
        raise InputError(f"{path}: is {kind}; needs a regular file")
    if most_bytes is not None and seen.st_size > most_bytes:
        raise InputError(f"{path}: {seen.st_size} bytes, at most {most_bytes} are read")
    with suppress(OSError):  # whoever reads it will say so
        _check_stands_for_itself(Path(path))


def _check_stands_for_itself(path: Path) -> None:
    """Refuses what is often stored in the place of a file, and is none of any format."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if head.startswith(_LFS):
        raise InputError(
            f"{path}: is a Git LFS pointer, not the file itself: fetch it with `git lfs pull`"
        )
    if _WEB_PAGE.match(head):
        raise InputError(
            f"{path}: is a web page, not a {path.suffix or 'data'} file: download the file itself"
        )


def _strange(seen: os.stat_result) -> str | None:
    """What something is that is not a regular file; None for one."""
    if stat.S_ISREG(seen.st_mode):
        return "made up by the system" if seen.st_dev in _made_up() else None
    kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return kinds.get(stat.S_IFMT(seen.st_mode), "a device")


@cache
def _made_up() -> frozenset[int]:
    """Where the system makes files up when they are read: of no size, and some without an end."""
    return frozenset(os.stat(at).st_dev for at in ("/proc", "/sys") if os.path.ismount(at))  # noqa: PTH116


def inside(folder: Path, name: str) -> Path:
    """The path of a file in a folder that others filled; for `check_file` or `read_text`.

    Args:
        folder: as its user names it: may itself be a link.
        name: below the folder.

    Raises:
        InputError: a link, or a name that leads elsewhere: with these, whoever filled the folder
            would choose which of the reader's files are read.
    """
    parts = Path(name).parts
    if not parts or Path(name).is_absolute() or ".." in parts or "\0" in name:
        raise InputError(f"{folder}: {quoted(name)} is not a file in this folder; correct it")
    path = folder
    for part in parts:
        path /= part
        if os.path.islink(path):  # noqa: PTH114 - `is_symlink` raises where a name is too long
            raise InputError(f"{path}: is a link; replace it by what it points to")
    return path


def file_in(path: Path, name: str) -> Path:
    """The file that a user names, or the one of that name inside of the folder that is named."""
    return inside(path, name) if Path(path).is_dir() else Path(path)


def read_text(path: Path, most_bytes: int, encoding: str = "utf-8") -> str:
    """The whole text of a file, as `check_file` allows; OSError or UnicodeDecodeError otherwise.

    A byte order mark is left out, lines end as Unix has it.
    """
    check_file(path, most_bytes)
    data = Path(path).read_bytes()
    text = data[mark_bytes(path, data) :].decode(encoding)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def mark_bytes(path: Path, head: bytes) -> int:
    """Length of the byte order mark that a text begins with: 3 of UTF-8, or 0.

    Raises:
        InputError: the mark of UTF-16 or UTF-32.
    """
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE, codecs.BOM_UTF32_BE)):
        raise InputError(f"{path}: is a text in UTF-16 or UTF-32; save it as UTF-8")
    return len(codecs.BOM_UTF8) if head.startswith(codecs.BOM_UTF8) else 0


def opened_npz(path: Path, most_bytes: int = NPZ_BYTES) -> NpzFile:
    """The arrays of an npz, to be closed: read one by one, and never as pickles.

    Raises:
        InputError: no regular file, or it unpacks to more than `most_bytes`: a file of a megabyte
            can hold a thousand.
        DAMAGED_NPY: what `numpy` and `zipfile` raise where it is no npz.
    """
    import numpy as np

    check_file(path)
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    if unpacked > most_bytes:
        raise InputError(f"{path}: unpacks to {unpacked} bytes, at most {most_bytes} are read")
    arrays: NpzFile = np.load(path, allow_pickle=False)
    return arrays


def opened_npy(path: Path) -> NDArray[Any]:
    """The array of an npy file, read when it is used: no larger than the file, never a pickle.

    Raises:
        InputError: no regular file.
        DAMAGED_NPY: what `numpy` raises where it is no npy.
    """
    import numpy as np

    check_file(path)
    array: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
    return array


def parse_json(text: str) -> Any:
    """The content of a JSON text; ValueError for none, deep nesting, half of a surrogate pair."""
    try:
        content = json.loads(text)
        _check_depth(content)
        if "\\ud" in text.lower():  # such a half cannot be written anywhere
            json.dumps(content, ensure_ascii=False).encode()
        return content
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text; ValueError where it is none, or too deep or long in numbers."""
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    _check_depth(content)
    return content


def _check_depth(content: Any) -> None:
    """Raises ValueError for what code that calls itself for every level could not go through.

    The parsers do not see to that: a key of TOML, `a.a.a`, nests without calls.
    """
    level: list[Any] = [[content]]
    depth = 0
    while level:
        depth += 1
        if depth > _MOST_DEPTH:
            raise ValueError("nested too deeply")
        groups = (one.values() if isinstance(one, dict) else one for one in level)
        level = [value for group in groups for value in group if isinstance(value, dict | list)]


def check_yaml(text: str) -> None:
    """Raises ValueError for a YAML text that stands for more values than any file of facts has.

    A few lines that name each other stand for more than memory holds, and a parser calls itself
    for every level. Each value counts as often as it is meant.
    """
    import yaml

    sizes: dict[str | None, int] = {}
    above: list[tuple[str | None, int]] = []
    count = 0
    loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    for event in yaml.parse(text, loader):
        if isinstance(event, yaml.CollectionStartEvent):
            above.append((event.anchor, count))
        elif isinstance(event, yaml.AliasEvent):
            count += sizes.get(event.anchor, 0)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = above.pop()
            sizes |= {anchor: count - before} if anchor else {}
        count += isinstance(event, yaml.NodeEvent)
        if count > _MOST_VALUES or len(above) > _MOST_DEPTH:
            raise ValueError(f"more than {_MOST_VALUES} values, or nested beyond {_MOST_DEPTH}")
