"""Reading what damaged files declare in bounded memory: both sizes to read and sizes unpacked."""

from __future__ import annotations

import bz2
import io
import sys
from pathlib import PosixPath
from typing import Any

import lz4.frame

from emvs.errors import InputError
from emvs.io.events.wording import said

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MOST_BYTES = 1 << 28
"""What one compressed packet or chunk may unpack to."""
_DECOMPRESSORS = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}
_STEP = 1 << 24
_FAULTS = (OSError, RuntimeError, ValueError, EOFError, MemoryError, zstd.ZstdError)


def unpacked(data: bytes | memoryview, compression: str, where: str) -> bytes:
    """Unpacks one frame of `bz2`, `lz4` or `zstd`.

    Raises:
        InputError: damage, or more than `MOST_BYTES`; named after `where` (file and place).
    """
    frame: Any = _DECOMPRESSORS[compression]()
    parts: list[bytes] = []
    try:
        # LZ4 reserves the whole length that it is allowed, so that is a guess, not the bound.
        guess = min(8 * len(data) + 1024, MOST_BYTES)
        parts.append(frame.decompress(data, max_length=guess))
        while not (frame.eof or frame.needs_input or sum(map(len, parts)) >= MOST_BYTES):
            parts.append(frame.decompress(b"", max_length=_STEP))
    except _FAULTS as error:
        raise InputError(
            f"{where}: cannot be decompressed ({said(error)}); damaged, fetch it again"
        ) from error
    if not frame.eof:
        raise InputError(
            f"{where}: its compressed frame does not end, or holds more than {MOST_BYTES} "
            "bytes; the file is damaged, fetch it again"
        )
    return b"".join(parts)


class BoundedPath(PosixPath):
    """A path whose file never reserves more than it holds, whatever it is asked to read."""

    def open(self, *args: Any, **kwargs: Any) -> Any:
        """Opens the file; read-only and binary as `BoundedFile`."""
        if args != ("rb",) or kwargs:
            return super().open(*args, **kwargs)
        return BoundedFile(io.FileIO(self, "rb"), self.stat().st_size)


class BoundedFile(io.BufferedReader):
    """A file of a known size, bytes."""

    def __init__(self, raw: io.FileIO, size: int) -> None:
        super().__init__(raw)
        self._size = size

    def read(self, size: int | None = -1, /) -> bytes:
        """Reads up to `size` bytes; reserves no more than the file's size for them."""
        return super().read(-1 if size is None else min(size, self._size))
