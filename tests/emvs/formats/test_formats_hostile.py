"""Hostile event files of every sort end in one clear line; see `test_formats_fuzz`, too."""

import bz2
import io
import os
import pickle
import sqlite3
import sys
import tempfile
import zipfile

import h5py
import lz4.frame
import numpy as np
import pytest
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

import event_files
import naive_formats as naive
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.formats import blocks, open_events, write_events
from eventsweep.emvs.formats.aedat4 import one_vector
from eventsweep.emvs.formats.rosbag import array_events
from refusals import refused

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


SIZE_PX = (1280, 720)


def rows():
    rng = np.random.default_rng(5)
    t_us = np.cumsum(rng.integers(0, 300, 3000))
    return [(int(t), k % 1280, k % 720, k % 2) for k, t in enumerate(t_us)]


def read_all(path):
    """Everything that a reader does; whatever it raises must be an `InputError`."""
    reader = open_events(path)
    parts = []
    for name in reader.streams:
        parts += reader.chunks(name)
        first, last = reader.span_us(name)
        reader.between(name, first, last)
    return naive.rows_of(Events.concat(parts))


SMALL = [
    b"", b"\x00" * 64, b"\xff" * 64, b"%", b"% evt 3.0", b"% \n" * 9, b"% evt 9.9\n% end\n",
    b"% evt 3.0\n% geometry 0x0\n% width 0\n% height 5\n% end\n", b"\x89HDF\r\n\x1a\n",
    b"#ROSBAG V2.0\n", b"#!AER-DAT4.0\r\n", b"#!AER-DAT3.1\r\n", b"PK\x03\x04", b"hello world",
    b"#!AER-DAT4.0\r\n\xff\xff\xff\xff" + b"\x00" * 40, b"a,b,c\n1,2,3\n", b"% Height 5\n",
    b"% evt 3.0\n% end\n\x00\x80\x00", pickle.dumps({"x": 1}), b"1 2 3 1\n" + b"9" * 200_000,
]  # fmt: skip
REMARKS = [b"#", b"#ROSB", b"# t x y p\n\n", b"\n\n"]


@pytest.mark.parametrize(
    ("data", "words"),
    [*((data, "") for data in SMALL), *((data, "cut off or empty") for data in REMARKS)],
)
def test_small_hostile_files(tmp_path, data, words):
    path = tmp_path / "f"
    path.write_bytes(data)
    refused([words, path], read_all, path)


def test_folders_pipes_and_missing_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "none", tmp_path / "pipe"):
        refused([path], open_events, path)


@pytest.mark.parametrize("kind", ["text", "csv", "npz", "mvsec", "dsec", "tumvie", "aedat4"])
def test_negative_times_are_refused(tmp_path, kind):
    path, column = tmp_path / "f", np.array([1, 2], np.uint16)
    t_us = np.array([-5, 7])
    if kind == "text":
        path.write_text("-0.5 1 2 1\n")
    elif kind == "csv":
        path.write_text("t_us,x,y,p\n-5,1,2,1\n")
    elif kind == "npz":
        np.savez(tmp_path / "f.npz", x=column, y=column, p=column // 2, t_us=t_us)
        path = tmp_path / "f.npz"
    elif kind == "aedat4":
        write_events(path, kind, 9, 9, {"events": [Events(column, column, t_us + 9, column > 1)]})
        data = path.read_bytes()
        frame = one_vector(b"EVTS", 1, (-5 & (2**64 - 1)).to_bytes(8, "little") + bytes(8))
        head = data[: data.index(b"\x04\x22\x4d\x18", 14) - 8]
        at = head.index(b"IOHE") + 4 + 6 + 10 + 4
        head = head[:at] + bytes(4) + head[at + 4 :]  # no compression
        head = head[: at + 8] + b"\xff" * 8 + head[at + 16 :]  # no table
        path.write_bytes(head + bytes(4) + len(frame).to_bytes(4, "little") + frame)
    elif kind == "mvsec":
        with h5py.File(path, "w") as file:
            file["davis/left/events"] = np.array([[1, 2, -0.5, 1.0]])
    else:
        with h5py.File(path, "w") as file:
            for name, values in {"x": column, "y": column, "p": column // 2, "t": t_us}.items():
                file[f"events/{name}"] = values
            if kind == "dsec":
                file["t_offset"] = np.int64(0)
    said = refused([path], read_all, path)
    assert "-" in said


def test_a_span_is_never_that_of_a_damaged_time(tmp_path):
    """M3ED's has an index by time; what lies behind its last entry is found among the times."""
    path, events = tmp_path / "f", naive.events_of(rows())
    event_files.write_any(path, "m3ed", SIZE_PX, [events])
    with h5py.File(path, "r+") as file:
        file["prophesee/left/t"][-1] = -(2**61)
    reader = open_events(path)
    refused([r"event 0 at -\d+ µs", path], reader.span_us, reader.streams[0])


def read_slices(path):
    """All, and a part that needs the file's index."""
    read_all(path)
    return open_events(path).between("events", 1000, 3000)


def hdf5_with(path, **changes):
    columns = {name: np.arange(5, dtype=np.uint16) for name in "xyt"} | {"p": np.ones(5, np.uint8)}
    with h5py.File(path, "w") as file:
        for name, values in (columns | changes).items():
            if values is not None:
                file[name if "_" in name else f"events/{name}"] = values
    return path


@pytest.mark.parametrize(("changes", "message"), [
    ({"x": None}, "lacks events/x"), ({"x": np.zeros(4, np.uint16)}, "lengths"),
    ({"x": np.zeros((5, 2), np.uint16)}, "shape"), ({"x": np.array([b"a"] * 5)}, "damaged"),
    ({"x": np.full(5, -1)}, "whole pixels"), ({"x": np.full(5, 70000)}, "whole pixels"),
    ({"x": np.full(5, np.nan)}, "whole pixels"), ({"x": np.full(5, 1.5)}, "whole pixels"),
    ({"p": np.full(5, 3)}, "0 or 1"), ({"t": np.full(5, np.inf)}, "finite"),
    ({"t_offset": np.int64(-5)}, "t_offset"),
    ({"t_offset": np.int64(2**63 - 1)}, "t_offset"),
    ({"t": np.full(5, 2**64 - 1, np.uint64)}, "times below"),
    ({"t": np.arange(5) * 1000, "ms_to_idx": np.full(5, 99)}, "ms_to_idx"),
    ({"t": np.arange(5) * 1000, "ms_to_idx": np.full(5, 4)}, "ms_to_idx"),
    ({"t": np.arange(5) * 1000, "ms_to_idx": np.full(5, -1)}, "ms_to_idx"),
])  # fmt: skip
def test_hdf5_of_the_wrong_kind(tmp_path, changes, message):
    path = hdf5_with(tmp_path / "f", **changes)
    refused([message, path], read_slices, path)


def test_rows_that_are_declared_but_not_stored_are_no_zeros(tmp_path):
    path = hdf5_with(tmp_path / "f", x=None, y=None, t=None, p=None)
    with h5py.File(path, "a") as file:
        for name in "xytp":
            file.create_dataset(f"events/{name}", (10**13,), np.int64, chunks=(1 << 16,))
    refused("incomplete", open_events, path)


def test_npz_never_unpickles(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "sprung"), "w"))

    column = np.array([Trap()], object)
    np.savez(tmp_path / "f.npz", x=column, y=column, t=column, p=column)
    refused("plain numbers", read_all, tmp_path / "f.npz")
    assert not (tmp_path / "sprung").exists()


def npz_member(shape):
    header = f"{{'descr': '<i8', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(80)


def saved(values):
    member = io.BytesIO()
    np.save(member, values)
    return member.getvalue()


IMPOSSIBLE = ["(10**15,)", f"({10**15},)", f"({10**400},)", "(-5,)", "(5, 5)"]
LONG_HEADER = b"\x93NUMPY\x02\x00" + (2**32 - 1).to_bytes(4, "little") + bytes(80)


@pytest.mark.parametrize(
    ("member", "words"),
    [
        *((npz_member(shape), "") for shape in IMPOSSIBLE),
        # Never read to its end: a header of 4 GB that unpacks from 4 MB.
        (LONG_HEADER, "expected 4294967295 bytes"),
        # Read in blocks: 64 kB that unpack to 64 MB are refused for what they hold, not by memory.
        (saved(np.full(1 << 23, 7, np.uint8)), "rows 0 to 262144: p of event 0 is 7"),
    ],
)
def test_npz_of_impossible_columns(tmp_path, member, words):
    path = tmp_path / "f.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("x", "y", "t", "p"):
            archive.writestr(f"{name}.npy", member)
    refused([words, path], lambda: next(open_events(path).chunks("events")))


@pytest.mark.parametrize("ros2", [False, True])
@pytest.mark.parametrize("count", [1, 2**31, 2**32 - 1])
def test_ros_messages_that_declare_too_much(ros2, count):
    head = (b"\x00\x01\x00\x00" if ros2 else bytes(4)) + bytes(8) + bytes(4) + bytes(8)
    refused("need", array_events, head + count.to_bytes(4, "little") + bytes(5), ros2, "here")
    refused("ends before", array_events, head[:12] + b"\xff\xff\xff\xff", ros2, "here")


def ros2_bag(path, package, storage):
    """As the library's own typed encoder lays messages out, with frames of several lengths."""
    kind, store = f"{package}/msg/EventArray", event_files.ros2_types(package)
    types = store.types
    with Ros2Writer(path, version=9, storage_plugin=storage) as bag:
        topic = bag.add_connection("/cam/events", kind, typestore=store)
        stamp = types["builtin_interfaces/msg/Time"]
        for start in range(0, 3000, 1000):
            events = [
                types[f"{package}/msg/Event"](x, y, stamp(t // 10**6, t % 10**6 * 1000), bool(p))
                for t, x, y, p in rows()[start : start + 1000]
            ]
            frame = "cam" + "x" * (start // 1000)
            head = types["std_msgs/msg/Header"](stamp(0, 0), frame)
            message = types[kind](head, 720, 1280, events)
            bag.write(topic, 1000 * rows()[start][0], store.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize("package", ["dvs_msgs", "prophesee_event_msgs"])
@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_ros2_bags_as_the_library_writes_them(tmp_path, package, storage):
    path = ros2_bag(tmp_path / "bag", package, storage)
    reader = open_events(path)
    assert (reader.format, reader.streams) == ("rosbag2", ("/cam/events",))
    assert (reader.width_px, reader.height_px) == SIZE_PX
    assert read_all(path) == rows()


def ros1_bag(path, compression):
    """Our messages in the library's bag, which can compress its chunks."""
    write_events(path.with_suffix(".plain"), "rosbag1", *SIZE_PX, {"/e": [naive.events_of(rows())]})
    bag = Ros1Writer(path)
    bag.set_compression(compression)
    with Ros1Reader(path.with_suffix(".plain")) as plain, bag:
        (old,) = plain.connections
        topic = bag.add_connection("/e", old.msgtype, msgdef=old.msgdef.data, md5sum=old.digest)
        for _, stamp_ns, data in plain.messages():
            bag.write(topic, stamp_ns, data)
    return path


@pytest.mark.parametrize("compression", list(Ros1Writer.CompressionFormat))
def test_compressed_ros1_bags(tmp_path, monkeypatch, compression):
    path = ros1_bag(tmp_path / "f.bag", compression)
    assert read_all(path) == rows()
    monkeypatch.setattr(blocks, "MOST_BYTES", 20_000)
    refused(["unpacks to more than 20000 bytes", path], read_all, path)


@pytest.mark.parametrize(
    ("name", "compress"),
    [("bz2", bz2.compress), ("lz4", lz4.frame.compress), ("zstd", zstd.compress)],
)
def test_frames_unpack_to_a_bound(monkeypatch, name, compress):
    for size in (0, 1, 1000, 20_000_000):
        assert blocks.unpacked(compress(bytes(size)), name, "here") == bytes(size)
    for damaged in (b"", compress(b"a" * 99)[:-6], b"\xff" * 40):
        refused(r"here: (its compressed|cannot be)", blocks.unpacked, damaged, name, "here")
    monkeypatch.setattr(blocks, "MOST_BYTES", 1 << 22)
    refused("unpacks to more than", blocks.unpacked, compress(bytes(1 << 25)), name, "here")


def test_what_a_file_says_is_quoted_printable_and_short(tmp_path):
    (tmp_path / "f").write_bytes(b"% evt 3.0\n% width \x1b[2J" + b"9" * 9000 + b"\n% height 5\n")
    said = refused("sensor size", open_events, tmp_path / "f")
    assert said.isprintable()
    assert len(said) < 400


def test_compressed_files_of_bags_are_read_and_bounded(tmp_path, monkeypatch):
    """A ROS2 bag of `compression_mode: file`; what is unpacked leaves no trace, sound or not."""
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    (tmp_path / "temporary").mkdir()
    path = tmp_path / "bag"
    event_files.write_rosbag2(path, SIZE_PX, [naive.events_of(rows())], compression="file")
    assert read_all(path) == rows()
    monkeypatch.setattr(blocks, "MOST_BYTES", 1 << 22)
    (packed,) = path.glob("*.zstd")
    data = packed.read_bytes()
    for bomb in (zstd.compress(bytes(1 << 24)), data + zstd.compress(bytes(1 << 24))):
        packed.write_bytes(bomb)
        refused(["file unpacks to more than 4194304 bytes", path], read_all, path)
    packed.write_bytes(data[:-9])
    refused(["cut off or damaged", path], read_all, path)
    assert not list((tmp_path / "temporary").iterdir())


def test_messages_that_are_compressed_one_by_one_are_read_and_bounded(tmp_path):
    """A ROS2 bag of `compression_mode: message`; one message unpacks to more than is read."""
    events = naive.events_of(rows())
    path = tmp_path / "sound"
    event_files.write_rosbag2(path, SIZE_PX, [events], compression="message")
    assert read_all(path) == rows()
    path = tmp_path / "bomb"
    event_files.write_rosbag2(path, SIZE_PX, [events], compression="message")
    database = next(path.glob("*.db3"))
    bomb = zstd.compress(bytes(blocks.MOST_BYTES + (1 << 25)))
    with sqlite3.connect(database) as connection:
        connection.execute("UPDATE messages SET data = ?", (bomb,))
    connection.close()
    refused(["message: its compressed frame", path], read_all, path)
