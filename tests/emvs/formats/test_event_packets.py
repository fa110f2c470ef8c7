"""ROS2 bags of event_camera_msgs: written by the library's typed encoder, read without ROS."""

from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import naive_formats as naive
from event_files import (
    PACKET,
    PACKETS,
    evt3_payloads,
    libcaer_payloads,
    mono_payloads,
    packet,
    packet_types,
    write_packets,
)
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import blocks, open_events, rosbag
from eventsweep.emvs.formats.event_packets import TYPES, packet_events
from eventsweep.emvs.formats.prophesee_kernels import initial_state
from refusals import refused

SIZE_PX = (640, 480)
STORE = packet_types()
ROWS = [(5000 * k + 17 * (k % 3), k % 640, k // 7 % 480, k % 2) for k in range(4000)]
WORDS = st.sampled_from([0x8001, 0x8002, 0x6005, 0x0011, 0x2003, 0x2804, 0x3802, 0x4A05, 0x5081])
PAYLOADS = {
    "evt3": evt3_payloads(ROWS, range(1, 12_000, 37)),
    "mono": mono_payloads(ROWS),
    "libcaer_cmp": libcaer_payloads(ROWS),
}


def read(path):
    reader = open_events(path)
    assert (reader.format, reader.streams) == ("rosbag2", ("/events",))
    return naive.rows_of(Events.concat(list(reader.chunks("/events", 77))))


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("encoding", PAYLOADS)
@pytest.mark.parametrize("kind", TYPES)
def test_packets_of_both_storages(tmp_path, storage, encoding, kind):
    path = write_packets(
        tmp_path / "bag", SIZE_PX, PAYLOADS[encoding], encoding, storage, kind=kind
    )
    reader = open_events(path)
    assert (reader.width_px, reader.height_px) == SIZE_PX
    assert read(path) == ROWS
    assert reader.span_us("/events") == (ROWS[0][0], ROWS[-1][0])


def test_slices_take_up_the_stream_where_its_clock_wrapped(tmp_path, monkeypatch):
    """Times go beyond the 16.8 s of EVT3's counter; a block knows what those before it said."""
    monkeypatch.setattr("eventsweep.emvs.formats.rosbag._BLOCK_EVENTS", 300)
    path = write_packets(tmp_path / "bag", SIZE_PX, PAYLOADS["evt3"], "evt3")
    reader = open_events(path)
    assert ROWS[-1][0] > 1 << 24
    for t0_us in range(0, ROWS[-1][0], 1_700_000):
        expected = [row for row in ROWS if t0_us <= row[0] < t0_us + 900_000]
        assert naive.rows_of(reader.between("/events", t0_us, t0_us + 900_000)) == expected


@pytest.mark.slow
@settings(max_examples=30)
@given(
    words=st.lists(WORDS, max_size=40),
    cuts=st.lists(st.integers(0, 40), max_size=6),
)  # fmt: skip
def test_messages_are_one_stream_wherever_it_is_cut(words, cuts):
    whole = np.array(words, "<u2")
    state, found = initial_state(), []
    for part in np.split(whole, sorted(cuts)):
        found += naive.rows_of(packet_events(message(part.tobytes()), True, "here", state))
    assert found == naive.decode_evt3(words)


CAER_WORDS = st.sampled_from(
    [0x0001, 0x1005, 0x2003, 0x2804, 0x3007, 0x3811, 0x4805, 0x4010, 0x5081, 0x50FF, 0x5000]
)


@given(words=st.lists(CAER_WORDS, max_size=40))
def test_words_of_libcaer_mean_what_they_say_one_by_one(words):
    data = message(np.array(words, "<u2").tobytes(), "libcaer_cmp", time_base=7000)
    expected = decoded_libcaer(words, 7)
    if expected is None:
        with pytest.raises(InputError, match="before its column or time base"):
            packet_events(data, True, "here", initial_state())
        return
    assert naive.rows_of(packet_events(data, True, "here", initial_state())) == expected


def decoded_libcaer(words, base_us):
    """Rows of a packet; None where an event lacks its column or its base."""
    rows, high, low, column, base, sign = [], 0, 0, None, None, 0
    for word in words:
        kind, value = word >> 12, word & 0xFFF
        valid = [k for k in range(8) if value >> k & 1] if kind == 5 else []
        if ((kind == 3 or valid) and column is None) or (valid and base is None):
            return None
        match kind:
            case 0:
                high = value
            case 1:
                low = value
            case 2:
                column = value & 0x7FF
            case 4:
                base, sign = value & 0x7FF, value >> 11
        at_us = base_us + 4096 * high + low
        rows += [(at_us, column, value & 0x7FF, value >> 11)] if kind == 3 else []
        rows += [(at_us, column, base + k, sign) for k in valid]
        if kind == 5 and base is not None:
            base += 8
    return rows


def test_a_lone_mcap_file_is_a_bag(tmp_path):
    payloads = PAYLOADS["libcaer_cmp"]
    storage = StoragePlugin.MCAP
    path = write_packets(tmp_path / "bag", SIZE_PX, payloads, "libcaer_cmp", storage)
    lone = (path / "bag.mcap").rename(tmp_path / "lone")
    assert read(lone) == ROWS
    whole = lone.read_bytes()
    lone.write_bytes(whole[:-100])
    refused("cut off or damaged", open_events, lone)


def test_chunks_of_mcap_unpack_to_a_bound(tmp_path, monkeypatch):
    storage, packed = StoragePlugin.MCAP, CompressionMode.STORAGE
    write_packets(tmp_path / "bag", SIZE_PX, PAYLOADS["mono"], "mono", storage)
    with Ros2Reader(tmp_path / "bag") as plain:
        bag = Ros2Writer(tmp_path / "packed", version=9, storage_plugin=storage)
        bag.set_compression(packed, CompressionFormat.ZSTD)
        with bag:
            (old,) = plain.connections
            topic = bag.add_connection(
                "/events", old.msgtype, msgdef=old.msgdef.data, rihs01=old.digest
            )
            for _, stamp_ns, data in plain.messages():
                bag.write(topic, stamp_ns, data)
    path = tmp_path / "packed" / "packed.mcap"
    assert read(path) == ROWS
    monkeypatch.setattr(blocks, "MOST_BYTES", 20_000)
    refused(["unpacks to more than 20000 bytes", path], read, path)


REAL = Path(__file__).parents[3] / "../shared/data/real/test_events_2_0.mcap"


@pytest.mark.skipif(not REAL.exists(), reason="needs ../shared/data, no part of the project")
def test_a_real_mcap_file_of_a_davis346():
    reader = open_events(REAL)
    assert (reader.width_px, reader.height_px) == (346, 260)
    events = Events.concat(list(reader.chunks(*reader.streams)))
    # Counts, first time and sum of times as the tests of its publisher's decoder state them
    assert (np.count_nonzero(events.p == 0), np.count_nonzero(events.p)) == (360_223, 211_043)
    assert events.t_us[0] == 1_744_227_144_732_712
    assert (events.t_us - events.t_us[0]).sum() == 335_555_680_277
    assert len(events.checked(346, 260)) == len(events)


def message(payload, encoding="evt3", **changes):
    return packet(STORE, payload, encoding, **changes)


def test_ros1_bags_hold_packets_too(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = PACKETS
    store.register(get_types_from_msg(PACKET, kind))
    types, path = store.types, tmp_path / "f.bag"
    with Ros1Writer(path) as bag:
        topic = bag.add_connection("/events", kind, typestore=store)
        for seq, (stamp_ns, base_ns, payload) in enumerate(PAYLOADS["mono"]):
            stamp = types["builtin_interfaces/msg/Time"](0, 0)
            head = types["std_msgs/msg/Header"](seq, stamp, "cam" + "x" * (seq % 5))
            events = np.frombuffer(payload, np.uint8)
            one = types[kind](head, 480, 640, seq, base_ns, "mono", False, events)
            bag.write(topic, stamp_ns, store.serialize_ros1(one, kind))
    reader = open_events(path)
    assert reader.format == "rosbag1"
    assert naive.rows_of(Events.concat(list(reader.chunks("/events")))) == ROWS


@pytest.mark.parametrize(("payload", "changes", "message_"), [
    (b"", {"encoding": "libcaer"}, "coded as libcaer; supported: evt3, mono, libcaer_cmp"),
    (b"", {"encoding": "trigger"}, "coded as trigger; supported: evt3, mono"),
    (b"", {"is_bigendian": True}, "evt3, big-endian; supported"),
    (bytes(7), {}, "7 bytes of evt3 are no multiple of its 2-byte"),
    (bytes(12), {"encoding": "mono"}, "12 bytes of mono are no multiple of its 8-byte"),
    (bytes(8), {"encoding": "mono", "time_base": 1 << 63}, "time_base"),
    (b"\x00\x11", {}, "word 0: 0x1100 is not a word of EVT3"),
])  # fmt: skip
def test_what_is_no_packet_is_refused_by_name(tmp_path, payload, changes, message_):
    encoding = changes.pop("encoding", "evt3")
    path = write_packets(tmp_path / "bag", SIZE_PX, [(5, 0, payload)], encoding, **changes)
    refused([message_, path], list, open_events(path).chunks("/events"))


def test_packets_that_declare_too_much():
    whole = message(bytes(40))
    for cut in range(len(whole)):
        with pytest.raises(InputError, match=r"here: (message ends|40 bytes|not encoded)"):
            packet_events(whole[:cut], True, "here", initial_state())
    refused("present", packet_events, whole + bytes(4), True, "here", initial_state())


def test_nanoseconds_are_rounded():
    words = np.array([1499 | 3 << 32 | 4 << 48 | 1 << 63, 1500], "<u8")
    found = packet_events(message(words.tobytes(), "mono"), True, "here", initial_state())
    assert naive.rows_of(found) == [(1, 3, 4, 1), (2, 0, 0, 0)]


class Misled:
    """A bag whose index says other times of recording than its messages have."""

    def __init__(self, bag, stamps):
        self._bag, self._stamps = bag, stamps

    def __getattr__(self, name):
        return getattr(self._bag, name)

    def messages(self, *wanted, start=0, stop=1 << 62):
        for number, (topic, _, data) in enumerate(self._bag.messages(*wanted)):
            stamp_ns = self._stamps(number, start)
            if start <= stamp_ns < stop:
                yield topic, stamp_ns, data


@pytest.mark.parametrize(("stamps", "message_"), [
    (lambda number, start: 500 - number, "recorded earlier than the message before it"),
    (lambda number, start: number if number < 9 or not start else -1, "found by its index"),
])  # fmt: skip
def test_a_bag_whose_index_misleads_is_refused(tmp_path, monkeypatch, stamps, message_):
    """Otherwise slices, which are found by times of recording, would lose events in silence."""
    path = write_packets(tmp_path / "bag", SIZE_PX, PAYLOADS["mono"], "mono")
    opened = rosbag.opened_bag

    @contextmanager
    def misled(path):
        with opened(path) as bag:
            yield Misled(bag, stamps)

    monkeypatch.setattr(rosbag, "opened_bag", misled)
    monkeypatch.setattr(rosbag, "_BLOCK_EVENTS", 300)
    reader = open_events(path)
    refused([message_, path], reader.between, "/events", ROWS[1000][0], ROWS[2000][0])
