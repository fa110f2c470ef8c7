"""Independent libraries read what is written here, and what they write is read here.

faery (EVT2, EVT3, DAT, AEDAT4, CSV), expelliarmus (EVT2, DAT; its EVT3 loses the high part of
times when it writes, and adds 4096 µs for each low part that falls when it reads), dv-processing
(AEDAT4, iniVation's own), rosbags (ROS messages through its typed decoder), h5py as the publishers
of DSEC, TUM-VIE and MVSEC use it, and HDF5's own loader of filters.
"""

import os
import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

import naive_formats as naive
from event_files import CD
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.formats import FORMATS, open_events, write_events

SIZE_PX = (1280, 720)
NO_EXPELLIARMUS = "expelliarmus is not installed: its wheels end with Python 3.11, on x86_64"


def rows(gap_us, start_us=0):
    """Bursts along rows, repeated stamps, noise, and gaps."""
    rng = np.random.default_rng(8)
    t_us, out = start_us, []
    for k in range(300):
        t_us += int(rng.choice([0, 1, 70, 5000])) + (gap_us if k in (100, 200) else 0)
        x, y, p = int(rng.integers(0, 1280)), int(rng.integers(0, 720)), int(rng.integers(0, 2))
        step = int(rng.integers(1, 5))
        out += [(t_us, c, y, p) for c in range(x, min(x + int(rng.integers(1, 70)), 1280), step)]
    return out


def written(folder, kind, expected):
    path = folder / f"events{FORMATS[kind].suffix}"
    write_events(path, kind, *SIZE_PX, {"events": [naive.events_of(expected)]})
    return path


def read(path):
    reader = open_events(path)
    return naive.rows_of(Events.concat(list(reader.chunks(reader.streams[0]))))


def structured(expected):
    """Rows as the libraries hold them."""
    events = naive.events_of(expected)
    out = np.zeros(len(events), [("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
    out["t"], out["x"], out["y"], out["on"] = events.t_us, events.x, events.y, events.p
    return out


def tuples(array):
    t, x, y, p = (array[name].tolist() for name in array.dtype.names)
    return [(int(a), b, c, int(d)) for a, b, c, d in zip(t, x, y, p, strict=True)]


@pytest.mark.parametrize(
    ("kind", "gap_us"),
    [("evt2", 40_000_000), ("evt3", 0), ("evt3", 17_000_000), ("evt3", 2**33), ("aedat4", 2**33)],
)
def test_faery_reads_what_is_written(tmp_path, kind, gap_us):
    faery = pytest.importorskip("faery", reason="faery is not installed (extra `dev`)")
    path = written(tmp_path, kind, rows(gap_us))
    assert tuples(faery.events_stream_from_file(path).to_array()) == rows(gap_us)


@pytest.mark.parametrize(("name", "version", "kind"), [
    ("f.raw", "evt2", "evt2"), ("f.raw", "evt3", "evt3"), ("f.dat", "dat2", "dat"),
    ("f.aedat4", None, "aedat4"), ("f.csv", None, "csv"),
])  # fmt: skip
def test_what_faery_writes_is_read(tmp_path, name, version, kind):
    faery = pytest.importorskip("faery", reason="faery is not installed (extra `dev`)")
    path, expected = tmp_path / name, rows(6_000_000)
    table = structured(expected).astype(faery.EVENTS_DTYPE)
    stream = faery.events_stream_from_array(table, SIZE_PX)
    stream.to_file(path, version=version, zero_t0=False)
    reader = open_events(path)
    assert reader.format == kind
    assert read(path) == expected
    assert (reader.width_px, reader.height_px) == SIZE_PX


@pytest.mark.parametrize("compression", [("lz4", 1), ("zstd", 3), None])
def test_every_compression_of_aedat4_is_read(tmp_path, compression):
    faery = pytest.importorskip("faery", reason="faery is not installed (extra `dev`)")
    path, expected = tmp_path / "f.aedat4", rows(0)
    table = structured(expected).astype(faery.EVENTS_DTYPE)
    stream = faery.events_stream_from_array(table, SIZE_PX)
    stream.to_file(path, compression=compression, zero_t0=False)
    assert read(path) == expected


@pytest.mark.parametrize("gap_us", [0, 40_000_000])
def test_expelliarmus_reads_what_is_written(tmp_path, gap_us):
    expelliarmus = pytest.importorskip("expelliarmus", reason=NO_EXPELLIARMUS)
    path = written(tmp_path, "evt2", rows(gap_us))
    assert tuples(expelliarmus.Wizard(encoding="evt2", fpath=path).read()) == rows(gap_us)


@pytest.mark.parametrize(("kind", "name"), [("evt2", "f.raw"), ("dat", "f.dat")])
def test_what_expelliarmus_writes_is_read(tmp_path, kind, name):
    expelliarmus = pytest.importorskip("expelliarmus", reason=NO_EXPELLIARMUS)
    path, expected = tmp_path / name, rows(2_000_000)
    array = np.zeros(len(expected), [("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "u1")])
    table = structured(expected)
    for name, other in zip("txyp", ("t", "x", "y", "on"), strict=True):
        array[name] = table[other]
    expelliarmus.Wizard(encoding=kind).save(fpath=path, arr=array)
    assert read(path) == expected


@pytest.mark.parametrize("start_us", [0, 1_468_939_993_000_000])
def test_dv_processing_reads_what_is_written(tmp_path, start_us):
    dv = pytest.importorskip("dv_processing", reason="dv-processing is not installed")
    expected = rows(2**33, start_us + 1)
    path = written(tmp_path, "aedat4", expected)
    recording = dv.io.MonoCameraRecording(str(path))
    assert recording.getEventResolution() == SIZE_PX
    assert recording.getTimeRange() == (expected[0][0], expected[-1][0])
    batches = []
    while (batch := recording.getNextEventBatch()) is not None:
        batches += batch.numpy().tolist()
    assert [tuple(map(int, row)) for row in batches] == expected
    middle = expected[len(expected) // 2][0]
    part = recording.getEventsTimeRange(middle, expected[-1][0])
    assert part.size() == sum(middle <= row[0] < expected[-1][0] for row in expected)


def test_what_dv_processing_writes_is_read(tmp_path):
    dv = pytest.importorskip("dv_processing", reason="dv-processing is not installed")
    path, expected = tmp_path / "f.aedat4", rows(2**33)
    config = dv.io.MonoCameraWriter.EventOnlyConfig("camera", SIZE_PX)
    store = dv.EventStore()
    for t_us, x, y, p in expected:
        store.push_back(t_us, x, y, bool(p))
    writer = dv.io.MonoCameraWriter(str(path), config)
    writer.writeEvents(store)
    del writer  # closes the file
    reader = open_events(path)
    assert (reader.width_px, reader.height_px) == SIZE_PX
    assert read(path) == expected


def test_rosbags_decodes_the_messages_that_are_written(tmp_path):
    expected = rows(2**33)
    with AnyReader([written(tmp_path, "rosbag1", expected)]) as bag:
        (connection,) = bag.connections
        assert connection.msgtype == "dvs_msgs/msg/EventArray"
        assert connection.digest == "5e8beee5a6c107e504c2e78903c224b8"  # rpg_dvs_ros's own
        decoded = []
        for _, _, data in bag.messages():
            message = bag.deserialize(data, connection.msgtype)
            assert (message.width, message.height) == SIZE_PX
            decoded += [
                (e.ts.sec * 10**6 + e.ts.nanosec // 1000, e.x, e.y, int(e.polarity))
                for e in message.events
            ]
    assert decoded == expected


def test_loadtxt_reads_the_texts(tmp_path):
    expected = rows(2**33)
    table = np.loadtxt(written(tmp_path, "text", expected))
    assert np.rint(table[:, 0] * 1e6).astype(int).tolist() == [row[0] for row in expected]
    assert table[:, 1:].astype(int).tolist() == [list(row[1:]) for row in expected]


def test_numpy_loads_the_archive_without_pickles(tmp_path):
    expected = rows(2**33)
    with np.load(written(tmp_path, "npz", expected), allow_pickle=False) as archive:
        assert archive["t_us"].tolist() == [row[0] for row in expected]
        assert archive["x"].dtype == np.uint16
        assert int(archive["width_px"]) == SIZE_PX[0]


def by_milliseconds(file, t0_us, t1_us):
    """Slices as scripts for DSEC and TUM-VIE do: a look-up by millisecond, then a search."""
    index, offset_us = file["ms_to_idx"], int(file["t_offset"][()]) if "t_offset" in file else 0
    t0_us, t1_us = t0_us - offset_us, t1_us - offset_us
    first, last = int(index[t0_us // 1000]), int(index[-(-t1_us // 1000)])
    t_us = file["events/t"][first:last].astype(np.int64)
    start, stop = first + np.searchsorted(t_us, [t0_us, t1_us])
    columns = [file[f"events/{name}"][start:stop].tolist() for name in "txyp"]
    return [(t + offset_us, x, y, int(p)) for t, x, y, p in zip(*columns, strict=True)]


@pytest.mark.parametrize("kind", ["dsec", "tumvie"])
def test_scripts_of_dsec_and_tumvie_slice_what_is_written(tmp_path, kind):
    expected = rows(2_000_000, 7_777_777)
    first_us, last_us = expected[0][0], expected[-1][0]
    with h5py.File(written(tmp_path, kind, expected)) as file:
        assert file["events/x"].dtype == np.uint16
        for t0_us in (first_us, first_us + 777, last_us - 50_000):
            for t1_us in (t0_us + 1, t0_us + 12_345, last_us // 1000 * 1000):
                wanted = [row for row in expected if t0_us <= row[0] < t1_us]
                assert by_milliseconds(file, t0_us, t1_us) == wanted


def test_scripts_of_mvsec_read_what_is_written(tmp_path):
    expected = rows(2_000_000, 1_506_117_900_000_000)
    path = tmp_path / "f.hdf5"
    write_events(path, "mvsec", *SIZE_PX, {"davis/left": [naive.events_of(expected)]})
    with h5py.File(path) as file:
        table = file["davis"]["left"]["events"][:]
    assert table.dtype == np.float64
    t_us = np.rint(table[:, 2] * 1e6).astype(int).tolist()
    x, y, sign = table[:, [0, 1, 3]].astype(int).T.tolist()
    assert [(*row, int(p > 0)) for *row, p in zip(t_us, x, y, sign, strict=True)] == expected
    assert set(sign) == {-1, 1}


PLUG_IN = """
#include <stddef.h>
typedef size_t (*Filter)(unsigned, size_t, const unsigned *, size_t, size_t *, void **);
typedef struct { int version, id; unsigned encodes, decodes; const char *name; void *a, *b;
                 Filter run; } Class;
static size_t run(unsigned flags, size_t n, const unsigned *values, size_t size, size_t *room,
                  void **data) {
    for (size_t k = 0; k < size; ++k) ((unsigned char *)*data)[k] ^= 0x5a;
    return size;
}
static const Class filter = {1, 0x8ECF, 1, 1, "stands in for ECF", NULL, NULL, run};
int H5PLget_plugin_type(void) { return 0; }
const void *H5PLget_plugin_info(void) { return &filter; }
"""
READ = """
import sys
from pathlib import Path
from eventsweep.emvs.formats import open_events
reader = open_events(Path(sys.argv[1]))
print(reader.format, *(n for e in reader.chunks("events") for n in (len(e), e.t_us[0], e.x[-1])))
"""
WRITE = """
import sys, h5py, numpy as np
rows = np.load(sys.argv[2])
plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
plist.set_chunk((100,))
plist.set_filter(0x8ECF, 0)
with h5py.File(sys.argv[1], "w") as file:
    space, kind = h5py.h5s.create_simple(rows.shape), h5py.h5t.py_create(rows.dtype)
    data = h5py.h5d.create(file.create_group("CD").id, b"events", kind, space, plist)
    h5py.Dataset(data)[:] = rows
"""


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler for the plug-in")
def test_the_ecf_filter_is_taken_from_where_hdf5_looks_for_plug_ins(tmp_path):
    (tmp_path / "ecf.c").write_text(PLUG_IN)
    plug_ins = tmp_path / "plug-ins"
    plug_ins.mkdir()
    build = ["cc", "-shared", "-fPIC", "-o", plug_ins / "libecf.so", tmp_path / "ecf.c"]
    subprocess.run(build, check=True)
    table = np.zeros(250, CD)
    table["t"], table["x"] = np.arange(250) + 7, np.arange(250)
    np.save(tmp_path / "rows.npy", table)
    env, path = os.environ | {"HDF5_PLUGIN_PATH": str(plug_ins)}, tmp_path / "f.hdf5"
    run = [sys.executable, "-c"]
    subprocess.run([*run, WRITE, path, tmp_path / "rows.npy"], env=env, check=True)
    done = subprocess.run([*run, READ, path], env=env, check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["prophesee-hdf5", "250", "7", "249"]
