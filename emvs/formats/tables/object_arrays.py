"""The plain values in an array of Python objects that NumPy pickled, read without running anything.

Unpickling runs what a file says. Here Python's own unpickler is left with the opcodes that build
lists, mappings, texts and numbers; NumPy's constructors of arrays are stood in for by a class that
keeps what they are given, and every other name is refused.
"""

from __future__ import annotations

import io
import pickle
import struct
from typing import Any, ClassVar

from eventsweep.emvs.errors import InputError, quoted, said

_ARRAY = {"numpy.core.multiarray _reconstruct", "numpy._core.multiarray _reconstruct"}
_ENCODE = "_codecs encode"  # how protocol 2 writes bytes
_NAMES = _ARRAY | {"numpy ndarray", "numpy dtype", _ENCODE}
# Of protocols 2 to 4. Left out: what reserves or holds more than the file (byte arrays, long
# numbers), makes objects of classes, or asks Python's registry.
_OPCODES = b"".join([
    pickle.PROTO, pickle.FRAME, pickle.STOP, pickle.MARK, pickle.GLOBAL, pickle.STACK_GLOBAL,
    pickle.REDUCE, pickle.BUILD, pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE, pickle.BININT,
    pickle.BININT1, pickle.BININT2, pickle.LONG1, pickle.BINFLOAT, pickle.BINBYTES,
    pickle.SHORT_BINBYTES, pickle.BINUNICODE, pickle.SHORT_BINUNICODE, pickle.EMPTY_TUPLE,
    pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3, pickle.EMPTY_LIST, pickle.APPEND,
    pickle.APPENDS, pickle.EMPTY_DICT, pickle.SETITEM, pickle.SETITEMS, pickle.BINPUT,
    pickle.LONG_BINPUT, pickle.MEMOIZE, pickle.BINGET, pickle.LONG_BINGET,
])  # fmt: skip
_FAULTS = (
    pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError, AttributeError,
    struct.error, MemoryError,
)  # fmt: skip


def object_values(data: bytes, where: str) -> Any:
    """The value of a pickled array of one object.

    Args:
        data: what follows the header of the npy file.
        where: file and array, for the error's sake.

    Returns:
        Of mappings, lists, tuples, texts, bytes, numbers, booleans and None.

    Raises:
        InputError: damage, anything else in it, or an array of more than one object.
    """
    try:
        array = _Unpickler(io.BytesIO(data)).load()
        items = array.state[4]
        if not isinstance(array, _Named) or array.name not in _ARRAY or len(items) != 1:
            raise ValueError("no array of one object")
        return items[0]
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    except _FAULTS as error:
        raise InputError(
            f"{where}: cannot be read as Python's plain values ({said(error)}); damaged, "
            "download it again"
        ) from error


class _Named:
    """What a name stands for, or what calling it would give; nothing is imported or called."""

    __slots__ = ("name", "state")

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, *given: Any) -> Any:
        return given[0].encode("latin-1") if self.name == _ENCODE else _Named(self.name)

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Mapping(dict[Any, Any]):
    """One without keys that take long to hash."""

    __slots__ = ()

    def __setitem__(self, key: Any, value: Any) -> None:
        if not isinstance(key, str | int | float):
            raise TypeError("a mapping whose keys are neither texts nor numbers")
        super().__setitem__(key, value)


def _put_mapping(unpickler: Any) -> None:
    unpickler.append(_Mapping())


# The one in Python: the compiled one cannot be left without opcodes, and one of them makes it
# reserve 64 GB.
class _Unpickler(pickle._Unpickler):
    dispatch: ClassVar = {code: pickle._Unpickler.dispatch[code] for code in _OPCODES} | {
        pickle.EMPTY_DICT[0]: _put_mapping
    }

    def find_class(self, module: str, name: str) -> Any:
        """A stand-in for what may be named."""
        full = f"{module} {name}"
        if full not in _NAMES:
            raise InputError(
                f"loads plain values only, but the file refers to {quoted(full)}: do not trust it"
            )
        return _Named(full)
