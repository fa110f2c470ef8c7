"""An HDF5 file at an address, read by blocks: each is fetched once and kept.

Where the whole file would lie is an empty one of its length and kind. Beside it `.NAME.blocks`
holds the state of the file that it is of, a byte for each block that is there, and the blocks. Any
number of processes read it at once; a block counts only after its bytes were written.
"""

from __future__ import annotations

import gc
import io
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.address import address_of, mirrors, reached, retried, store_of
from eventsweep.emvs.utils.files import atomic_path

BLOCK_BYTES = 1 << 14
LIMIT_VARIABLE = "EVENTSWEEP_REMOTE_GB"
"""Names how many gigabytes of blocks are kept: beyond, files not opened for longest go."""
_LIMIT_GB = 20.0
_STATE_BYTES = 64
_HDF5 = b"\x89HDF\r\n\x1a\n"
_CHECKED_EVERY = 64  # blocks fetched between looks at what all of them take


def is_by_blocks(path: Path) -> bool:
    """Whether a path is the sparse file of one at an address."""
    return address_of(path) is not None and _kept(path).exists()


def stand_in(path: Path, size_bytes: int, state: str) -> None:
    """Puts an empty file in the place of an HDF5 file at an address, unless one of it is there.

    Args:
        path: in a mirror.
        size_bytes: of the file at the address.
        state: changes whenever the file there does, at most 64 ASCII characters.
    """
    head, place = state.encode("ascii").ljust(_STATE_BYTES), _kept(path)
    with suppress(OSError):
        if path.stat().st_size == size_bytes and _head(place) == head:
            os.utime(place)
            return
    path.parent.mkdir(parents=True, exist_ok=True)
    # A new file in the place of an old one: who has that open reads on in it.
    _put(place, head, _data_at(size_bytes))
    _put(path, _HDF5, size_bytes)


class BlockFile(io.RawIOBase):
    """The bytes of a file at an address, for what reads from a file that is open.

    HDF5 does not ask how many bytes it was given; so what went wrong is kept in `fault`, which
    whoever opened the file must look at.

    While one is open Python collects no cycles. h5py holds a lock while it waits here for bytes,
    which a thread of the store's library fetches; collected there, an object of h5py's would wait
    for that lock for ever.
    """

    _open = 0
    _collects = True

    def __init__(self, path: Path) -> None:
        if not BlockFile._open:
            BlockFile._collects = gc.isenabled()
        BlockFile._open += 1
        gc.disable()
        self.address = str(address_of(path))
        self.fault: InputError | None = None
        self._path, self._at, self._fetched = path, 0, 0
        self._files, self._place = store_of(self.address)
        self._size = path.stat().st_size
        self._data_at = _data_at(self._size)
        _settle(self._files)
        self._kept = os.open(_kept(path), os.O_RDWR)

    def readinto(self, buffer: Any) -> int:
        """Fills a buffer from the place that `seek` set."""
        view = memoryview(buffer).cast("B")
        stop = min(self._at + len(view), self._size)
        try:
            if stop > self._at:
                self._fetch(self._at // BLOCK_BYTES, -(-stop // BLOCK_BYTES))
        except InputError as error:
            self.fault = self.fault or error
            raise OSError(str(error)) from error
        data = os.pread(self._kept, max(stop - self._at, 0), self._data_at + self._at)
        view[: len(data)] = data
        self._at += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Sets where the next read begins."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """Where the next read begins."""
        return self._at

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def close(self) -> None:
        """Closes what keeps the blocks."""
        if not self.closed:
            os.close(self._kept)
            BlockFile._open -= 1
            if not BlockFile._open and BlockFile._collects:
                gc.enable()
        super().close()

    def _fetch(self, first: int, after: int) -> None:
        """Fetches the blocks of a range that are not there, neighbours with one request."""
        there = os.pread(self._kept, after - first, _STATE_BYTES + first)
        k = 0
        while (k := there.find(b"\0", k)) >= 0:
            end = k
            while end < len(there) and not there[end]:
                end += 1
            self._get(first + k, first + end)
            k = end

    def _get(self, first: int, after: int) -> None:
        start, stop = first * BLOCK_BYTES, min(after * BLOCK_BYTES, self._size)
        with reached(self.address):
            data = retried(lambda: self._bytes(start, stop))
        os.pwrite(self._kept, data, self._data_at + start)
        os.pwrite(self._kept, b"\1" * (after - first), _STATE_BYTES + first)
        if not self._fetched or self._fetched + after - first > _CHECKED_EVERY:
            _make_room(keep=self._path)
            self._fetched = 0
        self._fetched += after - first

    def _bytes(self, start: int, stop: int) -> bytes:
        data: bytes = self._files.cat_file(self._place, start=start, end=stop)
        if len(data) > stop - start:
            raise InputError(
                f"{self.address}: its server gives whole files, not parts of them; copy the "
                "recording here first"
            )
        if len(data) < stop - start:
            raise ConnectionError(f"{len(data)} of {stop - start} bytes came")
        return data


def _settle(files: Any) -> None:
    """Waits until the library's thread is in the middle of nothing, as of a collection."""
    if getattr(files, "async_impl", False):
        from fsspec.asyn import sync

        async def nothing() -> None: ...

        sync(files.loop, nothing)


def kept_limit_bytes() -> int:
    """How many bytes of blocks are kept: `$EVENTSWEEP_REMOTE_GB`, or 20 GB."""
    text = os.environ.get(LIMIT_VARIABLE, "").strip() or str(_LIMIT_GB)
    try:
        limit_gb = float(text)
    except ValueError:
        limit_gb = -1.0
    if not 0 < limit_gb < 1e6:
        raise InputError(f"{LIMIT_VARIABLE} is {text!r}: needs gigabytes, above 0; correct it")
    return round(limit_gb * 1e9)


def _make_room(keep: Path) -> None:
    """Removes blocks of the files not opened for longest until all are within the limit.

    The file that is read now is spared: alone it may take more.
    """
    seen = {place: place.stat() for place in mirrors().rglob(".*.blocks")}
    left, limit = sum(one.st_blocks * 512 for one in seen.values()), kept_limit_bytes()
    for place in sorted(seen, key=lambda place: seen[place].st_mtime):
        if left <= limit:
            return
        if place != _kept(keep):
            path = place.with_name(place.name.removeprefix(".").removesuffix(".blocks"))
            with suppress(OSError):
                _put(place, _head(place), _data_at(path.stat().st_size))
                left -= seen[place].st_blocks * 512


def _kept(path: Path) -> Path:
    return path.with_name(f".{path.name}.blocks")


def _head(place: Path) -> bytes:
    with place.open("rb") as file:
        return file.read(_STATE_BYTES)


def _data_at(size_bytes: int) -> int:
    """Where the first block lies behind the bytes that say which are there."""
    return _STATE_BYTES + -(-size_bytes // BLOCK_BYTES)


def _put(path: Path, head: bytes, size_bytes: int) -> None:
    """Puts a file that is empty behind its head in a place, whole or not at all."""
    with atomic_path(path) as made, made.open("wb") as file:
        file.write(head)
        file.truncate(size_bytes)
