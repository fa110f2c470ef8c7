"""AEDAT 2.0 and 3.1: equal to a slow decoder, what is no event is passed over, damage is told."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import event_files
import naive_formats as naive
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.formats import open_events
from refusals import refused

CHIPS_PX = [(128, 128), (240, 180), (346, 260), (640, 480)]
HEAD_3 = b"#!AER-DAT3.1\r\n#Format: RAW\r\n%b#!END-HEADER\r\n"
SOURCE = b"#Source 1: DAVIS346\r\n"


def head_2(chip):
    return f"#!AER-DAT2.0\r\n# This is a raw AE data file\r\n# AEChip: {chip}\r\n".encode()


def read(path):
    reader = open_events(path)
    return naive.rows_of(Events.concat(list(reader.chunks(reader.streams[0]))))


def wrote(path, *parts):
    path.write_bytes(b"".join(parts))
    return path


@pytest.mark.parametrize("size_px", CHIPS_PX)
@given(data=st.data())
def test_written_addresses_come_back(tmp_path, size_px, data):
    step = st.sampled_from([0, 1, 999, 2**31 - 1])
    rows, t_us = [], data.draw(st.sampled_from([0, 5, 2**31, 2**32 - 1]))
    for _ in range(data.draw(st.integers(1, 9))):
        t_us += data.draw(step) if rows else 0  # 32 bits cannot say how often they looped before
        place = (data.draw(st.integers(0, most - 1)) for most in size_px)
        rows.append((t_us, *place, data.draw(st.integers(0, 1))))
    path = tmp_path / "f.aedat"
    event_files.write_any(path, "aedat2", size_px, [naive.events_of(rows)])
    reader = open_events(path)
    assert (reader.format, reader.streams) == ("aedat2", ("events",))
    assert (reader.width_px, reader.height_px) == size_px
    assert read(path) == rows
    part = [row for row in rows if rows[0][0] <= row[0] < rows[-1][0]]
    assert naive.rows_of(reader.between("events", rows[0][0], rows[-1][0])) == part


@pytest.mark.parametrize(("chip", "size_px"), [
    ("ch.unizh.ini.jaer.chip.retina.DVS128", (128, 128)), ("Davis346Blue", (346, 260)),
    ("eu.seebetter.ini.chips.davis.DAVIS240C", (240, 180)),
])  # fmt: skip
@given(words=st.lists(st.tuples(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1)), max_size=30))
def test_any_words_are_those_of_the_slow_decoder(tmp_path, chip, size_px, words):
    mask = 0x8000FFFF if size_px == (128, 128) else 0x9BCDFFFF & ~(1 << 29)  # on the chip
    body = b"".join(struct.pack(">II", address & mask, t) for address, t in words)
    path = wrote(tmp_path / "f", head_2(chip), body)
    expected = naive.decode_aedat2(body, size_px)
    if all(x >= 0 and y >= 0 for _, x, y, _ in expected):
        assert read(path) == expected
    else:
        refused("lies off the", read, path)


def test_by_hand():
    """The lowest, leftmost pixel of jAER's picture is our lower right one."""
    assert naive.decode_aedat2(struct.pack(">II", 0, 7), (128, 128)) == [(7, 127, 127, 1)]
    assert naive.decode_aedat2(struct.pack(">II", 1 << 11, 7), (240, 180)) == [(7, 239, 179, 1)]


def test_frames_triggers_and_samples_are_passed_over(tmp_path):
    on = 3 << 22 | 5 << 12 | 1 << 11
    marks = [1 << 31, 1 << 31 | 5 << 28, 1 << 10, 1 << 31 | on]
    body = b"".join(struct.pack(">II", a, k) for k, a in enumerate([*marks, on, on | 1 << 10]))
    assert read(wrote(tmp_path / "f", head_2("DAVIS240C"), body)) == [(4, 234, 176, 1)]
    body = b"".join(struct.pack(">II", a, 9) for a in (1 << 15, 3 << 8 | 5 << 1, 1 << 31))
    assert read(wrote(tmp_path / "f", head_2("DVS128"), body)) == [(9, 122, 124, 1)]


def test_a_chip_that_is_not_named_is_known_by_its_short_addresses_or_asked_for(tmp_path):
    head, one = b"#!AER-DAT2.0\r\n# Timestamps tick is 1 us\r\n", struct.pack(">II", 11, 1)
    assert read(wrote(tmp_path / "f", head, one)) == [(1, 122, 127, 0)]
    davis = struct.pack(">II", 1 << 22, 1)
    refused("chip unknown; needs a line `# AEChip", open_events, wrote(tmp_path / "f", head, davis))
    late = one * (1 << 18) + davis
    refused("lies off", read, wrote(tmp_path / "f", head, late))
    for chip in ("SecDvs640Gen2", "DAVIS999"):
        refused(f"chip.*{chip}", open_events, wrote(tmp_path / "f", head_2(chip), davis))
    refused("cut off in the middle", open_events, wrote(tmp_path / "f", head, one, b"\0\0\0"))


def test_data_that_begin_like_a_comment_are_no_header(tmp_path):
    on = 0x23 << 24 | 1 << 12
    body = struct.pack(">II", on, 0x0A0A0A0A) * 3
    assert len(read(wrote(tmp_path / "f", head_2("DAVIS346"), body))) == 3


def events(rows):
    return naive.events_of(rows)


@given(st.lists(st.tuples(st.integers(0, 2**40), st.integers(0, 32767), st.integers(0, 32767),
                          st.integers(0, 1), st.booleans()), min_size=1, max_size=20))  # fmt: skip
def test_packets_are_those_of_the_slow_decoder(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("aedat") / "f"
    body = b"".join(event_files.aedat3_packet(events([row[:4]]), valid=int(row[4])) for row in rows)
    frame = struct.pack("<hhiiiiii", 2, 1, 50, 10, 0, 2, 2, 2) + b"\xff" * 100
    body = frame + body + frame
    wrote(path, HEAD_3 % SOURCE, body)
    expected = naive.decode_aedat3(body)
    assert expected == [row[:4] for row in rows if row[4]]
    assert read(path) == expected
    assert (open_events(path).width_px, open_events(path).height_px) == (346, 260)


def test_sources_are_streams_and_never_mixed(tmp_path):
    packets = [event_files.aedat3_packet(events([(k, k, k, 1)]), source=k) for k in (1, 2, 1)]
    two = SOURCE + b"#Source 2: DVS128\r\n#-Source 1: Processor\r\n"
    reader = open_events(wrote(tmp_path / "f", HEAD_3 % two, *packets))
    assert reader.streams == ("events-1", "events-2")
    assert [reader.count(name) for name in reader.streams] == [2, 1]
    refused("source 2 beside 1", read, wrote(tmp_path / "f", HEAD_3 % SOURCE, *packets))
    three = event_files.aedat3_packet(events([(3, 3, 3, 1)]), source=3)
    refused("source 3 beside 1, 2", read, wrote(tmp_path / "f", HEAD_3 % two, three))
    for head in (SOURCE, b""):  # as some programs number their only source otherwise
        assert len(read(wrote(tmp_path / "f", HEAD_3 % head, packets[1]))) == 1


@pytest.mark.parametrize(("head", "words"), [
    ((1, 1, 8, 4, 0, 9, 9, 9), "9 events of 8 bytes"), ((1, 1, 0, 4, 0, 1, 1, 1), "of 0 bytes"),
    ((1, 1, 8, 4, 0, 1, -1, 1), "-1 events"), ((1, 1, 4, 4, 0, 1, 2, 1), "events of 4 bytes"),
    ((-32767, 1, 8, 4, 0, 1, 1, 1), "compressed"), ((1, 1, 8, 4, -1, 1, 1, 1), "damaged"),
    ((1, 1, 2**31 - 1, 4, 0, 1, 2**31 - 1, 1), "are left"), ((1, 1, 8, 0, 0, 1, 1, 1), "RAW"),
    ((1, 1, 8, 4, 2**31 - 1, 1, 1, 1), "2^62"),
])  # fmt: skip
def test_heads_that_lie_are_refused(tmp_path, head, words):
    body = struct.pack("<hhiiiiii", *head) + b"\xff" * 8
    refused(words.replace("^", r"\^"), read, wrote(tmp_path / "f", HEAD_3 % SOURCE, body))


def test_other_files_of_the_family_are_named(tmp_path):
    text = b"#!AER-DAT3.1\r\n#Format: SerializedTS\r\n#!END-HEADER\r\n"
    refused("compressed .SerializedTS.*RAW", open_events, wrote(tmp_path / "f", text))
    for version in (b"1.0", b"3.0", b"5.0"):
        refused("not AEDAT 2.0, 3.1 or 4.0", open_events, wrote(
            tmp_path / "f", b"#!AER-DAT" + version + b"\r\n" + bytes(40)))  # fmt: skip
    long = b"#!AER-DAT2.0\r\n" + b"# a\r\n" * (1 << 14)
    refused("a header of more than", open_events, wrote(tmp_path / "f", long))


def test_blocks_cover_a_large_file(tmp_path):
    rng, count = np.random.default_rng(0), 400_000
    t_us = np.cumsum(rng.integers(0, 40_000, count))
    x, y = (rng.integers(0, most, count).astype(np.uint16) for most in (346, 260))
    whole = Events(x, y, t_us, (x & 1).astype(np.uint8))
    for kind in ("aedat2", "aedat3"):
        path = event_files.write_any(tmp_path / kind, kind, (346, 260), [whole])
        reader = open_events(path)
        assert reader.count("events") == count
        assert reader.span_us("events") == (t_us[0], t_us[-1])
        part = reader.between("events", int(t_us[131_000]), int(t_us[131_100]))
        assert naive.rows_of(part) == naive.rows_of(whole.slice(131_000, 131_100))
