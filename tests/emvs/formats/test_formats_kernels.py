"""Every kernel of the event formats against its slow twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive_formats as naive
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.formats import prophesee_kernels
from eventsweep.emvs.formats.prophesee_kernels import LOOPS, initial_state
from eventsweep.emvs.formats.rosbag_kernels import decode_array, encode_array
from eventsweep.emvs.formats.tables.hdf5_kernels import convert_rows
from eventsweep.emvs.formats.tables.text_kernels import format_rows, parse_rows


def decode(kernel, words, room):
    """Runs a kernel with a small output again and again, as the reader does."""
    state, rows = initial_state(), []
    while len(words):
        events = Events.room(room)
        used, count, unknown = kernel(words, state, events.columns)
        rows += naive.rows_of(events.slice(0, count))
        if unknown:
            return rows, int(words[used])
        words = words[used:]
    return rows, None


def word_lists(kinds, bits):
    """Words of the kinds given, with any content."""
    word = st.tuples(st.sampled_from(kinds), st.integers(0, 2 ** (bits - 4) - 1))
    return st.lists(word.map(lambda kind: kind[0] << (bits - 4) | kind[1]), max_size=200)


@pytest.mark.parametrize(("kernel", "twin", "kind", "drawn"), [
    (prophesee_kernels.decode_evt2, naive.decode_evt2, np.uint32,
     word_lists([0, 1, 8, 8, 10, 14, 15], 32)),
    (prophesee_kernels.decode_evt21, naive.decode_evt21, np.uint64,
     word_lists([0, 1, 8, 10, 14, 15], 64)),
    (prophesee_kernels.decode_dat, naive.decode_dat, np.uint64,
     st.lists(st.integers(0, 2**61 - 1), max_size=200)),
])  # fmt: skip
@given(data=st.data(), room=st.integers(32, 70))
def test_words_equal_their_twin(kernel, twin, kind, drawn, data, room):
    words = data.draw(drawn)
    assert decode(kernel, np.array(words, kind), room) == (twin(words), None)


@given(word_lists([0, 2, 2, 3, 6, 7, 8, 10, 14, 15], 16), st.integers(32, 70))
def test_evt3_equals_its_twin(words, room):
    with_vectors = []
    for word in words:
        with_vectors += [word, 0x4A51, 0x4801, 0x5081] if word >> 12 == 3 else [word]
    rows, unknown = decode(prophesee_kernels.decode_evt3, np.array(with_vectors, np.uint16), room)
    if unknown is None:
        assert rows == naive.decode_evt3(with_vectors)
    else:
        assert unknown >> 12 in (4, 5)  # a vector that began beyond column 2047


@pytest.mark.parametrize("kind", [0x1, 0x9, 0xB, 0xC, 0xD])
def test_evt3_refuses_words_of_no_known_kind(kind):
    words = np.array([0x8000, 0x2001, kind << 12, 0x2002], np.uint16)
    assert decode(prophesee_kernels.decode_evt3, words, 32) == ([(0, 1, 0, 0)], kind << 12)


@pytest.mark.parametrize("kind", [2, 7, 9, 13])
def test_evt2_refuses_words_of_no_known_kind(kind):
    words = np.array([0x80000000, 0x10000801, kind << 28], np.uint32)
    assert decode(prophesee_kernels.decode_evt2, words, 32) == ([(0, 1, 1, 1)], kind << 28)


steps_us = st.sampled_from([0, 0, 0, 0, 1, 63, 64, 4095, 4096, 2**24, 2**24 + 1, 17_000_000, 2**35])
pixels = st.tuples(steps_us, st.integers(0, 2047), st.integers(0, 3), st.integers(0, 1))


@st.composite
def sorted_rows(draw):
    """Rows in the order of time: bursts, vectors, gaps of more than a loop of the counters."""
    t_us, rows = draw(st.sampled_from([0, 5, 2**24 - 1, 2**33])), []
    for step, x, y, p in draw(st.lists(pixels, max_size=25)):
        t_us += step
        length = draw(st.integers(1, 40))
        rows += [(t_us, min(x + k, 2047), y, p) for k in range(0, length, draw(st.integers(1, 4)))]
    return rows


@pytest.mark.parametrize(("encode", "twin", "kind", "bits"), [
    (prophesee_kernels.encode_evt2, naive.decode_evt2, np.uint32, 34),
    (prophesee_kernels.encode_evt3, naive.decode_evt3, np.uint16, 24),
])  # fmt: skip
@given(rows=sorted_rows(), cut=st.integers(0, 100))
def test_what_is_encoded_decodes_to_the_same_by_the_twin(encode, twin, kind, bits, rows, cut):
    state, words = prophesee_kernels.encoder_state(), []
    for part in filter(None, (rows[:cut], rows[cut:])):
        events = naive.events_of(part)
        room = 8 * len(part) + 3 * ((part[-1][0] >> bits) - int(state[LOOPS])) + 8
        out = np.empty(room, kind)
        count = encode(events.columns, state, out)
        assert count <= room
        words += out[:count].tolist()
    assert twin(words) == rows


def test_evt3_writes_dense_rows_as_vectors():
    rows = [(100, x, 7, 1) for x in range(640)]
    events, words = naive.events_of(rows), np.empty(8 * 640, np.uint16)
    state = prophesee_kernels.encoder_state()
    count = prophesee_kernels.encode_evt3(events.columns, state, words)
    assert count == 4 + 3 * 20  # time high and low, row, base, and 20 vectors of 32 columns
    assert naive.decode_evt3(words[:count]) == rows


times = st.integers(0, 2**32 - 1)
ros_rows = st.tuples(times, st.integers(0, 10**9 - 1), *[st.integers(0, 2**16 - 1)] * 2)


@given(st.lists(ros_rows, max_size=30), st.booleans())
def test_ros_arrays_equal_their_twin(rows, ros2):
    data = bytearray()
    for k, (seconds, nanoseconds, x, y) in enumerate(rows):
        for value, size in ((x, 2), (y, 2), (seconds, 4), (nanoseconds, 4), (k % 2, 1)):
            data += bytes(-len(data) % size if ros2 else 0) + value.to_bytes(size, "little")
    events, raw = Events.room(len(rows)), np.frombuffer(bytes(data), np.uint8)
    assert decode_array(raw, 16 if ros2 else 13, 2 if ros2 else 0, events.columns) == -1
    assert naive.rows_of(events) == naive.decode_ros(data, len(rows), ros2)


@given(st.lists(st.tuples(st.integers(0, 2**32 * 10**6 - 1), *[st.integers(0, 65535)] * 2)))
def test_ros_arrays_encode_what_the_twin_decodes(rows):
    rows = [(*row, k % 2) for k, row in enumerate(rows)]
    events, data = naive.events_of(rows), np.empty(13 * len(rows), np.uint8)
    encode_array(events.columns, data)
    assert naive.decode_ros(data, len(rows), False) == rows


@pytest.mark.parametrize(("at", "value"), [(11, 0xFF), (12, 2)])
def test_ros_arrays_name_an_impossible_event(at, value):
    data = np.zeros(39, np.uint8)
    data[13 + at] = value
    assert decode_array(data, 13, 0, Events.room(3).columns) == 1


finite = st.sampled_from([0.0, 1.0, 3.5, 65535.0, 65536.0, -1.0, np.nan, np.inf, 1e300, -0.0])
stamps_s = st.floats(0, 1e9) | st.sampled_from([-0.1, np.nan, np.inf, 1e300, 5e12])


@given(st.lists(st.tuples(finite, finite, stamps_s, st.sampled_from([1.0, -1.0, 0.0, 2.0]))))
def test_rows_of_doubles_equal_their_twin(rows):
    events = Events.room(len(rows))
    bad = convert_rows(np.array(rows, np.float64).reshape(-1, 4), events.columns)
    expected = naive.convert_rows(rows)
    assert bad == (len(expected) if len(expected) < len(rows) else -1)
    assert naive.rows_of(events.slice(0, len(expected))) == expected


def parse(text, power=6, whole=False, order=(0, 1, 2, 3)):
    data = np.frombuffer(text.encode("ascii"), np.uint8)
    events = Events.room(text.count("\n") + 1)
    count, bad = parse_rows(data, np.array(order, np.int64), power, whole, events.columns)
    return naive.rows_of(events.slice(0, count)), bad


decimals = st.one_of(
    st.decimals(0, 10**10, places=6, allow_nan=False),
    st.decimals(0, 10**6, places=9, allow_nan=False),
    st.integers(0, 10**12),
)


@given(
    st.lists(st.tuples(decimals, st.integers(0, 65535), st.sampled_from([-1, 0, 1]))),
    st.sampled_from([-3, 0, 3, 6]),
    st.sampled_from([" ", "\t", ",", ", ", "  "]),
)
def test_text_equals_its_twin(rows, power, gap):
    text = "".join(gap.join(map(str, (t, x, x // 2, p))) + "\n" for t, x, p in rows)
    assert parse(text, power) == (naive.parse_text(text, power), -1)


@given(st.floats(0, 1e9))
def test_text_takes_the_scientific_notation_of_savetxt(t_s):
    (row,), bad = parse(f"{t_s:.18e} 1.0e+00 2.00 1.000000e+00\n")
    assert bad == -1
    assert row == (round(t_s * 1e6), 1, 2, 1) or abs(row[0] - t_s * 1e6) <= 0.51


@pytest.mark.parametrize("line", [
    "1 2 3", "1 2 3 1 5", "-1 2 3 1", "1 -2 3 1", "1 2 65536 1", "1 2.5 3 1", "1 2 3 2",
    "x 2 3 1", "1 2 3 -", "1e 2 3 1", "1..2 2 3 1", "1e300 2 3 1", "9" * 30 + " 2 3 1",
    "nan 2 3 1", "inf 2 3 1", "1 2 3 1x", "0x1 2 3 1", ".", "-",
])  # fmt: skip
@pytest.mark.parametrize("end", ["", "\n"])
def test_text_points_at_a_bad_line(line, end):
    rows, bad = parse(f"0.5 1 1 1\n\n# remark\n{line}{end}")
    assert rows == [(500_000, 1, 1, 1)]
    assert bad == len("0.5 1 1 1\n\n# remark\n")


@given(st.lists(st.tuples(st.integers(0, 2**58), *[st.integers(0, 65535)] * 2)), st.booleans())
def test_text_that_is_written_reads_back(rows, seconds):
    rows = [(*row, k % 2) for k, row in enumerate(rows)]
    events, text = naive.events_of(rows), np.empty(48 * len(rows), np.uint8)
    size = format_rows(events.columns, seconds, ord(" "), text)
    assert size <= 48 * len(rows)
    written = bytes(text[:size]).decode("ascii")
    assert naive.parse_text(written, 6 if seconds else 0) == rows
    assert parse(written, 6 if seconds else 0, not seconds) == (rows, -1)
