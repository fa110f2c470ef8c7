"""The plain values in an array of Python objects that NumPy pickled, read without unpickling.

Unpickling runs what a file says. Here its opcodes (Python's `pickletools`) only build lists,
mappings, texts and numbers; what calls anything but NumPy's own constructors of arrays, which are
not called either, is refused.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from eventsweep.emvs.errors import InputError, quoted, said

_ARRAY = {"numpy.core.multiarray _reconstruct", "numpy._core.multiarray _reconstruct"}
_NAMES = _ARRAY | {"numpy ndarray", "numpy dtype"}
_MARK = object()
_MOST_DIGITS = 16
_FAULTS = (ValueError, IndexError, KeyError, TypeError, AttributeError, struct.error, MemoryError)


class _Named:
    """What a name stands for, or what calling it would give; nothing is imported or called."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.state: Any = None


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
        array = _Machine(data).run()
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


class _Machine:
    """A stack, and what a pickle's opcodes do to it."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}

    def run(self) -> Any:
        """Follows the opcodes to the last one."""
        steps, data, stack = self._table(), self._data, self._stack
        while (code := data[self._at]) != 0x2E:  # STOP
            self._at += 1
            step = steps.get(code)
            if step is None:
                raise ValueError(f"opcode {code:#04x} at byte {self._at - 1}")
            step()
        return stack.pop()

    def _table(self) -> dict[int, Callable[[], None]]:
        stack, put = self._stack, self._stack.append
        simple: dict[str, Callable[[], None]] = {
            "(": lambda: put(_MARK), "0": lambda: self._drop(), "2": lambda: put(stack[-1]),
            "N": lambda: put(None), "\x88": lambda: put(True), "\x89": lambda: put(False),
            "]": lambda: put([]), "}": lambda: put({}), ")": lambda: put(()),
            "\x80": lambda: self._skip(1), "\x95": lambda: self._skip(8),
            "I": lambda: put(self._whole_line()), "L": lambda: put(int(self._line().rstrip("L"))),
            "F": lambda: put(float(self._line())), "G": lambda: put(self._one(">d")),
            "J": lambda: put(self._one("<i")), "K": lambda: put(self._one("<B")),
            "M": lambda: put(self._one("<H")), "\x8a": lambda: put(self._long("<B")),
            "\x8b": lambda: put(self._long("<i")),
            "X": lambda: put(self._bytes("<I").decode("utf-8", "surrogatepass")),
            "\x8c": lambda: put(self._bytes("<B").decode("utf-8", "surrogatepass")),
            "\x8d": lambda: put(self._bytes("<Q").decode("utf-8", "surrogatepass")),
            "B": lambda: put(self._bytes("<I")), "C": lambda: put(self._bytes("<B")),
            "U": lambda: put(self._bytes("<B").decode("latin-1")),
            "T": lambda: put(self._bytes("<i").decode("latin-1")),
            "V": lambda: put(self._line()),
            "l": lambda: put(self._marked()), "t": lambda: put(tuple(self._marked())),
            "d": lambda: put(self._pairs(self._marked(), {})),
            "\x85": lambda: self._tuple(1), "\x86": lambda: self._tuple(2),
            "\x87": lambda: self._tuple(3),
            "a": lambda: self._append([stack.pop()]), "e": lambda: self._append(self._marked()),
            "s": lambda: self._set([stack.pop(-2), stack.pop()]),
            "u": lambda: self._set(self._marked()),
            "q": lambda: self._keep(self._one("<B")), "r": lambda: self._keep(self._one("<I")),
            "p": lambda: self._keep(int(self._line())),
            "\x94": lambda: self._keep(len(self._memo)),
            "h": lambda: put(self._memo[self._one("<B")]),
            "j": lambda: put(self._memo[self._one("<I")]),
            "g": lambda: put(self._memo[int(self._line())]),
            "c": lambda: put(self._named(self._line(), self._line())),
            "\x93": lambda: put(self._named(stack.pop(-2), stack.pop())),
            "R": self._call, "b": self._build,
        }  # fmt: skip
        return {ord(code): step for code, step in simple.items()}

    def _one(self, kind: str) -> Any:
        (value,) = struct.unpack_from(kind, self._data, self._at)
        self._at += struct.calcsize(kind)
        return value

    def _bytes(self, length: str) -> bytes:
        size = self._one(length)
        part = self._data[self._at : self._at + size]
        if size < 0 or len(part) != size:
            raise ValueError(f"{size} bytes declared, {len(part)} present")
        self._at += size
        return part

    def _long(self, length: str) -> int:
        digits = self._bytes(length)
        if len(digits) > _MOST_DIGITS:
            raise ValueError(f"a number of {len(digits)} bytes")
        return int.from_bytes(digits, "little", signed=True)

    def _line(self) -> str:
        end = self._data.index(b"\n", self._at)
        line = self._data[self._at : end].decode("ascii")
        self._at = end + 1
        return line

    def _whole_line(self) -> int | bool:
        line = self._line()
        return line == "01" if line in ("00", "01") else int(line)

    def _skip(self, count: int) -> None:
        self._at += count

    def _drop(self) -> None:
        self._stack.pop()

    def _marked(self) -> list[Any]:
        """Takes what lies above the topmost mark, and the mark."""
        k = len(self._stack) - 1
        while self._stack[k] is not _MARK:
            k -= 1
            if k < 0:
                raise ValueError("no mark")
        items = self._stack[k + 1 :]
        del self._stack[k:]
        return items

    def _tuple(self, count: int) -> None:
        if len(self._stack) < count:
            raise ValueError("too few values for a tuple")
        items = tuple(self._stack[-count:])
        del self._stack[-count:]
        self._stack.append(items)

    def _append(self, items: list[Any]) -> None:
        if not isinstance(self._stack[-1], list):
            raise TypeError("values appended to something that is not a list")
        self._stack[-1].extend(items)

    def _set(self, items: list[Any]) -> None:
        if not isinstance(self._stack[-1], dict):
            raise TypeError("values set in something that is not a mapping")
        self._pairs(items, self._stack[-1])

    @staticmethod
    def _pairs(items: list[Any], into: dict[Any, Any]) -> dict[Any, Any]:
        if len(items) % 2 or not all(isinstance(key, str | int | float) for key in items[::2]):
            raise TypeError("a mapping whose keys are neither texts nor numbers")
        into.update(zip(items[::2], items[1::2], strict=True))
        return into

    def _keep(self, place: int) -> None:
        self._memo[place] = self._stack[-1]

    @staticmethod
    def _named(module: Any, name: Any) -> _Named:
        full = f"{module} {name}"
        if full not in _NAMES:
            raise InputError(
                f"loads plain values only, but the file refers to {quoted(full)}: do not trust it"
            )
        return _Named(full)

    def _call(self) -> None:
        self._stack.pop()
        called = self._stack.pop()
        if not isinstance(called, _Named):
            raise TypeError("a call of something that is not a name")
        self._stack.append(_Named(called.name))

    def _build(self) -> None:
        state = self._stack.pop()
        if not isinstance(self._stack[-1], _Named):
            raise TypeError("a state for something that is not an array")
        self._stack[-1].state = state
