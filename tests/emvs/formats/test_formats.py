"""Every format gives back event by event what was written, and refuses what it cannot hold."""

import shutil

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import naive_formats as naive
from event_files import ALL, READ_ONLY, WRITTEN, stream_of, write_any
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import FORMATS, open_events, write_events
from format_table import table
from made_events import assert_same_events, events_at
from places import ROOT
from refusals import refused

SORTED_ONLY = [name for name in WRITTEN if not FORMATS[name].limits.keeps_order]
# In a DAT file time that runs backwards by half its 32 bits or more is a loop; v2e has 32, too.
SHORT = ("dat", "v2e")
FREE = [name for name in ALL if FORMATS[name].limits.keeps_order and name not in SHORT]
SIZE_PX = (1280, 720)

steps_us = st.sampled_from([0, 0, 0, 0, 1, 999, 1000, 4096, 16_777_216, 17_000_000, 2**32 + 1])
dat_steps_us = st.sampled_from([0, 0, 0, 1, 999, 17_000_000, 2**31 - 1])  # it has no time words
starts_us = st.sampled_from([0, 1, 2**24 - 1, 2**32 - 1, 2**32 + 12345])
dat_starts_us = st.sampled_from([0, 1, 2**24 - 1, 2**31])
v2e_steps_us = st.sampled_from([0, 0, 0, 1, 999, 17_000_000])
v2e_starts_us = st.sampled_from([0, 1, 2**24 - 1, 2**31])
some = settings(max_examples=12)


@st.composite
def streams(draw, step=steps_us, start=starts_us):
    """Rows of a stream: from zero or late, stamps repeated, bursts, gaps, no events at all."""
    t_us, rows = draw(start), []
    for _ in range(draw(st.integers(0, 12))):
        t_us = max(0, t_us + draw(step))
        x, y = draw(st.integers(0, 1279)), draw(st.integers(0, 719))
        p, length = draw(st.integers(0, 1)), draw(st.integers(1, 40))
        rows += [(t_us, min(x + k, 1279), y, p) for k in range(length)]
    return rows


def streams_of(kind):
    """Rows that a format can hold."""
    if kind == "v2e":
        return streams(v2e_steps_us, v2e_starts_us)
    return streams(dat_steps_us, dat_starts_us) if kind == "dat" else streams()


def written(folder, kind, rows, cut=7):
    path = folder / f"{kind}{FORMATS[kind].suffix}"
    if path.is_dir():
        shutil.rmtree(path)
    parts = [naive.events_of(rows[:cut]), naive.events_of(rows[cut:])]
    return write_any(path, kind, SIZE_PX, parts)


def read(reader, size):
    parts = list(reader.chunks(reader.streams[0], size))
    assert all(1 <= len(part) <= size for part in parts)
    return naive.rows_of(Events.concat(parts))


@pytest.mark.parametrize("kind", ALL)
@some
@given(
    data=st.data(), size=st.integers(1, 100), slices=st.lists(st.integers(-5, 2**36), max_size=3)
)
def test_round_trip_event_by_event(tmp_path, kind, data, size, slices):
    rows = data.draw(streams_of(kind))
    path = written(tmp_path, kind, rows)
    if not path.stat().st_size:  # no events as plain text: nothing tells that from nothing at all
        assert (kind, rows) == ("text", [])
        return
    reader = open_events(path)
    assert reader.format == kind
    assert reader.streams == (stream_of(kind),)
    assert read(reader, size) == rows
    stamps = [row[0] for row in rows]
    for t0_us in slices + stamps[:2] + stamps[-2:]:
        for t1_us in (t0_us, t0_us + 1, t0_us + 17_000_000):
            expected = [row for row in rows if t0_us <= row[0] < t1_us]
            assert naive.rows_of(reader.between(reader.streams[0], t0_us, t1_us)) == expected
    if rows:
        assert reader.span_us(reader.streams[0]) == (stamps[0], stamps[-1])
    else:
        refused("no events", reader.span_us, reader.streams[0])


@pytest.mark.parametrize("kind", FREE)
@some
@given(rows=streams(st.sampled_from([0, 5, -3, -1000, 2000, -(2**33)])))
def test_stamps_that_run_backwards_survive_where_promised(tmp_path, kind, rows):
    if not rows:
        return
    reader = open_events(written(tmp_path, kind, rows))
    assert read(reader, 50) == rows
    stamps = sorted(row[0] for row in rows)
    middle = stamps[len(stamps) // 2]
    assert reader.span_us(reader.streams[0]) == (stamps[0], stamps[-1])
    late = [row for row in rows if row[0] >= middle]
    assert naive.rows_of(reader.between(reader.streams[0], middle, 2**62)) == late


@pytest.mark.parametrize("kind", SORTED_ONLY)
@pytest.mark.parametrize("cut", [1, 2])
def test_stamps_that_run_backwards_are_refused_elsewhere(tmp_path, kind, cut):
    refused("sort the events by time", written, tmp_path, kind, [(50, 1, 1, 1), (40, 1, 1, 1)], cut)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", WRITTEN)
def test_what_does_not_fit_is_refused_and_nothing_is_left_behind(tmp_path, kind):
    limits = FORMATS[kind].limits
    latest_us = min(limits.max_us, limits.max_span_us) + 1
    for words, rows in (
        ("outside the", [(0, 1280, 5, 1)]),
        ("0 to", [(-1, 5, 5, 1)]),
        ("shift the times|cut the recording", [(0, 5, 5, 1), (latest_us, 5, 5, 1)]),
    ):
        refused(words, written, tmp_path, kind, rows)
    if limits.max_x < 65535:
        wide_px = limits.max_x + 2
        refused("does not fit", write_events, tmp_path / "f", kind, wide_px, 720, {"events": []})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ALL)
def test_the_largest_pixel_of_the_format_survives(tmp_path, kind):
    limits = FORMATS[kind].limits
    path = tmp_path / "events"
    rows = [(3, limits.max_x, limits.max_y, 1), (3, 0, 0, 0), (4, limits.max_x, 0, 0)]
    size_px = limits.max_x + 1, limits.max_y + 1
    write_any(path, kind, size_px, [naive.events_of(rows)])
    assert read(open_events(path), 10) == rows


@pytest.mark.parametrize("kind", [k for k in WRITTEN if k not in ("evt2", "evt3", "tumvie")])
def test_the_latest_time_of_the_format_survives(tmp_path, kind):
    limits = FORMATS[kind].limits
    rows = [(limits.max_us - 1, 5, 5, 1), (limits.max_us, 6, 6, 0)]
    assert read(open_events(written(tmp_path, kind, rows)), 10) == rows


@pytest.mark.parametrize("kind", ["mvsec", "rosbag1", "aedat4"])
def test_two_streams_stay_apart(tmp_path, kind):
    left, right = (f"davis/{side}" for side in ("left", "right"))
    rows = {
        left: [(5 * k, k, 1, 1) for k in range(300)],
        right: [(7 * k, k, 2, 0) for k in range(200)],
    }
    packets = {
        name: [naive.events_of(part[i : i + 50]) for i in range(0, len(part), 50)]
        for name, part in rows.items()
    }
    told = []
    count = write_events(tmp_path / "f", kind, *SIZE_PX, packets, told.append)
    assert count == 500
    assert told == list(range(50, 501, 50))
    reader = open_events(tmp_path / "f")
    assert set(reader.streams) == {left, right}
    for name, expected in rows.items():
        assert naive.rows_of(Events.concat(list(reader.chunks(name, 64)))) == expected
        wanted = [row for row in expected if 100 <= row[0] < 701]
        assert naive.rows_of(reader.between(name, 100, 701)) == wanted
    refused("no stream 'middle'", reader.span_us, "middle")


@pytest.mark.parametrize("kind", [kind for kind in WRITTEN if FORMATS[kind].limits.streams < 99])
def test_streams_beyond_the_format_are_refused(tmp_path, kind):
    streams = {f"s{k}": [] for k in range(FORMATS[kind].limits.streams + 1)}
    refused("streams", write_events, tmp_path / "f", kind, *SIZE_PX, streams)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [*READ_ONLY, "tiff"])
def test_formats_that_are_only_read_are_named_so(tmp_path, kind):
    words = "cannot be written; choose one of evt2, evt3"
    refused(words, write_events, tmp_path / "f", kind, *SIZE_PX, {"events": []})


NO_SIZE = {
    "aedat3",
    "dsec",
    "tumvie",
    "mvsec",
    "m3ed",
    "v2e",
    "e2calib",
    "evimo2",
    "npy",
    "mat",
    "parquet",
}


@pytest.mark.parametrize("kind", [kind for kind in ALL if kind not in {*NO_SIZE, "text", "csv"}])
def test_the_sensor_size_is_kept_where_the_format_has_a_place_for_it(tmp_path, kind):
    reader = open_events(written(tmp_path, kind, [(5, 1, 2, 1)]))
    assert (reader.width_px, reader.height_px) == SIZE_PX


@pytest.mark.parametrize("kind", ALL)
def test_many_events_cross_the_blocks_of_the_reader(tmp_path, kind):
    rng = np.random.default_rng(3)
    n = 700_000
    events = events_at(rng, np.cumsum(rng.integers(0, 40, n)), *SIZE_PX)
    path, name = tmp_path / "f", stream_of(kind)
    write_any(path, kind, SIZE_PX, [events])
    reader = open_events(path)
    for t0_us, t1_us in ((0, 2**40), (3_000_000, 3_000_500), (5_000_000, 9_000_000)):
        part, expected = reader.between(name, t0_us, t1_us), events.between(t0_us, t1_us)
        assert_same_events(part, expected)


def test_events_before_the_first_time_word_are_left_out_and_counted(tmp_path):
    words = np.array([0x2001, 0x2002, 0x8000, 0x6005, 0x2003], "<u2")
    path = tmp_path / "f.raw"
    path.write_bytes(b"% evt 3.0\n% geometry 640x480\n% end\n" + words.tobytes())
    reader = open_events(path)
    assert read(reader, 9) == [(5, 3, 0, 0)]
    assert reader.untimed == 2


def test_dat_counts_the_loops_of_its_32_bits(tmp_path):
    head = b"% Data file containing CD events.\n% Version 2\n% Height 480\n% Width 640\n"
    rows = [(2**32 - 1, (1 << 28) | (7 << 14) | 5), (3, (8 << 14) | 6)]
    body = np.array(rows, "<u4").tobytes()
    (tmp_path / "f.dat").write_bytes(head + b"\x0c\x08" + body)
    reader = open_events(tmp_path / "f.dat")
    assert (reader.width_px, reader.height_px, reader.format) == (640, 480, "dat")
    assert read(reader, 9) == [(2**32 - 1, 5, 7, 1), (2**32 + 3, 6, 8, 0)]


def test_a_filter_that_is_not_installed_is_named_with_its_cure(tmp_path):
    if h5py.h5z.filter_avail(0x8ECF):
        pytest.skip("the ECF plug-in is installed here")
    with h5py.File(tmp_path / "f.hdf5", "w") as file:
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((16,))
        plist.set_filter(0x8ECF, h5py.h5z.FLAG_OPTIONAL)
        space = h5py.h5s.create_simple((16,), (h5py.h5s.UNLIMITED,))
        group = file.create_group("CD").id
        kind = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
        h5py.h5d.create(group, b"events", h5py.h5t.py_create(kind), space, plist)
    with pytest.raises(InputError, match=r"0x8ecf, which is not installed; install .*ECF plug-in"):
        open_events(tmp_path / "f.hdf5")


def test_dsec_as_its_publisher_types_it(tmp_path):
    with h5py.File(tmp_path / "events.h5", "w") as file:
        t = np.array([0, 10, 1500, 3000], np.uint32)
        for name, column in {"x": t * 0 + 5, "y": t * 0 + 6, "p": t % 2 * 0 + 1, "t": t}.items():
            file[f"events/{name}"] = column.astype({"t": "u4", "p": "u1"}.get(name, "u2"))
        file["ms_to_idx"] = np.array([0, 2, 3, 3], np.uint64)
        file["t_offset"] = np.int64(49_000_000_000)
    reader = open_events(tmp_path / "events.h5")
    assert reader.span_us("events") == (49_000_000_000, 49_000_003_000)
    part = reader.between("events", 49_000_000_010, 49_000_003_000)
    assert part.t_us.tolist() == [49_000_000_010, 49_000_001_500]


TEXTS = {
    "0.000100 1 2 1\n0.5 3 4 0\n": ("text", [(100, 1, 2, 1), (500_000, 3, 4, 0)]),
    "# t x y p\n100 1 2 1\n500000 3 4 -1\n": ("text", [(100, 1, 2, 1), (500_000, 3, 4, 0)]),
    "240 180\n0.5 3 4 0\n": ("esim-text", [(500_000, 3, 4, 0)]),
    "x,y,polarity,t_ns\n3,4,1,500\n": ("csv", [(1, 3, 4, 1)]),
    "timestamp,frame,x,y,p\n7,a,3,4,-1\n": ("csv", [(7, 3, 4, 0)]),
    "t x y p\r\n0.25 3 4 1\r\n": ("csv", [(250_000, 3, 4, 1)]),
}


@pytest.mark.parametrize("text", TEXTS)
def test_texts_as_they_come(tmp_path, text):
    (tmp_path / "events.any").write_text(text)
    reader = open_events(tmp_path / "events.any")
    assert (reader.format, read(reader, 9)) == TEXTS[text]


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize(("times", "expected"), [
    ({"t": np.array([5, 1_000_000])}, [5, 1_000_000]),
    ({"t": np.array([0.000005, 1.0])}, [5, 1_000_000]),
    ({"t_ns": np.array([5400, 10**9])}, [5, 1_000_000]),
    ({"t_s": np.array([0, 1])}, [0, 1_000_000]),
])  # fmt: skip
def test_npz_as_others_save_it(tmp_path, save, times, expected):
    x, p = np.array([1.0, 2.0]), np.array([True, False])
    save(tmp_path / "f.npz", x=x, y=x.astype(np.int32), p=p, **times)
    reader = open_events(tmp_path / "f.npz")
    rows = [(expected[0], 1, 1, 1), (expected[1], 2, 2, 0)]
    assert read(reader, 9) == rows
    assert naive.rows_of(reader.between("events", 0, 2**60)) == rows


def test_the_table_in_the_documentation_is_the_formats_own():
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    assert table() in page
