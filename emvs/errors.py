"""The one error that a user can cause, and what libraries raise for damaged files."""

import tokenize
import zipfile
import zlib


class InputError(ValueError):
    """Input that cannot be used: what came, what is needed, how to cure it, in one line."""


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
