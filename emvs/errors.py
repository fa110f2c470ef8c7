"""The one error that a user can cause, what libraries raise for damaged files, and quoting."""

from __future__ import annotations

import difflib
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
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


class InputError(ValueError):
    """Input that cannot be used: what came, what is needed, how to cure it, in one line."""


class ByName(dict[str, Value]):
    """A table whose keys are names; asking for one that is not there is the user's mistake.

    Attributes:
        what: what the names are of, in one word.
    """

    def __init__(self, what: str, values: Mapping[str, Value]) -> None:
        super().__init__(values)
        self.what = what

    def __missing__(self, name: str) -> Value:
        close = difflib.get_close_matches(str(name), self, n=1)
        known = f"did you mean {close[0]}?" if close else f"there are {', '.join(self)}"
        raise InputError(f"no {self.what} {name!r}: {known}")


def said(error: BaseException, most: int = 200) -> str:
    """What a library says of damage, in one line of bounded length; it may quote the file."""
    line = (" ".join(str(error).split()) or type(error).__name__)[:most]
    return line if line.isprintable() else ascii(line)


def quoted(*words: object) -> str:
    """Words of a file as an error may show them: printable, the first few, of bounded length."""
    shown = [word if len(word) < 48 else f"{word[:40]}..." for word in map(str, words[:8])]
    more = [f"and {len(words) - 8} more"] if len(words) > 8 else []
    return ", ".join([word if word.isprintable() else ascii(word) for word in shown] + more)
