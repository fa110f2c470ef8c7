"""HDF5 as every store here uses it: one compression, faults told in one line, a safe full disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import h5py
import hdf5plugin
import numpy as np

from emvs.errors import InputError

# LZ4 writes ten times as fast as zstd for 1.3 bytes more per event.
COMPRESSION = {
    np.dtype(kind): hdf5plugin.Blosc(cname="lz4", clevel=5, shuffle=shuffle)
    for kind, shuffle in (
        (np.uint8, hdf5plugin.Blosc.BITSHUFFLE),
        (np.uint16, hdf5plugin.Blosc.SHUFFLE),
        (np.int64, hdf5plugin.Blosc.SHUFFLE),
        (np.float32, hdf5plugin.Blosc.SHUFFLE),
    )
}


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Opens a file for reading.

    Raises:
        InputError: a missing or truncated file, or a data set that is missing or damaged.
    """
    try:
        file = h5py.File(path, "r")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: not a whole HDF5 file ({error}); make it again") from error
    with file:
        try:
            yield file
        except (KeyError, OSError, RuntimeError, IndexError, TypeError, AttributeError) as error:
            raise InputError(f"{path}: damaged or of another layout ({error})") from error


class Sink:
    """What HDF5 writes into: a file that keeps its first fault for `check` and swallows the rest.

    HDF5 retries a failed write from every cache that it closes and can crash the process; so it
    never learns of the fault, and whoever writes must call `check`.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w+b", buffering=0)
        self._fault: OSError | None = None

    def check(self) -> None:
        """Raises the first fault, if there was one."""
        if self._fault is not None:
            raise self._fault

    def write(self, data: bytes) -> int:
        """Writes all of `data`, or remembers why that failed."""
        view = memoryview(data)
        end = self._file.tell() + len(view)
        try:
            while len(view):
                view = view[self._file.write(view) :]
        except OSError as error:
            self._fault = self._fault or error
            self._file.seek(end)
        return len(data)

    def read(self, size: int = -1) -> bytes:
        """Reads back; h5py takes an object with `read` and `seek` for a file."""
        return self._file.read(size)

    def readinto(self, buffer: memoryview) -> int:
        """Reads back; after a fault there may be less than HDF5 wrote, so zeros stand in."""
        count = self._file.readinto(buffer) or 0
        if self._fault is not None:
            buffer[count:] = bytes(len(buffer) - count)
            return len(buffer)
        return count

    def seek(self, offset: int, whence: int = 0) -> int:
        """Moves as files do."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Position, bytes."""
        return self._file.tell()

    def truncate(self, size: int | None = None) -> int:
        """Sets the length, unless the disk has already failed."""
        try:
            return self._file.truncate(size)
        except OSError as error:
            self._fault = self._fault or error
            return size or 0

    def flush(self) -> None:
        """Nothing is buffered here."""

    def close(self) -> None:
        """Closes the file."""
        self._file.close()


class Hdf5Writer:
    """A new HDF5 file: use it as a context or close it, and call `check` after each write.

    Attributes:
        file: the open file.
    """

    def __init__(self, path: Path) -> None:
        self._sink = Sink(path)
        self.file = h5py.File(self._sink, "w")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def check(self) -> None:
        """Raises what the disk said to the last writes."""
        self._sink.check()

    def close(self) -> None:
        """Closes the file; raises what the disk said."""
        self.file.close()
        self._sink.close()
        self.check()
