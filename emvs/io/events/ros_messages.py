"""The `EventArray` messages of dvs_msgs and prophesee_event_msgs, from and to bytes."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.ros_kernels import decode_array, encode_array

TYPES = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray")
EVENT_BYTES = 13


@dataclass(frozen=True, slots=True)
class ArrayHead:
    """What stands before the events of a message: sensor size, event count, where they begin."""

    width_px: int
    height_px: int
    count: int
    start: int


def array_head(data: bytes | memoryview, ros2: bool, where: str) -> ArrayHead:
    """Reads the fields before the events, and checks that the events are all there.

    Args:
        data: a message, as the bag holds it.
        ros2: whether it is coded as ROS2 does (CDR), else as ROS1 does.
        where: file and place, for the error's sake.

    Raises:
        InputError: a message that is too short for what it declares.
    """
    if ros2 and bytes(data[:2]) != b"\x00\x01":
        raise InputError(f"{where}: coded other than little-endian CDR; record the bag again")
    at = 12  # behind sequence number and stamp, or encapsulation and stamp
    try:
        at += 4 + struct.unpack_from("<I", data, at)[0]
        at += -at % 4 if ros2 else 0
        height, width, count = struct.unpack_from("<III", data, at)
    except struct.error as error:
        raise InputError(f"{where}: message ends before its events ({error}); damaged") from error
    start = at + 12
    size = (16 * count - 3 if count else 0) if ros2 else EVENT_BYTES * count
    if start + size > len(data) or (not ros2 and start + size != len(data)):
        raise InputError(
            f"{where}: {count} events need {size} bytes, {len(data) - start} are there; the "
            "message is damaged, record the bag again"
        )
    return ArrayHead(width, height, count, start)


def array_events(data: bytes | memoryview, ros2: bool, where: str) -> Events:
    """The events of a message; nanoseconds are rounded to µs.

    Raises:
        InputError: a damaged message.
    """
    head = array_head(data, ros2, where)
    n = head.count
    x, y = np.empty(n, np.uint16), np.empty(n, np.uint16)
    t_us, p = np.empty(n, np.int64), np.empty(n, np.uint8)
    raw = np.frombuffer(data, np.uint8)[head.start :]
    bad = decode_array(raw, 16 if ros2 else EVENT_BYTES, 2 if ros2 else 0, x, y, t_us, p)
    if bad >= 0:
        raise InputError(
            f"{where}: event {bad} of {n} has 10^9 nanoseconds or more, or a polarity beyond 1; "
            "the message is damaged, record the bag again"
        )
    return Events(x, y, t_us, p)


def array_bytes(events: Events, sequence: int, width_px: int, height_px: int) -> bytes:
    """A ROS1 message that holds the events; its stamp is that of the first one."""
    seconds, rest_us = divmod(int(events.t_us[0]), 1_000_000)
    head = struct.pack("<IIII", sequence & 0xFFFFFFFF, seconds, rest_us * 1000, 0)
    head += struct.pack("<III", height_px, width_px, len(events))
    data = np.empty(EVENT_BYTES * len(events), np.uint8)
    encode_array(events.x, events.y, events.t_us, events.p, data)
    return head + data.tobytes()
