"""Events as arrays in a MATLAB file of version 5 (`save` without `-v7.3`, which writes HDF5).

An array is named, as a member of an npz archive is: `events[0]` is the first column of one,
`x` a vector. MATLAB stores whole doubles as integers, column after column. Layout after MathWorks'
"MAT-File Format".
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, NamedTuple

import numpy as np

from eventsweep.emvs.errors import refused
from eventsweep.emvs.formats.prophesee import opened
from eventsweep.emvs.formats.tables.npz import Array, ArrayReader, check_size

HEAD_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"}
_NUMBERS |= {12: "i8", 13: "u8"}
_CLASSES = range(6, 16)  # double to uint64: no cells, structures, texts or sparse arrays
_MOST_ARRAYS = 1 << 10
_MOST_WORD = 1 << 10


class _Tag(NamedTuple):
    """What stands before data: its type, its size, bytes, and how many follow to the next."""

    kind: int
    size: int
    padded: int


class MatReader(ArrayReader):
    """A MATLAB file: one stream, `events`."""

    format = "mat"

    def _declared(self) -> dict[str, Array]:
        found: dict[str, Array] = {}
        self._elements: dict[str, int] = {}
        size, at = self.path.stat().st_size, HEAD_BYTES
        with opened(self.path) as file:
            file.seek(124)
            self._order = ">" if file.read(4)[2:] == b"MI" else "<"
        for _ in range(_MOST_ARRAYS):
            if at >= size:
                break
            with self._element(at) as (element, end):
                if end > size:
                    raise ValueError(f"an element of {end - at} bytes, {size - at} are present")
                array = self._array(element)
            if array is not None:
                found[array.name], self._elements[array.name] = array, at
            at = end
        return found

    def _array(self, element: IO[bytes]) -> Array | None:
        """Reads an array's head; None where it holds no plain numbers."""
        flags = self._words(element, "I", 2)
        shape = self._words(element, "i")
        name = self._word(element).rstrip(b"\0").decode("ascii")
        if not name.isidentifier():
            raise ValueError("an array without a name")
        if flags[0] & 0xFF not in _CLASSES or flags[0] & 0x800:  # 0x800: complex
            return None
        tag = self._tag(element)
        if tag.kind not in _NUMBERS:
            raise ValueError(f"numbers of type {tag.kind}")
        if len(shape) == 2 and (1 in shape or shape == (0, 0)):  # a vector, or MATLAB's `[]`
            shape = (max(shape) if min(shape) else 0,)
        kind = np.dtype(self._order + _NUMBERS[tag.kind])
        array = Array(name, shape, by_columns=True, kind=kind, head=element.tell())
        check_size(self.path, array, tag.size)
        return array

    @contextmanager
    def _element(self, at: int) -> Iterator[tuple[IO[bytes], int]]:
        """The content of the element at a byte, unpacked as it is read, and where the next is."""
        what, faults = "not a complete MATLAB file", (struct.error, ValueError, zlib.error, OSError)
        damage = refused(f"{self.path}: {what}", *faults, cure="; save it again")
        with damage, opened(self.path) as file:
            file.seek(at)
            kind, size = struct.unpack(f"{self._order}II", file.read(8))
            if kind not in (_MATRIX, _COMPRESSED):
                raise ValueError(f"an element of type {kind} at byte {at}")
            if kind == _MATRIX:
                yield file, at + 8 + size
            else:
                inside = io.BufferedReader(_Inflated(file, size))
                if self._tag(inside).kind != _MATRIX:
                    raise ValueError("no array in a compressed element")
                yield inside, at + 8 + size

    @contextmanager
    def _opened(self, array: Array, at: int, *, whole: bool) -> Iterator[IO[bytes]]:
        del whole
        with self._element(self._elements[array.name]) as (element, _):
            element.seek(array.head + at)
            yield element

    def _tag(self, element: IO[bytes]) -> _Tag:
        """Reads a tag; one whose upper half is set holds up to 4 bytes, which follow."""
        (word,) = struct.unpack(f"{self._order}I", element.read(4))
        if word >> 16:
            return _Tag(word & 0xFFFF, min(word >> 16, 4), 4)
        (size,) = struct.unpack(f"{self._order}I", element.read(4))
        return _Tag(word, size, size + -size % 8)

    def _word(self, element: IO[bytes]) -> bytes:
        tag = self._tag(element)
        if tag.size > _MOST_WORD:
            raise ValueError(f"{tag.size} bytes in an array's head")
        return element.read(tag.padded)[: tag.size]

    def _words(self, element: IO[bytes], code: str, count: int = 0) -> tuple[Any, ...]:
        word = self._word(element)
        return struct.unpack(f"{self._order}{count or len(word) // 4}{code}", word)


class _Inflated(io.RawIOBase):
    """Unpacks a stretch of a file as it is read; goes forward only."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file, self._rest, self._at = file, size, 0
        self._packed = zlib.decompressobj()

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Fills up to the buffer; 0 at the end."""
        data = b""
        while not (data or self._packed.eof):
            packed = self._packed.unconsumed_tail or self._file.read(min(self._rest, 1 << 16))
            self._rest -= 0 if self._packed.unconsumed_tail else len(packed)
            if not packed:
                raise ValueError("its compressed data is cut off")
            data = self._packed.decompress(packed, len(buffer))
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Passes over what lies between."""
        if whence == 1:
            offset += self._at
        if whence == 2 or offset < self._at:
            raise ValueError("goes forward only")
        while self._at < offset and self.readinto(bytearray(min(offset - self._at, 1 << 16))):
            pass
        return self._at

    def tell(self) -> int:
        return self._at
