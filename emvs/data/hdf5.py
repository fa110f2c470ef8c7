"""HDF5 as every store here uses it: one compression, faults reported in one line, a safe full disk.

HDF5 reads zeros where chunks are missing, and a filter whose parameters were damaged can end the
whole process; so both are looked at before the first value is read.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from traceback import clear_frames
from typing import Any, Self

import h5py
import hdf5plugin
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, printable, quoted, said
from eventsweep.emvs.utils.blocks import BlockFile, is_by_blocks
from eventsweep.emvs.utils.inputs import TABLE_BYTES, check_file

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
ECF = 0x8ECF  # the filter of Prophesee's codec
_MOST_CHUNK = 1 << 28
_MOST_LINKS = 10_000
_FAULTS = (
    OSError, LookupError, RuntimeError, TypeError, AttributeError, ValueError, ArithmeticError,
    MemoryError,
)  # fmt: skip
# What the plug-ins themselves store for each data set, and read without counting.
_LEAST_PARAMETERS = {32001: 4, 32008: 3, 32026: 4}


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Opens a file for reading.

    Raises:
        InputError: a missing or truncated file, a data set that is missing or damaged, or one whose
            values lie in another file.
    """
    opened = BlockFile(path) if is_by_blocks(path) else nullcontext()
    with opened as blocks, _opened(path, blocks) as file:
        yield file


@contextmanager
def _opened(path: Path, blocks: BlockFile | None) -> Iterator[h5py.File]:
    try:
        check_file(path)
        file = h5py.File(blocks or path, "r")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        # Its frames know HDF5's settings of the file, which HDF5 would otherwise free at exit, by
        # functions of a Python that is gone.
        clear_frames(error.__traceback__)
        _check_came(blocks)
        raise InputError(
            f"{path}: not a complete HDF5 file ({error}); write or download it again"
        ) from error
    with file:
        try:
            _check_own(path, file)
            yield file
            _check_came(blocks)
        except InputError as error:  # it may quote the file
            _check_came(blocks)
            raise InputError(printable(str(error), 1000)) from error
        except _FAULTS as error:
            _check_came(blocks)
            what = f"{path}: damaged, or not in the expected layout"
            raise InputError(f"{what} ({said(error)}); download or write it again") from error


def _check_came(blocks: BlockFile | None) -> None:
    """Raises what kept blocks of a file at an address from coming: HDF5 took others for them."""
    if blocks is not None and blocks.fault is not None:
        raise blocks.fault


def _check_own(path: Path, file: h5py.File) -> None:
    """Refuses links into other files and data sets whose values lie there.

    HDF5 would open any file that these name, as the user who reads. What a name of the file's own
    leads to is not asked for: it is met under another name.
    """
    links: list[tuple[bytes, int]] = []

    def noted(name: bytes, info: Any) -> bool | None:
        links.append((name, info.type))  # looked at later: no error may pass through HDF5
        return True if len(links) > _MOST_LINKS else None

    if file.id.links.visit(noted, info=True):
        raise InputError(f"{path}: more than {_MOST_LINKS} links; write a file with fewer")
    for name, kind in links:
        how = _lies_elsewhere(file, name, kind)
        if how is not None:
            raise InputError(
                f"{path}: {quoted(name.decode(errors='replace'))} is stored in another file "
                f"({how}); copy everything into one file"
            )


def _lies_elsewhere(file: h5py.File, name: bytes, kind: int) -> str | None:
    if kind == h5py.h5l.TYPE_EXTERNAL:
        return "an external link"
    if kind != h5py.h5l.TYPE_HARD:
        return None
    if h5py.h5o.get_info(file.id, name).type != h5py.h5o.TYPE_DATASET:
        return None
    plist = h5py.h5d.open(file.id, name).get_create_plist()
    if plist.get_layout() == h5py.h5d.VIRTUAL:
        return "a virtual data set"
    return "external storage" if plist.get_external_count() else None


class Sink(io.FileIO):
    """What HDF5 writes into: a file that keeps its first fault for `check` and swallows the rest.

    HDF5 retries a failed write from every cache that it closes and can crash the process; so it
    never learns of the fault, and whoever writes must call `check`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._fault: OSError | None = None

    def check(self) -> None:
        """Raises the first fault, if there was one."""
        if self._fault is not None:
            raise self._fault

    def write(self, data: Any) -> int:
        """Writes all of `data`, or remembers why that failed."""
        view = memoryview(data)
        end = self.tell() + len(view)
        try:
            while len(view):
                view = view[super().write(view) :]
        except OSError as error:
            self._fault = self._fault or error
            self.seek(end)
        return len(data)

    def readinto(self, buffer: Any) -> int:
        """Reads back; after a fault there may be less than HDF5 wrote, so zeros stand in."""
        count = super().readinto(buffer) or 0
        if self._fault is not None:
            buffer[count:] = bytes(len(buffer) - count)
            return len(buffer)
        return count

    def truncate(self, size: int | None = None) -> int:
        """Sets the length, unless the disk has already failed."""
        try:
            return super().truncate(size)
        except OSError as error:
            self._fault = self._fault or error
            return size or 0


class ClosingWriter:
    """A writer of an HDF5 file, to be used as a context, which closes it."""

    _hdf5: Hdf5Writer

    def close(self) -> None:
        """Closes the file."""
        self._hdf5.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()


class Hdf5Writer(ClosingWriter):
    """A new HDF5 file, open as `file`; use it as a context, or close it, and `check` it."""

    def __init__(self, path: Path) -> None:
        self._sink = Sink(path)
        self.file = h5py.File(self._sink, "w")

    def create(self, name: str, *arguments: Any, **settings: Any) -> None:
        """A new data set, as `h5py.Group.create_dataset` makes it."""
        self.file.create_dataset(name, *arguments, **settings).id.close()

    def grow(
        self, name: str, kind: Any, rows: int, shape: tuple[int, ...] = (), **kept: Any
    ) -> None:
        """A new, empty data set to `extend`: rows of a shape, so many of them in a chunk."""
        limits = {"maxshape": (None, *shape), "chunks": (rows, *shape)}
        self.create(name, (0, *shape), kind, **limits, **kept)

    @contextmanager
    def opened(self, name: str) -> Iterator[h5py.Dataset]:
        """Opens a data set and closes it at the end.

        What waits in a data set's cache finds its place in the file when the data set is closed.
        Python would do that when nobody holds it any more: not at once where a profiler, a
        debugger or a scheduler's watch looks at frames, and then the same values lie in another
        order.
        """
        data = self.file[name]
        try:
            yield data
        finally:
            data.id.close()

    def extend(self, name: str, rows: Any) -> None:
        """Appends rows to a data set; raises what the disk said."""
        with self.opened(name) as data:
            count = len(data)
            data.resize(count + len(rows), axis=0)
            data[count:] = rows
        self.check()

    def check(self) -> None:
        """Raises what the disk said to the last writes."""
        self._sink.check()

    def close(self) -> None:
        """Closes the file; raises what the disk said."""
        self.file.close()
        self._sink.close()
        self.check()


def known_names(
    what: str, given: Collection[str], known: Collection[str], before: Collection[str] | None
) -> tuple[str, ...]:
    """Names of optional data sets, in the order of the known ones, and the same as `before`."""
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise InputError(f"unknown {what} {unknown}: choose from {', '.join(known)}")
    if before is not None and set(given) != set(before):
        raise InputError(
            f"{what} {sorted(given)} after {sorted(before)}: give the same ones with every packet"
        )
    return tuple(name for name in known if name in given)


def check_dataset(path: Path, data: Any) -> int:
    """Number of rows of a data set.

    Raises:
        InputError: no data set, a filter that is not installed or damaged, chunks or rows beyond
            2^28 bytes, or fewer bytes than it declares.
    """
    if not isinstance(data, h5py.Dataset) or not data.shape:
        raise InputError(
            f"{path}: expected a data set, found a group or a single value; the file is damaged"
        )
    where = f"{path}, data set {data.name}"
    _check_filters(where, data)
    _check_storage(where, data)
    row_bytes = int(np.prod(data.shape[1:], dtype=object)) * data.dtype.itemsize
    if row_bytes > _MOST_CHUNK:
        raise InputError(f"{where}: rows of {row_bytes} bytes, at most {_MOST_CHUNK} are read")
    return int(data.shape[0])


def read_whole(path: Path, data: Any) -> NDArray[Any]:
    """All values of a data set that is a short list, of times for example.

    Raises:
        InputError: what `check_dataset` refuses, or more than `TABLE_BYTES`: a file of a megabyte
            can hold a thousand.
    """
    check_dataset(path, data)
    if data.nbytes > TABLE_BYTES:
        raise InputError(
            f"{path}, data set {data.name}: {data.nbytes} bytes, at most {TABLE_BYTES} are read"
        )
    values: NDArray[Any] = data[()]
    return values


def check_columns(path: Path, file: h5py.File, axes: Mapping[str, int]) -> int:
    """Number of rows of data sets that belong together.

    Args:
        path: the file's.
        file: the open file.
        axes: how many axes each data set must have.

    Raises:
        InputError: what `check_dataset` refuses, other axes, or different lengths.
    """
    counts = {name: check_dataset(path, file[name]) for name in axes}
    for name, needed in axes.items():
        if file[name].ndim != needed:
            raise InputError(
                f"{path}, data set {name}: shape {file[name].shape}, which is not supported"
            )
    if len(set(counts.values())) != 1:
        raise InputError(f"{path}: data sets of different lengths {counts}; needs equal lengths")
    return next(iter(counts.values()))


def _check_filters(where: str, data: h5py.Dataset) -> None:
    plist = data.id.get_create_plist()
    for k in range(plist.get_nfilters()):
        code, _, parameters, *_ = plist.get_filter(k)
        if not h5py.h5z.filter_avail(code):
            cure = "install Prophesee's ECF plug-in" if code == ECF else "install its plug-in"
            raise InputError(
                f"{where}: compressed with filter {code:#x}, which is not installed; {cure} and "
                "set HDF5_PLUGIN_PATH to its folder"
            )
        if len(parameters) < _LEAST_PARAMETERS.get(code, 0):
            raise InputError(
                f"{where}: filter {code} with {len(parameters)} parameters, needs "
                f"{_LEAST_PARAMETERS[code]}; the file is damaged, download it again"
            )


def _check_storage(where: str, data: h5py.Dataset) -> None:
    """Refuses counts that the file does not back with bytes: HDF5 would read zeros there."""
    if data.chunks is None:
        stored, needed = data.id.get_storage_size(), data.nbytes
    else:
        stored = data.id.get_num_chunks()
        size = int(np.prod(data.chunks)) * data.dtype.itemsize
        if size > _MOST_CHUNK:
            raise InputError(
                f"{where}: chunks of {size} bytes, the limit is {_MOST_CHUNK}; rewrite the file "
                "with smaller chunks, unless it is damaged"
            )
        needed = int(np.prod([-(-n // c) for n, c in zip(data.shape, data.chunks, strict=True)]))
    if stored < needed:
        unit = "bytes" if data.chunks is None else "chunks"
        raise InputError(
            f"{where}: {data.shape[0]} rows need {needed} {unit}, but only {stored} are stored; "
            "the file is incomplete, download it again"
        )
