"""Writes ROS1 bags with `dvs_msgs/EventArray` messages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from emvs.data.events import Events
from emvs.io.events.ros_messages import TYPES, array_bytes
from emvs.io.events.writer import StreamWriter

_EVENT = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
_ARRAY = "Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"


class RosbagWriter(StreamWriter):
    """Appends messages of up to 16384 events; the times of recording never run backwards."""

    packet = 1 << 14

    def __init__(self, path: Path, width_px: int, height_px: int, names: Sequence[str]) -> None:
        self._size_px = (width_px, height_px)
        store = get_typestore(Stores.ROS1_NOETIC)
        store.register(
            get_types_from_msg(_EVENT, "dvs_msgs/msg/Event") | get_types_from_msg(_ARRAY, TYPES[0])
        )
        path.unlink(missing_ok=True)  # the library insists on making the file
        self._bag = Writer(path)
        self._bag.open()
        self._topics = {
            name: self._bag.add_connection(name, TYPES[0], typestore=store) for name in names
        }
        self._last_us = dict.fromkeys(names, 0)
        self._sequence = dict.fromkeys(names, 0)

    def _put(self, stream: str, events: Events) -> None:
        """Writes a message, recorded when its last event happened."""
        self._last_us[stream] = max(self._last_us[stream], int(events.t_us.max()))
        data = array_bytes(events, self._sequence[stream], *self._size_px)
        self._bag.write(self._topics[stream], self._last_us[stream] * 1000, data)
        self._sequence[stream] += 1

    def _close(self) -> None:
        self._bag.close()
