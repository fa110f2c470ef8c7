"""The one error that a user can cause, and what libraries raise for damaged files."""

import difflib
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from typing import TypeVar

Value = TypeVar("Value")


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
"""What `numpy.load` raises for files that are damaged or declare the impossible."""
