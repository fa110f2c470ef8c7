"""Data at addresses: read in parts, sent whole or not at all, and refused in one line."""

import gc
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from dataset_world import write_sequence
from eventsweep.emvs.data.event_store import EventStoreReader, EventStoreWriter
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.hdf5 import open_hdf5
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils import address, blocks, mirror
from eventsweep.emvs.utils.address import address_of, is_address, mirror_of, named
from eventsweep.emvs.utils.blocks import LIMIT_VARIABLE, is_by_blocks, stand_in
from eventsweep.emvs.utils.mirror import changed, fetched, made
from range_server import serving
from refusals import line_of

fsspec = pytest.importorskip("fsspec")
pytest.importorskip("aiohttp", reason="fsspec reads http:// by it")
COUNT, CHUNK = 1 << 21, 1 << 17


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(address, "_PAUSE_S", 0.01)


@pytest.fixture
def memory():
    """An empty store in memory."""
    files = fsspec.filesystem("memory")
    files.store.clear()
    files.pseudo_dirs[:] = [""]
    return files


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """A file of two million events in one second, sixteen chunks of each column."""
    path = tmp_path_factory.mktemp("long") / "events.h5"
    rng = np.random.default_rng(0)
    t_us = np.sort(rng.integers(0, 1_000_000, COUNT))
    x, y = rng.integers(0, 346, COUNT, np.uint16), rng.integers(0, 260, COUNT, np.uint16)
    with EventStoreWriter(path, 346, 260) as writer:
        writer.append(Events(x, y, t_us, rng.integers(0, 2, COUNT).astype(bool)))
    return path


def at(server, path):
    """The stand-in of a file that a server serves."""
    place = mirror_of(f"{server.address}/data/{path.name}")
    stand_in(place, path.stat().st_size, "one")
    return place


@pytest.fixture
def far(long, tmp_path):
    """The long file on a server, and its stand-in."""
    (tmp_path / "www" / "data").mkdir(parents=True)
    os.link(long, tmp_path / "www" / "data" / long.name)
    with serving(tmp_path / "www") as server:
        yield server, at(server, long)


def stored_bytes(path, slices_us):
    """Bytes of all chunks that hold a value of a slice: HDF5 reads no less."""
    with h5py.File(path) as file:
        t = file["events/t"][:]
        rows = {k for s in slices_us for k in np.searchsorted(t, s) // CHUNK}
        chunks = range(min(rows), min(max(rows) + 1, -(-COUNT // CHUNK)))
        columns = [file[f"events/{name}"].id for name in "xytp"]
        return sum(c.get_chunk_info_by_coord((k * CHUNK,)).size for c in columns for k in chunks)


@pytest.mark.parametrize("text", ["s3://lab/a/seq", "https://x.example/seq", "memory://a/b"])
def test_an_address_is_one_also_as_a_path_and_its_mirror_says_which(text):
    assert address_of(Path(text)) == address_of(text) == text
    assert address_of(mirror_of(Path(text)) / "cam0" / "x.h5") == f"{text}/cam0/x.h5"
    assert named(f"see {mirror_of(text)}/map.json") == f"see {text}/map.json"
    assert [is_address(text), is_address(mirror_of(text))] == [True, False]


@pytest.mark.parametrize("text", ["a/b", "/s3:/b", "c:/x", "tcp://127.0.0.1:1", "NAME=s3://x/y"])
def test_other_words_are_paths(text):
    assert address_of(text) is None
    assert mirror_of(text) == Path(text)


def test_a_folder_here_that_is_called_like_an_address_stays_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s3:" / "lab").mkdir(parents=True)
    assert address_of("s3://lab") is None


@pytest.mark.parametrize("text", ["s3://lab/../x", "s3://lab/a//b", "s3://lab"])
def test_an_address_that_leads_elsewhere_is_refused(text):
    assert "needs s3://PLACE/NAME" in line_of(lambda: mirror_of(text))


def test_slices_at_an_address_are_those_of_the_file_and_cost_their_chunks_once(far, long):
    server, place = far
    near, reader = EventStoreReader(long, 346, 260), EventStoreReader(place, 346, 260)
    slices = [(400_000, 500_000), (450_000, 550_000), (400_000, 600_000)]
    for t0_us, t1_us in slices:
        ours, theirs = near.read(t0_us, t1_us), reader.read(t0_us, t1_us)
        for name in ("x", "y", "t_us", "p"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    sent, needed = server.sent(), stored_bytes(long, slices)
    assert needed < sent <= 1.3 * needed < 0.4 * long.stat().st_size
    EventStoreReader(place, 346, 260).read(*slices[0])
    assert server.sent() == sent
    assert gc.isenabled()


def test_a_cut_connection_is_tried_again_and_a_lasting_one_is_one_line(far, long):
    server, place = far
    server.set(cut=3)
    read = EventStoreReader(place, 346, 260).read(100_000, 110_000)
    near = EventStoreReader(long, 346, 260).read(100_000, 110_000)
    np.testing.assert_array_equal(read.t_us, near.t_us)
    server.set(cut=10**6)
    reader = EventStoreReader(place, 346, 260)
    line = line_of(lambda: reader.read(900_000, 910_000))
    assert line.startswith(f"{server.address}/data/events.h5: cannot be read")
    server.set(cut=0)
    assert len(reader.read(900_000, 910_000))


def test_a_slow_connection_gives_the_same(far, long):
    server, place = far
    server.set(delay_s=0.05)
    read = EventStoreReader(place, 346, 260).read(100_000, 101_000)
    assert len(read) == len(EventStoreReader(long, 346, 260).read(100_000, 101_000))


def test_a_server_that_gives_no_parts_is_named(far):
    server, place = far
    server.set(whole=1)
    assert "its server gives whole files" in line_of(lambda: EventStoreReader(place, 346, 260))


OPENED = """
import sys
from pathlib import Path
from eventsweep.emvs.data.hdf5 import open_hdf5
from eventsweep.emvs.errors import InputError
try:
    with open_hdf5(Path(sys.argv[1])):
        pass
except InputError as error:
    kept = error
print(kept)
"""


def test_a_program_ends_well_after_a_file_that_does_not_open(far):
    server, place = far
    server.set(whole=1)
    child = subprocess.run(
        [sys.executable, "-c", OPENED, place], capture_output=True, text=True, check=False
    )
    assert "its server gives whole files" in child.stdout, child.stderr
    assert child.returncode == 0
    line_of(lambda: EventStoreReader(place, 346, 260))
    assert gc.isenabled()


def test_another_state_of_a_file_is_read_anew(far, long):
    server, place = far
    with open_hdf5(place) as file:
        assert file["events/x"][0] >= 0
    stand_in(place, long.stat().st_size, "two")
    before = server.sent()
    with open_hdf5(place) as file:
        assert file["events/x"][0] >= 0
    assert server.sent() > before


def test_blocks_are_kept_within_the_limit(far, long, monkeypatch):
    _, place = far
    monkeypatch.setenv(LIMIT_VARIABLE, "0.001")
    other = place.with_name("other.h5")
    stand_in(other, 10 * blocks.BLOCK_BYTES, "old")
    kept = other.with_name(".other.h5.blocks")
    kept.write_bytes(kept.read_bytes()[:64] + b"\1" * (1 << 20))
    os.utime(kept, (1, 1))
    EventStoreReader(place, 346, 260).read(0, 1_000_000)
    assert kept.stat().st_blocks * 512 < 1 << 20
    assert is_by_blocks(other)
    monkeypatch.setenv(LIMIT_VARIABLE, "none")
    assert LIMIT_VARIABLE in line_of(blocks.kept_limit_bytes)


def test_a_recording_on_a_web_server_is_opened_as_it_is_here(tmp_path):
    ours = write_sequence(tmp_path / "www" / "plane", "pinhole")
    with serving(tmp_path / "www") as server:
        theirs = open_recording(f"{server.address}/plane")
        here = open_recording(ours)
        assert theirs.manifest == here.manifest
        span_us = here.event_span_us(0)
        np.testing.assert_array_equal(theirs.events(0, *span_us).x, here.events(0, *span_us).x)
        assert is_by_blocks(theirs.path / "cam0" / "events.h5")
        theirs.verify()


def test_an_output_is_sent_whole_its_index_last_or_not_at_all(memory, monkeypatch):
    sent = []
    put = type(memory).put_file

    def noted(self, here, there, **more):
        sent.append(there.rpartition("/out/")[2])
        return put(self, here, there, **more)

    monkeypatch.setattr(type(memory), "put_file", noted)
    with made("memory://lab/out") as folder:
        for name in ("map.json", "w000/window.json", "w000/depth.npz", "report.html"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(name)
    assert sent == ["report.html", "w000/depth.npz", "w000/window.json", "map.json"]
    assert not folder.exists()
    with pytest.raises(ZeroDivisionError), made("memory://lab/other"):
        raise ZeroDivisionError
    assert not memory.exists("/lab/other")
    with pytest.raises(InputError, match="exists: choose another output"), made("memory://lab/out"):
        pass


def test_only_what_changed_is_sent_and_the_index_is_away_meanwhile(memory, monkeypatch):
    for name in ("results.json", "a.npz", "b.npz"):
        memory.pipe_file(f"/lab/out/{name}", name.encode())
    there = []
    put = type(memory).put_file

    def noted(self, here, place, **more):
        there.append((place.rpartition("/")[2], memory.exists("/lab/out/results.json")))
        return put(self, here, place, **more)

    monkeypatch.setattr(type(memory), "put_file", noted)
    with changed("memory://lab/out") as folder:
        (folder / "results.json").write_text("new")
        (folder / "b.npz").write_text("new")
    assert there == [("b.npz", False), ("results.json", False)]
    assert memory.cat_file("/lab/out/results.json") == b"new"


def test_an_output_that_cannot_be_sent_is_kept_and_the_line_says_where(memory, monkeypatch):
    def cut(*_arguments, **_more):
        raise ConnectionError("cut")

    def make():
        with made("memory://lab/out") as folder:
            folder.mkdir(parents=True)
            (folder / "map.json").write_text("{}")
            monkeypatch.setattr(type(memory), "put_file", cut)

    place = line_of(make).rpartition("finished output is in ")[2].partition(":")[0]
    assert json.loads((Path(place) / "map.json").read_text()) == {}


@pytest.mark.parametrize(("address", "words"), [
    ("memory://lab/none", "nothing is there; correct the address"),
    ("http://127.0.0.1:9/seq", "cannot be read"),
    ("memory://lab/large", "not read in parts; copy it here first"),
])  # fmt: skip
def test_what_cannot_be_read_is_one_line(memory, monkeypatch, address, words):
    monkeypatch.setattr(mirror, "TABLE_BYTES", 10)
    memory.pipe_file("/lab/large/events.txt", b"0" * 11)
    line = line_of(lambda: open_recording(address))
    assert line.startswith(address)
    assert words in line


def test_a_listing_of_a_hundred_thousand_keys_is_fast_and_bounded(memory):
    data = memory.store
    memory.pipe_file("/lab/many/map.json", b"{}")
    one = data["/lab/many/map.json"]
    data |= {f"/lab/many/w{k:05d}/cloud.ply": one for k in range(100_000)}
    before_kb, started_s = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    place = fetched(mirror_of("memory://lab/many"))
    took_s = time.monotonic() - started_s
    more_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    assert [path.name for path in place.iterdir()] == ["map.json"]
    assert took_s < 30
    assert more_kb < 300_000
