"""Reads events from ROS1 and ROS2 bags without ROS: one stream per topic of event arrays."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.bounded import BoundedPath, unpacked
from emvs.io.events.indexed import BlockReader, within
from emvs.io.events.ros_messages import TYPES, array_events, array_head
from emvs.io.events.wording import quoted, said

_BLOCK_EVENTS = 1 << 18
_MOST_NS = 1 << 62


class RosbagReader(BlockReader):
    """A ROS1 bag (a file) or a ROS2 bag (a folder with `metadata.yaml`).

    A block is a run of messages, found again by their times of recording. Times of events are
    their own stamps, not those of recording.

    Raises:
        InputError: a missing or damaged bag, or one without event arrays.
    """

    def __init__(self, path: Path) -> None:
        path = Path(path)
        self._ros2 = path.is_dir()
        self.format = "rosbag2" if self._ros2 else "rosbag1"
        with opened_bag(path) as bag:
            kinds = {c.topic: c.msgtype for c in bag.connections}
            super().__init__(path, tuple(t for t, kind in kinds.items() if kind in TYPES))
            if not self.streams:
                shown = quoted(*(f"{t} ({kind})" for t, kind in kinds.items())) or "none"
                raise InputError(f"{path}: topics {shown}; needs one of {' or '.join(TYPES)}")
            self._counts = {
                t: sum(c.msgcount for c in bag.connections if c.topic == t) for t in self.streams
            }
            self._span_ns = (int(bag.start_time), int(bag.end_time))
            self._first_size(bag)

    def scan(self, stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads a topic's messages in the order of their recording."""
        waiting: list[Events] = []
        messages = 0
        count, first_ns, last_ns = 0, 0, -1
        for stamp_ns, events in self._messages(stream, 0, _MOST_NS):
            messages += 1
            if count >= _BLOCK_EVENTS and stamp_ns != last_ns:
                yield (first_ns, last_ns + 1), Events.concat(waiting)
                waiting, count = [], 0
            if not waiting:
                first_ns = stamp_ns
            waiting.append(events)
            count, last_ns = count + len(events), stamp_ns
        if waiting:
            yield (first_ns, last_ns + 1), Events.concat(waiting)
        if messages != self._counts[stream]:
            raise InputError(
                f"{self.path}, topic {quoted(stream)}: {messages} messages found, its index says "
                f"{self._counts[stream]}; the bag is damaged, reindex or record it again"
            )

    def load(self, stream: str, place: Any) -> Events:
        """Reads one run of messages."""
        return Events.concat([events for _, events in self._messages(stream, *place)])

    def share_before(self, stream: str, place: Any) -> float:
        """Which share of the time of recording ends with a block."""
        del stream
        first_ns, last_ns = self._span_ns
        return float(min(1.0, max(0.0, (place[1] - first_ns) / max(1, last_ns - first_ns))))

    def between(self, stream: str, t0_us: int, t1_us: int) -> Events:
        """Events with `t0_us <= t < t1_us`, in file order: one pass over the blocks that matter."""
        entries = [e for e in self._index(stream) if e.last_us >= t0_us and e.first_us < t1_us]
        if not entries:
            return Events.empty()
        messages = self._messages(stream, entries[0].place[0], entries[-1].place[1])
        parts = (within(events, t0_us, t1_us) for _, events in messages)
        return Events.concat([part for part in parts if len(part)])

    def _messages(self, stream: str, start_ns: int, stop_ns: int) -> Iterator[tuple[int, Events]]:
        with opened_bag(self.path) as bag:
            wanted = [c for c in bag.connections if c.topic == stream]
            for number, (_, stamp_ns, data) in enumerate(
                bag.messages(wanted, start=start_ns, stop=stop_ns)
            ):
                where = f"{self.path}, topic {quoted(stream)}, message {number} at {stamp_ns} ns"
                yield stamp_ns, array_events(data, self._ros2, where)

    def _first_size(self, bag: Any) -> None:
        """Takes the sensor's size from the first message of the first stream."""
        wanted = [c for c in bag.connections if c.topic == self.streams[0]]
        for _, _, data in bag.messages(wanted):
            head = array_head(data, self._ros2, f"{self.path}, topic {quoted(self.streams[0])}")
            if head.width_px and head.height_px:
                self.width_px, self.height_px = head.width_px, head.height_px
            return


@contextmanager
def opened_bag(path: Path) -> Iterator[Any]:
    """Opens a bag for reading.

    Raises:
        InputError: a missing or damaged bag; whatever the library says of it becomes one line.
    """
    from rosbags.rosbag1 import Reader as Reader1  # 0.2 s that other formats need not wait for
    from rosbags.rosbag2 import Reader as Reader2

    try:
        own = BoundedPath(path)
        with Reader2(own) if path.is_dir() else Reader1(own) as bag:
            if isinstance(bag, Reader1):
                bag.chunks = {at: _bounded(path, at, chunk) for at, chunk in bag.chunks.items()}
            yield bag
    except InputError:
        raise
    except Exception as error:  # damaged bags end in asserts, struct errors, decoders' own, ...
        raise InputError(
            f"{path}: cannot be read as a ROS bag ({said(error)}); it is cut off or damaged, "
            "reindex or record it again"
        ) from error


def _bounded(path: Path, at: int, chunk: Any) -> Any:
    """A ROS1 chunk whose unpacking ends at a bound; the library's own does not."""
    from rosbags.rosbag1.reader import decompressors

    kind = next(name for name, unpack in decompressors.items() if unpack is chunk.decompressor)
    if kind == "none":
        return chunk
    where = f"{path}, chunk at byte {at}"
    return chunk._replace(decompressor=partial(unpacked, compression=kind, where=where))
