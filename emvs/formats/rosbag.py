"""Events in ROS1 and ROS2 bags without ROS: one stream per topic of event arrays or packets."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from itertools import accumulate, pairwise
from pathlib import Path, PurePath
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import yaml
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer
from rosbags.rosbag1.reader import decompressors
from rosbags.rosbag2 import metadata
from rosbags.rosbag2 import reader as ros2_reader
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from ruamel.yaml import YAML

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError, quoted, refused
from eventsweep.emvs.formats import event_packets
from eventsweep.emvs.formats.base import Sizes, StreamWriter
from eventsweep.emvs.formats.blocks import (
    MOST_RATIO,
    SMALL_BYTES,
    BlockReader,
    BoundedPath,
    BoundedZstd,
    unpacked,
    within,
)
from eventsweep.emvs.formats.prophesee import opened
from eventsweep.emvs.formats.prophesee_kernels import State, initial_state
from eventsweep.emvs.formats.rosbag_kernels import decode_array, encode_array
from eventsweep.emvs.utils.inputs import check_file, check_yaml, read_text

_BLOCK_EVENTS = 1 << 18
_MOST_NS = 1 << 62
_METADATA_BYTES = 1 << 22
_TABLES = ("schema", "topics", "messages", "message_definitions")
_CURE = "the bag is damaged, reindex or record it again"
MCAP, SQLITE = b"\x89MCAP0\r\n", b"SQLite format 3\0"
SUFFIXES, METADATA = (".bag", ".mcap", ".db3"), "metadata.yaml"
TYPES = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray")
EVENT_BYTES = 13
_EVENT = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
_ARRAY = "Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"


class RosbagReader(BlockReader):
    """A ROS1 bag (a file) or a ROS2 bag (a folder with `metadata.yaml`, or a lone MCAP file).

    A block is a run of messages, found again by their times of recording. Times of events are
    their own stamps, not those of recording.
    """

    def __init__(self, path: Path) -> None:
        path = bag_at(Path(path)) or Path(path)
        self._ros2 = is_ros2(path)
        self.format = "rosbag2" if self._ros2 else "rosbag1"
        with opened_bag(path) as bag:
            kinds = {c.topic: c.msgtype for c in bag.connections}
            known = (*TYPES, *event_packets.TYPES)
            super().__init__(path, tuple(t for t, kind in kinds.items() if kind in known))
            if not self.streams:
                shown = quoted(*(f"{t} ({kind})" for t, kind in kinds.items())) or "none"
                raise InputError(f"{path}: topics {shown}; needs one of {', '.join(known)}")
            self._packed = {t for t in self.streams if kinds[t] in event_packets.TYPES}
            self._counts = {
                t: sum(c.msgcount for c in bag.connections if c.topic == t) for t in self.streams
            }
            self._span_ns = (int(bag.start_time), int(bag.end_time))
            size_px = self._size_of(bag, self.streams[0])
            self.width_px, self.height_px = size_px or (None, None)

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads a topic's messages in the order of their recording."""
        waiting: list[Events] = []
        messages = 0
        count, first_ns, last_ns, before = 0, 0, -1, initial_state()
        for stamp_ns, state, events in self._messages(stream, 0, _MOST_NS, before):
            messages += 1
            if count >= _BLOCK_EVENTS and stamp_ns != last_ns:
                yield (first_ns, last_ns + 1, before), Events.concat(waiting)
                waiting, count = [], 0
            if not waiting:
                first_ns, before = stamp_ns, state
            waiting.append(events)
            count, last_ns = count + len(events), stamp_ns
        if count:
            yield (first_ns, last_ns + 1, before), Events.concat(waiting)
        if messages != self._counts[stream]:
            raise InputError(
                f"{self.path}, topic {quoted(stream)}: {messages} messages found, but its index "
                f"lists {self._counts[stream]}; {_CURE}"
            )

    def load(self, stream: str, place: Any) -> Events:
        """Reads one run of messages."""
        return Events.concat([events for _, _, events in self._messages(stream, *place)])

    def share_before(self, _stream: str, place: Any) -> float:
        """Which share of the time of recording ends with a block."""
        first_ns, last_ns = self._span_ns
        return float(min(1.0, max(0.0, (place[1] - first_ns) / max(1, last_ns - first_ns))))

    def between(self, stream: str, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, in file order: one pass over the blocks that matter."""
        entries = self._index(stream)
        wanted = [k for k, e in enumerate(entries) if e.last_us >= t0_us and e.first_us < t1_us]
        if not wanted:
            return Events.empty()
        entries = entries[wanted[0] : wanted[-1] + 1]
        (start_ns, _, before), stop_ns = entries[0].place, entries[-1].place[1]
        parts, count = [], 0
        for _, _, events in self._messages(stream, start_ns, stop_ns, before):
            parts.append(within(events, t0_us, t1_us))
            count += len(events)
        if count != (known := sum(e.count for e in entries)):
            raise InputError(
                f"{self.path}, topic {quoted(stream)}: {count} of {known} events between the times "
                f"of recording {start_ns} and {stop_ns} ns are found by its index; {_CURE}"
            )
        return Events.concat([part for part in parts if len(part)])

    def _messages(
        self, stream: str, start_ns: int, stop_ns: int, before: State
    ) -> Iterator[tuple[int, State, Events]]:
        """Stamp, what a decoder knows before it, and events of each message, from `before` on."""
        state, is_packed, last_ns = before.copy(), stream in self._packed, start_ns
        with opened_bag(self.path) as bag:
            wanted = [c for c in bag.connections if c.topic == stream]
            for number, (_, stamp_ns, data) in enumerate(
                bag.messages(wanted, start=start_ns, stop=stop_ns)
            ):
                where = f"{self.path}, topic {quoted(stream)}, message {number} at {stamp_ns} ns"
                if stamp_ns < last_ns:  # slices, which are found by these times, would lose it
                    raise InputError(
                        f"{where}: recorded earlier than the message before it; {_CURE}"
                    )
                before, last_ns = state.copy(), stamp_ns
                if is_packed:
                    events = event_packets.packet_events(data, self._ros2, where, state)
                else:
                    events = array_events(data, self._ros2, where)
                yield stamp_ns, before, events

    def size_px(self, stream: str) -> tuple[int, int] | None:
        """Width and height of a stream's sensor, as its first message says."""
        if stream == self.streams[0]:
            return super().size_px(stream)
        with opened_bag(self.path) as bag:
            return self._size_of(bag, stream)

    def _size_of(self, bag: Any, stream: str) -> tuple[int, int] | None:
        wanted = [c for c in bag.connections if c.topic == stream]
        for _, _, data in bag.messages(wanted):
            where = f"{self.path}, topic {quoted(stream)}"
            read = event_packets.packet_head if stream in self._packed else array_head
            head: Any = read(data, self._ros2, where)
            return (head.width_px, head.height_px) if head.width_px and head.height_px else None
        return None


def is_ros2(path: Path) -> bool:
    """Whether a bag is a ROS2 one: a folder, or a lone file of one."""
    return path.is_dir() or _storage(path) is not None


def _storage(path: Path) -> type[BoundedPath] | None:
    """The kind of path that tells the library what a lone ROS2 file holds; None for others."""
    with opened(path) as file:
        head = file.read(len(SQLITE))
    return next((own for magic, own in _STORAGES.items() if head.startswith(magic)), None)


def bag_at(path: Path) -> Path | None:
    """The bag at a path: a file, a folder whose `metadata.yaml` names its files, or its only file.

    A recorder that was killed leaves a folder without metadata, or with an empty one, beside a file
    that may be whole. None where there is no bag.

    Raises:
        InputError: several files, whose order the metadata does not tell.
    """
    if not path.is_dir():
        return path if path.suffix in SUFFIXES else None
    metadata = path / METADATA
    if metadata.exists() and _names_its_files(path, metadata.stat().st_mtime_ns):
        return path
    files = sorted(file for end in SUFFIXES[1:] for file in path.glob(f"*{end}") if file.is_file())
    if len(files) > 1:
        raise InputError(
            f"{path}: {len(files)} files of a ROS2 bag ({quoted(*(f.name for f in files[:4]))}) "
            f"without a {METADATA} that names them: run `ros2 bag reindex`, or open one of them"
        )
    return files[0] if files else None


@lru_cache(maxsize=64)  # a reader opens its bag anew for every slice
def _names_its_files(folder: Path, _changed_ns: int) -> bool:
    """Whether a folder's metadata can be read and name files that are there.

    Raises:
        InputError: it is no regular file, too long, or stands for more than memory holds.
    """
    check_file(folder / METADATA)
    try:
        text = read_text(folder / METADATA, _METADATA_BYTES)
        with refused(f"{folder / METADATA}: cannot be read", ValueError, RecursionError):
            check_yaml(text)
        # As texts, for YAML takes time by the square of a number's digits.
        values = yaml.load(text, yaml.BaseLoader)
        names = values["rosbag2_bagfile_information"]["relative_file_paths"]
        return bool(names) and all((folder / PurePath(name).name).exists() for name in names)
    except (OSError, UnicodeError, yaml.YAMLError, KeyError, TypeError):
        return False


class _BagPath(BoundedPath):
    """A path in a bag: only regular files are opened, and of texts only those of usual length."""

    def open(self, *args: Any, **kwargs: Any) -> Any:
        """Opens the file as `BoundedPath` does."""
        check_file(self)
        return super().open(*args, **kwargs)

    def read_text(self, *_args: Any, **_kwargs: Any) -> str:
        """The whole text of `metadata.yaml`."""
        return read_text(self, _METADATA_BYTES)


class _LoneMcapPath(_BagPath):
    """A lone MCAP file, whatever its name: the library goes by the name's end."""

    suffix = ".mcap"


class _LoneSqlitePath(_BagPath):
    """A lone SQLite file."""

    suffix = ".db3"


_STORAGES: dict[bytes, type[BoundedPath]] = {MCAP: _LoneMcapPath, SQLITE: _LoneSqlitePath}


class _Yaml(YAML):
    """What the library reads metadata with: no text that stands for more than memory holds."""

    def load(self, stream: Any) -> Any:
        """The content of a text."""
        check_yaml(stream)
        return super().load(stream)


class _BoundedMcap(McapReader):
    """Chunks of which each is there once, and no more at a time than the file's size explains."""

    def read_index(self) -> None:
        """Reads the index; of chunks that overlap in time the library holds all."""
        super().read_index()
        chunks = sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset)
        if any(a.chunk_start_offset + a.chunk_length > b.chunk_start_offset
               for a, b in pairwise(chunks)):  # fmt: skip
            raise ValueError("chunks that overlap in the file")
        size = Path(str(self.path)).stat().st_size
        steps = [(c.message_start_time, c.uncompressed_size) for c in chunks]
        steps += [(c.message_end_time + 1, -c.uncompressed_size) for c in chunks]
        at_once = max(accumulate(step for _, step in sorted(steps)), default=0)
        if at_once > max(2 * SMALL_BYTES, MOST_RATIO * size):
            raise ValueError(f"chunks of the same time unpack to {at_once} bytes")


class _PlainSqlite(Sqlite3Reader):
    """A database of plain tables: a view or a computed column can be endless."""

    def __init__(self, path: Any) -> None:
        check_file(path)
        super().__init__(Path(quote(str(path))))  # the library makes an address of it

    def _open(self) -> None:
        assert self.dbconn is not None
        for kind, name, text in self.dbconn.execute("SELECT type, name, sql FROM sqlite_master"):
            if str(name).lower() in _TABLES:
                is_table = kind == "table" and str(text).upper().startswith("CREATE TABLE")
                ask = "SELECT count(*) FROM pragma_table_xinfo(?) WHERE hidden"
                if not is_table or self.dbconn.execute(ask, (name,)).fetchall() != [(0,)]:
                    raise ValueError(f"{quoted(name)} is no plain table")
        super()._open()


class _Folder(ros2_reader.DirectoryReader):
    STORAGE_PLUGINS: Any = {"mcap": _BoundedMcap, "sqlite3": _PlainSqlite}  # noqa: RUF012


class _Reader2(ros2_reader.Reader):
    STORAGE_PLUGINS: Any = {"dir": _Folder, ".mcap": _BoundedMcap, ".db3": _PlainSqlite}  # noqa: RUF012


@contextmanager
def opened_bag(path: Path) -> Iterator[Any]:
    """Opens a bag for reading."""
    # Damaged bags end in asserts, struct errors, decoders' own, ...
    cure = "; it is cut off or damaged, reindex or record it again"
    with refused(f"{path}: cannot be read as a ROS bag", Exception, cure=cure):
        path = bag_at(path) or path
        ros2 = is_ros2(path)
        storage = None if path.is_dir() else _storage(path)
        own = _BagPath(path) if storage is None else storage(path)
        DECOMPRESSORS.update({name: partial(_bounded_part, name) for name in ("lz4", "zstd")})
        ros2_reader.zstd = _BoundedCodec  # type: ignore[attr-defined,assignment]
        ros2_reader.YAML = metadata.YAML = _Yaml  # type: ignore[attr-defined]
        with _Reader2(own) if ros2 else Reader1(own) as bag:
            if isinstance(bag, Reader1):
                if any(
                    a[1:] == b[1:] for index in bag.indexes.values() for a, b in pairwise(index)
                ):
                    raise ValueError("messages that are listed twice")
                bag.chunks = {at: _bounded(path, at, chunk) for at, chunk in bag.chunks.items()}
            if not all(isinstance(n, str) for c in bag.connections for n in (c.topic, c.msgtype)):
                raise ValueError("topics and types without names")
            yield bag


def _bounded(path: Path, at: int, chunk: Any) -> Any:
    """A ROS1 chunk whose unpacking ends at a bound; the library's own does not."""
    kind = next(name for name, unpack in decompressors.items() if unpack is chunk.decompressor)
    if kind == "none":
        return chunk
    where = f"{path}, chunk at byte {at}"
    return chunk._replace(decompressor=partial(unpacked, compression=kind, where=where))


class _BoundedCodec:
    """The same for ROS2's compressed files and messages: what the library asks of `zstd`."""

    open = BoundedZstd

    @staticmethod
    def decompress(data: bytes) -> bytes:
        return _bounded_part("zstd", data)


def _bounded_part(compression: str, data: bytes, _size: int = 0) -> bytes:
    """The same for MCAP, whose chunks have a table of decompressors in common."""
    try:
        return unpacked(data, compression, "a chunk or message")
    except InputError as error:  # `opened_bag` knows the file
        raise ValueError(str(error)) from error


class ArrayHead(NamedTuple):
    """What stands before the events of a message: sensor size, event count, where they begin."""

    width_px: int
    height_px: int
    events: int
    start: int


def array_head(data: bytes | memoryview, ros2: bool, where: str) -> ArrayHead:
    """Reads the fields before the events, and checks that the events are all there."""
    with event_packets.message_fields(data, ros2, where) as fields:
        height, width, count = (fields.number("I") for _ in range(3))
    start = fields.at
    size = (16 * count - 3 if count else 0) if ros2 else EVENT_BYTES * count
    if start + size > len(data) or (not ros2 and start + size != len(data)):
        raise InputError(
            f"{where}: {count} events need {size} bytes, {len(data) - start} are present; the "
            "message is damaged, record the bag again"
        )
    return ArrayHead(width, height, count, start)


def array_events(data: bytes | memoryview, ros2: bool, where: str) -> Events:
    """The events of a message; nanoseconds are rounded to µs."""
    head = array_head(data, ros2, where)
    events = Events.room(head.events)
    raw = np.frombuffer(data, np.uint8)[head.start :]
    bad = decode_array(raw, 16 if ros2 else EVENT_BYTES, 2 if ros2 else 0, events.columns)
    if bad >= 0:
        raise InputError(
            f"{where}: event {bad} of {head.events} has 10^9 nanoseconds or more, or a polarity "
            "above 1; the message is damaged, record the bag again"
        )
    return events


def array_bytes(events: Events, sequence: int, width_px: int, height_px: int) -> bytes:
    """A ROS1 message that holds the events; its stamp is that of the first one."""
    seconds, rest_us = divmod(int(events.t_us[0]), 1_000_000)
    head = struct.pack("<IIII", sequence & 0xFFFFFFFF, seconds, rest_us * 1000, 0)
    head += struct.pack("<III", height_px, width_px, len(events))
    data = np.empty(EVENT_BYTES * len(events), np.uint8)
    encode_array(events.columns, data)
    return head + data.tobytes()


class RosbagWriter(StreamWriter):
    """Appends messages of up to 16384 events; the times of recording never run backwards."""

    packet = 1 << 14

    def __init__(self, path: Path, sizes_px: Sizes) -> None:
        self._sizes_px = dict(sizes_px)
        store = get_typestore(Stores.ROS1_NOETIC)
        store.register(
            get_types_from_msg(_EVENT, "dvs_msgs/msg/Event") | get_types_from_msg(_ARRAY, TYPES[0])
        )
        path.unlink(missing_ok=True)  # the library insists on making the file
        self._bag = Writer(path)
        self._bag.open()
        self._topics = {
            name: self._bag.add_connection(name, TYPES[0], typestore=store) for name in sizes_px
        }
        self._last_us = dict.fromkeys(sizes_px, 0)
        self._sequence = dict.fromkeys(sizes_px, 0)

    def _put(self, stream: str, events: Events) -> None:
        """Writes a message, recorded when its last event happened."""
        self._last_us[stream] = max(self._last_us[stream], int(events.t_us.max()))
        data = array_bytes(events, self._sequence[stream], *self._sizes_px[stream])
        self._bag.write(self._topics[stream], self._last_us[stream] * 1000, data)
        self._sequence[stream] += 1

    def _close(self) -> None:
        self._bag.close()
