"""Packed events in ROS messages: `event_camera_msgs/EventPacket` and its predecessor.

A packet is a head and the bytes of an encoding. `evt3` is the sensor's own stream, cut into
messages: what one says of times and rows holds in the next, and times are the sensor's, as
event_camera_codecs takes them. `mono` has a word per event, whose 32 bits of ns count from the
packet's `time_base`. `libcaer_cmp`, of iniVation's cameras, codes columns before rows in words like
those of `evt3`, and counts µs from the `time_base` of each packet anew.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError, quoted
from eventsweep.emvs.formats.prophesee import CODINGS, decode_words
from eventsweep.emvs.formats.prophesee_kernels import State

TYPES = ("event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray")
ENCODINGS = ("evt3", "mono", "libcaer_cmp")
_MOST_NS = 1 << 62
# Kinds of words of `libcaer_cmp`
_TIME_HIGH, _TIME_LOW, _ADDR_X, _ADDR_Y, _VECT_BASE_Y, _VECT_8 = range(6)


class PacketHead(NamedTuple):
    """What stands before the bytes of a packet, which begin at `start`; `mono` counts from a base.

    `is_bigendian` says whether a machine of the other byte order wrote the events.
    """

    width_px: int
    height_px: int
    time_base_ns: int
    encoding: str
    is_bigendian: bool
    start: int
    size: int


class Fields:
    """Reads a message field by field, aligned as ROS2 does (CDR) or packed as ROS1 does."""

    def __init__(self, data: bytes | memoryview, ros2: bool) -> None:
        self._data, self._ros2 = data, ros2
        self.at = 4 if ros2 else 0  # behind the encapsulation, from which CDR aligns

    def number(self, code: str) -> int:
        """A number, by its `struct` code."""
        size = struct.calcsize(code)
        self.at += -(self.at - 4) % size if self._ros2 else 0
        (value,) = struct.unpack_from(f"<{code}", self._data, self.at)
        self.at += size
        return int(value)

    def text(self) -> str:
        """A text, which may end in zeros."""
        size = self.number("I")
        if self.at + size > len(self._data):
            raise struct.error(f"a text of {size} bytes")
        word = bytes(self._data[self.at : self.at + size])
        self.at += size
        return word.rstrip(b"\0").decode("ascii", "replace")


@contextmanager
def message_fields(data: bytes | memoryview, ros2: bool, where: str) -> Iterator[Fields]:
    """Yields a message's fields behind its header; one that ends too early is refused."""
    if ros2 and bytes(data[:2]) != b"\x00\x01":
        raise InputError(f"{where}: not encoded as little-endian CDR; record the bag again")
    fields = Fields(data, ros2)
    try:
        for _ in range(2 if ros2 else 3):  # ROS1 counts messages before the stamp
            fields.number("I")
        fields.text()
        yield fields
    except struct.error as error:
        raise InputError(f"{where}: message ends before its events ({error}); damaged") from error


def packet_head(data: bytes | memoryview, ros2: bool, where: str) -> PacketHead:
    """Reads the fields before the events, and checks that the events are all there."""
    with message_fields(data, ros2, where) as fields:
        height, width = fields.number("I"), fields.number("I")
        fields.number("Q")
        time_base_ns, encoding = fields.number("Q"), fields.text()
        is_bigendian, size = bool(fields.number("B")), fields.number("I")
    excess = len(data) - fields.at - size
    if excess < 0 or (excess and not ros2) or excess > 3:  # CDR may pad to four bytes
        raise InputError(
            f"{where}: {size} bytes of events declared, {len(data) - fields.at} present; the "
            "message is damaged, record the bag again"
        )
    return PacketHead(width, height, time_base_ns, encoding, is_bigendian, fields.at, size)


def packet_events(data: bytes | memoryview, ros2: bool, where: str, state: State) -> Events:
    """The events of a packet, in whole µs; `state`, what the decoder knows, is updated."""
    head = packet_head(data, ros2, where)
    if head.encoding not in ENCODINGS or head.is_bigendian:
        order = ", big-endian" * head.is_bigendian
        raise InputError(
            f"{where}: events encoded as {quoted(head.encoding)}{order}; supported: "
            f"{', '.join(ENCODINGS)}, little-endian; convert the bag with event_camera_tools"
        )
    word = 8 if head.encoding == "mono" else 2
    if head.size % word:
        raise InputError(
            f"{where}: {head.size} bytes of {head.encoding} are no multiple of its {word}-byte "
            "words; damaged"
        )
    if head.encoding != "evt3" and head.time_base_ns >= _MOST_NS:
        raise InputError(
            f"{where}: time_base {head.time_base_ns} ns; needs less than 2^62 ns, damaged"
        )
    payload = data[head.start : head.start + head.size]
    if word == 8:
        return _mono(np.frombuffer(payload, "<u8"), head.time_base_ns)
    if head.encoding == "libcaer_cmp":
        return _libcaer_cmp(np.frombuffer(payload, "<u2"), head.time_base_ns, where)
    words, parts = np.frombuffer(payload, "<u2"), []
    while len(words):
        used, events = decode_words(CODINGS["EVT3"], words, state, lambda k: f"{where}, word {k}")
        parts.append(events)
        words = words[used:]
    return Events.concat(parts)


def _libcaer_cmp(words: np.ndarray, base_ns: int, where: str) -> Events:
    """A word is a kind (4 bits) and a value (12); times, columns and bases hold until replaced."""
    kind, value = words >> 12, (words & 0xFFF).astype(np.int64)
    is_vector = kind == _VECT_8
    valid = (value[:, None] >> np.arange(8)) & 1 > 0  # rows of a vector, from its base on
    valid &= is_vector[:, None]
    valid[:, 0] |= kind == _ADDR_Y
    word, bit = np.nonzero(valid)
    before = {code: _latest(kind == code) for code in range(_VECT_8)}
    base = np.where(is_vector, before[_VECT_BASE_Y], np.arange(len(words)))
    unknown = (kind > _VECT_8) | (valid.any(axis=1) & ((base < 0) | (before[_ADDR_X] < 0)))
    if unknown.any():
        k = int(np.argmax(unknown))
        raise InputError(
            f"{where}, word {k}: 0x{words[k]:04X} is unknown, or an event before its column or "
            "time base; damaged, record the bag again"
        )
    vectors = np.cumsum(is_vector)
    row = (value & 0x7FF)[base] + np.where(is_vector, 8 * (vectors - vectors[base] - 1), 0)
    high, low = (np.where(k < 0, 0, value[k]) for k in (before[_TIME_HIGH], before[_TIME_LOW]))
    t_us = ((high << 12 | low) * 1000 + base_ns + 500) // 1000
    x = (value & 0x7FF)[before[_ADDR_X]]
    columns = x.astype(np.uint16)[word], (row[word] + bit).astype(np.uint16), t_us[word]
    return Events(*columns, (value[base] >> 11).astype(np.uint8)[word])


def _latest(here: np.ndarray) -> np.ndarray:
    """For each place the last one, itself included, that is marked; -1 where there is none."""
    return np.maximum.accumulate(np.where(here, np.arange(len(here)), -1))


def _mono(words: np.ndarray, base_ns: int) -> Events:
    t_ns = (words & 0xFFFFFFFF).astype(np.int64) + base_ns
    x, y = (words >> 32) & 0xFFFF, (words >> 48) & 0x7FFF
    columns = x.astype(np.uint16), y.astype(np.uint16), (t_ns + 500) // 1000
    return Events(*columns, (words >> 63).astype(np.uint8))
