"""The one error that a user can cause, what libraries raise, and how values are said."""

from __future__ import annotations

import difflib
import os
import re
import textwrap
import tokenize
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from numbers import Real
from typing import TypeVar

Value = TypeVar("Value")
# What `numpy.load` raises for files that are damaged or declare the impossible
DAMAGED_NPY: tuple[type[Exception], ...] = (
    OSError,
    ValueError,
    EOFError,
    SyntaxError,
    MemoryError,
    NotImplementedError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
)
_SHOWN_WHOLE = 12
_COMMANDS = re.compile(
    "[\0-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
_MOST_OFFERED = 64


class InputError(ValueError):
    """Input that cannot be used: what came, what is needed, how to cure it, in one line.

    Attributes:
        parameter: what the line begins with, such as `map.start_s`, where that is a parameter; a
            command line shows its flag instead.
    """

    def __init__(self, *words: object, parameter: str = "") -> None:
        super().__init__(*words)
        self.parameter = parameter


class ByName(dict[str, Value]):
    """A table of things, `what`, by name; to ask for a name not in it is the user's mistake."""

    def __init__(self, what: str, values: Mapping[str, Value]) -> None:
        super().__init__(values)
        self.what = what

    def __repr__(self) -> str:
        if len(self) <= _SHOWN_WHOLE:
            return super().__repr__()
        return textwrap.fill(f"{len(self)} {self.what}s: {', '.join(self)}", 100)

    def __missing__(self, name: str) -> Value:
        close = difflib.get_close_matches(str(name), self, n=1)
        known = f"did you mean {close[0]}?" if close else offer(self, "there is none")
        raise InputError(f"no {self.what} {name!r}: {known}")


def offer(names: Iterable[str], instead: str) -> str:
    """`choose from A, B` for an error about a name; `instead` where there are none to choose."""
    there = [name if name.isprintable() else ascii(name) for name in map(str, names)]
    more = [f"and {len(there) - _MOST_OFFERED} more"] if len(there) > _MOST_OFFERED else []
    return f"choose from {', '.join(there[:_MOST_OFFERED] + more)}" if there else instead


def shown(value: object, most: int = 80) -> str:
    """A value as an error may show it: in one line of bounded length."""
    text = " ".join(repr(value).split())
    return text if len(text) <= most else f"{text[:most]}..."


def significant(value: float, digits: int = 4) -> str:
    """A value to so many digits, but never with fewer digits than it has before the point."""
    return f"{value:,.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:.{digits}g}"


def check_type(
    name: str, value: object, kinds: type | tuple[type, ...], needs: str | None = None
) -> None:
    """Refuses a value of none of these types; `needs` says in words what is needed."""
    if not isinstance(value, kinds):
        every = kinds if isinstance(kinds, tuple) else (kinds,)
        needs = needs or " or ".join(kind.__name__ for kind in every)
        raise InputError(f"{name} is {shown(value)}: needs {needs}")


def check_path(name: str, value: object) -> None:
    """Raises unless it is a path."""
    check_type(name, value, (str, os.PathLike), "a path")


def check_whole(name: str, value: object) -> None:
    """Raises unless it is a whole number."""
    if not isinstance(value, Real) or value % 1 != 0:
        raise InputError(f"{name} is {shown(value)}: needs a whole number")


def check_array(name: str, value: object, needs: str, kinds: str = "biuf") -> None:
    """Raises unless it is an array of numbers; does not load numpy.

    `kinds` are NumPy's `dtype.kind`; `needs` says in words what is needed.
    """
    kind = getattr(getattr(value, "dtype", None), "kind", "none")
    if kind not in kinds or getattr(value, "shape", ()) == ():
        raise InputError(f"{name} is {shown(value)}: needs {needs}")


@contextmanager
def located(where: object) -> Iterator[None]:
    """Puts a place, such as a file or a key, in front of what is refused within."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


@contextmanager
def refused(what: str, *faults: type[Exception], cure: str = "") -> Iterator[None]:
    """Makes one line of what a library raises within: what is wrong, its own words, the cure."""
    try:
        yield
    except InputError:
        raise
    except faults as error:
        raise InputError(f"{what} ({said(error)}){cure}") from error


def repeated(names: Iterable[str]) -> str | None:
    """The first name that is there twice; None where each is there once."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def heed_interrupt(error: BaseException) -> None:
    """Raises the `KeyboardInterrupt` that a library made another error of, as imports do."""
    behind: BaseException | None = error
    while behind is not None:
        behind = behind.__cause__ or behind.__context__
        if isinstance(behind, KeyboardInterrupt):
            raise KeyboardInterrupt from error


def said(error: BaseException, most: int = 200) -> str:
    """What a library says of damage, in one line of bounded length; it may quote the file."""
    return printable(str(error), most) or type(error).__name__


def printable(text: str, most: int = 200) -> str:
    """A text of somebody's in one line of bounded length, without what a terminal would obey."""
    line = " ".join(text.split())[:most]
    return line if line.isprintable() else ascii(line)


def visible(text: str) -> str:
    """A text whose characters that command a terminal stand as JSON writes them.

    These are controls, but for line ends and tabs, marks that turn the direction of writing, and
    halves of surrogate pairs, which no terminal can show.
    """
    return _COMMANDS.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def one_line(text: str) -> str:
    """A text as `visible` has it whose line ends, which data may hold, stand as JSON's, too."""
    return visible(text).replace("\n", "\\n")


def quoted(*words: object) -> str:
    """Words of a file as an error may show them: printable, the first few, of bounded length."""
    shown = [word if len(word) < 48 else f"{word[:40]}..." for word in map(str, words[:8])]
    more = [f"and {len(words) - 8} more"] if len(words) > 8 else []
    return ", ".join([word if word.isprintable() else ascii(word) for word in shown] + more)
