"""As much of the flatbuffers wire format as AEDAT4 needs, with every offset checked."""

from __future__ import annotations

import struct

from emvs.errors import InputError


class FlatbufferTable:
    """The root table of a size-prefixed buffer.

    Raises:
        InputError: a buffer of another kind, or one whose offsets lead out of it.
    """

    def __init__(self, data: bytes | memoryview, kind: bytes, where: str) -> None:
        self._data, self._where = memoryview(data), where
        if len(data) < 12 or bytes(self._data[8:12]) != kind:
            raise InputError(f"{where}: no {kind.decode()} buffer; the file is damaged")
        size = self._unpack("<I", 0)
        if size + 4 > len(data):
            raise InputError(
                f"{where}: {size} bytes declared, {len(data) - 4} there; the file is damaged"
            )
        self._at = 4 + self._unpack("<I", 4)
        self._vtable = self._at - self._unpack("<i", self._at)
        self._fields = (self._unpack("<H", self._vtable) - 4) // 2

    def number(self, field: int, code: str, default: int) -> int:
        """A scalar field, by its `struct` code."""
        at = self._place(field)
        return default if at is None else self._unpack("<" + code, at)

    def vector(self, field: int, itemsize: int) -> memoryview:
        """The bytes of a vector (or text) field; empty where the field is not there."""
        at = self._place(field)
        if at is None:
            return self._data[:0]
        at += self._unpack("<I", at)
        count = self._unpack("<I", at)
        if at + 4 + count * itemsize > len(self._data):
            raise InputError(
                f"{self._where}: {count} items of {itemsize} bytes declared, "
                f"{len(self._data) - at - 4} bytes there; the file is damaged"
            )
        return self._data[at + 4 : at + 4 + count * itemsize]

    def _place(self, field: int) -> int | None:
        if field >= self._fields:
            return None
        offset = self._unpack("<H", self._vtable + 4 + 2 * field)
        return self._at + offset if offset else None

    def _unpack(self, code: str, at: int) -> int:
        if not 0 <= at <= len(self._data) - struct.calcsize(code):
            raise InputError(f"{self._where}: an offset leads out of the buffer; damaged")
        return int(struct.unpack_from(code, self._data, at)[0])


def one_vector(kind: bytes, count: int, items: bytes) -> bytes:
    """A size-prefixed buffer whose root table holds one vector and nothing else."""
    root = struct.pack("<I4sHHHHiII", 16, kind, 0, 6, 8, 4, 6, 4, count)
    return struct.pack("<I", len(root) + len(items)) + root + items
