"""Event files in every format of the field: the table of formats, open any, write most.

`open_events(path)` recognises a file by its content; `write_events` writes one, streaming, and
refuses what the format cannot hold. `FORMATS` says what that is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from eventsweep.emvs.data.events import MOST_SPAN_US, Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.base import (
    ANY_US,
    DOUBLE_US,
    MANY,
    Checker,
    Limits,
    OnWritten,
    Sizes,
    Streams,
    StreamWriter,
)
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.prophesee import RawReader, RawWriter, opened
from eventsweep.emvs.formats.tables.columns import ColumnMap
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.inputs import check_file

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAT = b"MATLAB 5.0 MAT-f"
_MCAP, _SQLITE = b"\x89MCAP0\r\n", b"SQLite format 3\0"
_OLD_AEDAT = b"#!AER-DAT"
_TABLE_HEAD = 1 << 12
_ROW = re.compile(rb"[-+.\d][-+.,;\w \t]{6,}")
_PER_MS = "an index entry per millisecond"
_EVT = "11-bit pixels; longer times would be mostly counter words"
_COLUMNS = "64-bit columns"


@dataclass(frozen=True, slots=True)
class Format:
    """A format, by the name that `write_events` takes; all can be read, some written here.

    `what` describes it, `suffix` customarily ends the file's name, `polarity` codes brighter and
    darker.
    """

    name: str
    what: str
    suffix: str
    writes: bool
    limits: Limits
    polarity: str = "1/0"


def _evt(unit: str, max_us: int) -> Limits:
    return Limits(unit, _EVT, max_us, max_x=2047, max_y=2047, keeps_order=False)


_RAW = "Prophesee RAW, EVT"
_BAG = Limits("s + ns", "32-bit seconds", (1 << 32) * 10**6 - 1, streams=MANY)
_LINES = Limits("s, six decimals", "18 digits", ANY_US // 10)
_ALL = (
    Format("evt2", f"{_RAW} 2.0", ".raw", True, _evt("µs mod 2^34", 1 << 48)),
    Format("evt21", f"{_RAW} 2.1", ".raw", False, _evt("µs mod 2^34", ANY_US)),
    Format("evt3", f"{_RAW} 3.0", ".raw", True, _evt("µs mod 2^24", 1 << 40)),
    Format(
        "dat", "Prophesee DAT", ".dat", False,
        Limits("µs mod 2^32", "14-bit pixels", max_x=16383, max_y=16383),
    ),
    Format(
        "prophesee-hdf5", "Prophesee HDF5 (`CD/events`, ECF)", ".hdf5", False,
        Limits("µs", _COLUMNS),
    ),
    Format(
        "dsec", "HDF5 as DSEC lays it out, and our own", ".h5", True,
        Limits("µs from `t_offset`", _PER_MS, keeps_order=False, max_span_us=MOST_SPAN_US),
    ),
    Format(
        "tumvie", "HDF5 as TUM-VIE lays it out", ".h5", True,
        Limits("µs", f"{_PER_MS} from 0", MOST_SPAN_US, keeps_order=False),
    ),
    Format(
        "v2e", "HDF5 of v2e (`events`, N x 4)", ".h5", False,
        Limits("µs, 32 bits", "32-bit numbers"),
    ),
    Format(
        "e2calib", "HDF5 of e2calib (`x`, `y`, `t`, `p` in the root)", ".h5", False,
        Limits("µs", _COLUMNS),
    ),
    Format(
        "hdf5", "any HDF5, by its columns", ".h5", False, Limits("as stated", _COLUMNS),
        "1/0, 1/-1",
    ),
    Format(
        "mvsec", "HDF5 as MVSEC lays it out", ".hdf5", True,
        Limits("s, double", "seconds in a double", DOUBLE_US, streams=2), "1/-1",
    ),
    Format(
        "m3ed", "HDF5 as M3ED lays it out (`prophesee/left`, `prophesee/right`)", ".h5", False,
        Limits("µs", _COLUMNS, keeps_order=False, streams=2),
    ),
    Format(
        "aedat4", "iniVation AEDAT 4.0", ".aedat4", True,
        Limits(
            "µs", "signed 16-bit pixels", max_x=32767, max_y=32767, keeps_order=False, streams=64
        ),
    ),
    Format(
        "aedat2", "AEDAT 2.0 of jAER (DVS128, DAVIS)", ".aedat", False,
        Limits("µs mod 2^32", "the chip's pixels", max_x=639, max_y=479),
    ),
    Format(
        "aedat3", "AEDAT 3.1 of cAER and libcaer", ".aedat", False,
        Limits("µs", "15-bit pixels", max_x=32767, max_y=32767, streams=MANY),
    ),
    Format(
        "rosbag1", "ROS1 bag, dvs_msgs (reads prophesee_event_msgs and event_camera_msgs, too)",
        ".bag", True, _BAG,
    ),
    Format(
        "rosbag2",
        "ROS2 bag or lone MCAP file, dvs_msgs, prophesee_event_msgs or event_camera_msgs",
        "", False, _BAG,
    ),
    Format("text", "lines `t x y p`", ".txt", True, _LINES),
    Format("esim-text", "a line `width height`, then lines `t x y p`", ".txt", True, _LINES),
    Format("csv", "columns named in a header", ".csv", True, replace(_LINES, unit="µs")),
    Format(
        "npz", "NumPy archive of columns (reads (N, 4) and fields, too)", ".npz", True,
        Limits("µs", _COLUMNS),
    ),
    Format(
        "npy", "NumPy array: (N, 4), or with fields", ".npy", False,
        Limits("µs, s, or as stated", _COLUMNS), "1/0, 1/-1",
    ),
    Format(
        "evimo2", "folder of EVIMO2's `dataset_events_t.npy`, `_xy.npy` and `_p.npy`", "", False,
        Limits("s", _COLUMNS),
    ),
    Format(
        "mat", "MATLAB 5 arrays: vectors by name, (N, 4) as stated", ".mat", False,
        Limits("µs, s, or as stated", _COLUMNS), "1/0, 1/-1",
    ),
    Format(
        "parquet", "Parquet table, by its columns", ".parquet", False,
        Limits("as typed or stated", _COLUMNS), "1/0, 1/-1",
    ),
)  # fmt: skip
FORMATS = {entry.name: entry for entry in _ALL}


def open_events(path: str | Path, columns: ColumnMap | None = None) -> BlockReader:
    """Opens an event file, or the folder of a ROS2 bag or of EVIMO2; reads no events yet.

    Args:
        path: the file.
        columns: which of its columns is what and what its times count, where neither its names nor
            its values say so: of HDF5, NumPy, MATLAB, Parquet and text.

    Raises:
        InputError: nothing there, nothing known, a file that is damaged, or columns stated for a
            format that has none.
    """
    path = Path(path)
    if path.is_dir():
        return _plain(path, _folder(path), columns)
    if not path.exists():
        raise InputError(f"{path}: no such file; needs an event file")
    if not path.is_file():
        raise InputError(f"{path}: is a pipe or device; copy its content into a file first")
    check_file(path)
    with opened(path) as file:
        head = file.read(16)
    if not head:
        raise InputError(f"{path}: is empty; download it again")
    return _file(path, head, columns)


def _plain(path: Path, reader: BlockReader, columns: ColumnMap | None) -> BlockReader:
    if columns is not None:
        raise InputError(
            f"{path}: is {reader.format}, which defines its own columns; leave `columns` and "
            "`time_unit` out"
        )
    return reader


def _folder(path: Path) -> BlockReader:
    from eventsweep.emvs.formats.rosbag import RosbagReader, bag_at
    from eventsweep.emvs.formats.tables.npz import FOLDER_FILES, NpyFolderReader

    if (path / FOLDER_FILES["t"]).exists():
        return NpyFolderReader(path)
    bag = bag_at(path)
    if bag is None:
        raise InputError(
            f"{path}: a folder without the files of a ROS2 bag; needs these, or a file of events"
        )
    return RosbagReader(bag)


def _file(path: Path, head: bytes, columns: ColumnMap | None) -> BlockReader:
    """Opens a file by its first bytes."""
    # Each import waits until its format is met: together they cost half a second.
    if head.startswith(_HDF5):
        from eventsweep.emvs.formats.tables.hdf5 import Hdf5Reader

        return Hdf5Reader(path, columns)
    if head.startswith((b"PK\x03\x04", b"\x93NUMPY")):
        from eventsweep.emvs.formats.tables.npz import NpyReader, NpzReader

        return (NpyReader if head.startswith(b"\x93") else NpzReader)(path, columns)
    if head.startswith(_MAT):
        from eventsweep.emvs.formats.tables.mat import MatReader

        return MatReader(path, columns)
    if head.startswith(b"PAR1"):
        from eventsweep.emvs.formats.tables.parquet import ParquetReader

        return ParquetReader(path, columns)
    if head.startswith((b"#ROSBAG V", _MCAP, _SQLITE)):
        from eventsweep.emvs.formats.rosbag import RosbagReader

        return _plain(path, RosbagReader(path), columns)
    if head.startswith(_OLD_AEDAT):
        return _plain(path, _aedat(path, head), columns)
    if head.startswith(b"%") and not _is_table(path):
        return _plain(path, RawReader(path), columns)
    from eventsweep.emvs.formats.tables.text import TextReader

    return TextReader(path, columns)


def _aedat(path: Path, head: bytes) -> BlockReader:
    from eventsweep.emvs.formats import aedat, aedat4

    older = {aedat.MAGIC_2: aedat.Aedat2Reader, aedat.MAGIC_3: aedat.Aedat3Reader}
    return older.get(head[: len(aedat.MAGIC_2)], aedat4.Aedat4Reader)(path)


def _is_table(path: Path) -> bool:
    """Whether lines that begin with `%` stand before one of numbers, not before binary words."""
    with opened(path) as file:
        head = file.read(_TABLE_HEAD)
    rows = (line for line in head.splitlines() if line.strip() and not line.startswith(b"%"))
    is_text = head.isascii() and b"\0" not in head
    return is_text and _ROW.fullmatch(next(rows, b"")) is not None


def write_events(
    path: str | Path,
    format: str,  # noqa: A002 - the caller's word for it
    width_px: int,
    height_px: int,
    streams: Streams,
    on_written: OnWritten | None = None,
    sizes_px: Sizes | None = None,
) -> int:
    """Writes streams of events into one file; memory holds a packet per stream.

    Args:
        path: the file; it appears whole or not at all, and replaces one that is there.
        format: a name in `FORMATS`.
        width_px: sensor width.
        height_px: sensor height.
        streams: packets per stream; with several streams, written in the order of time.
        on_written: called with the number of events written so far, after each packet.
        sizes_px: width and height of the sensors of streams that have another size.

    Returns:
        The number of events written.

    Raises:
        InputError: an unknown format, or an event, a sensor or a number of streams that the
            format cannot hold: nothing is written then.
    """
    path, entry = Path(path), FORMATS.get(format)
    if entry is None or not entry.writes:
        known = ", ".join(name for name, known in FORMATS.items() if known.writes)
        raise InputError(f"{path}: format {format!r} cannot be written; choose one of {known}")
    most = entry.limits.streams
    if not 1 <= len(streams) <= most:
        cure = ": write one file per stream, or choose mvsec, rosbag1 or aedat4" * (most == 1)
        raise InputError(
            f"{path}: {len(streams)} streams ({', '.join(streams) or 'none'}); {format} holds "
            f"{'one' if most == 1 else f'1 to {most}'}{cure}"
        )
    sizes = dict.fromkeys(streams, (width_px, height_px)) | dict(sizes_px or {})
    check = Checker(path, entry.limits, sizes)
    with atomic_path(path) as partial, _writer(partial, format, sizes) as writer:
        for stream, events in in_time_order(streams):
            writer.append(stream, check(stream, events))
            if on_written is not None:
                on_written(check.count)
    return check.count


def in_time_order(streams: Streams) -> Iterator[tuple[str, Events]]:
    """Packets of all streams, always the one that ends first."""
    rest = {name: iter(packets) for name, packets in streams.items()}
    heads: dict[str, Events] = {}
    while rest or heads:
        for name in [name for name in rest if name not in heads]:
            packet = next((events for events in rest[name] if len(events)), None)
            if packet is None:
                del rest[name]
            else:
                heads[name] = packet
        if heads:
            name = min(heads, key=lambda name: int(heads[name].t_us[-1]))
            yield name, heads.pop(name)


def _writer(path: Path, kind: str, sizes_px: Sizes) -> StreamWriter:
    from eventsweep.emvs.formats.tables import hdf5, npz, text

    width_px, height_px = next(iter(sizes_px.values()))
    match kind:
        case "evt2" | "evt3":
            return RawWriter(path, kind, width_px, height_px)
        case "text" | "esim-text" | "csv":
            return text.TextWriter(path, kind, width_px, height_px)
        case "npz":
            return npz.NpzWriter(path, width_px, height_px)
        case "dsec":
            return hdf5.DsecWriter(path, width_px, height_px)
        case "tumvie":
            return hdf5.TumvieWriter(path)
        case "mvsec":
            return hdf5.MvsecWriter(path, tuple(sizes_px))
        case "aedat4":
            from eventsweep.emvs.formats.aedat4 import Aedat4Writer

            return Aedat4Writer(path, sizes_px)
        case _:
            from eventsweep.emvs.formats.rosbag import RosbagWriter

            return RosbagWriter(path, sizes_px)
