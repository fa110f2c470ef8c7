"""ROS bags made to hang or to fill memory are refused at once, in one line; sound ones are read."""

import io
import os
import sqlite3
import struct
import sys
import time

import pytest
from rosbags.rosbag2 import StoragePlugin

import event_files
import naive_formats as naive
from eventsweep.emvs.formats import open_events
from refusals import refused

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 4 UNION ALL SELECT x + 1 FROM c)"
ROWS = [(100 * k, k % 40, k % 30, k % 2) for k in range(500)]


@pytest.fixture(params=["sql", "mcap"])
def bag(request, tmp_path):
    storage = StoragePlugin.MCAP if request.param == "mcap" else StoragePlugin.SQLITE3
    event_files.write_rosbag2(tmp_path / "bag", (40, 30), [naive.events_of(ROWS)], storage=storage)
    return tmp_path / "bag"


def soon(words, path):
    began = time.monotonic()
    assert len(refused(words, open_events, path)) < 1000
    assert time.monotonic() - began < 10


def stored(bag):
    return next(path for path in bag.iterdir() if path.suffix in (".db3", ".mcap"))


@pytest.mark.parametrize("name", ["metadata.yaml", ""])
@pytest.mark.parametrize(("plant", "words"), [
    (os.mkfifo, "is a pipe"), (lambda path: path.symlink_to("/dev/zero"), "is a device"),
    (lambda path: path.mkdir(), "is a folder"),
])  # fmt: skip
def test_only_regular_files_are_opened_in_a_bag(bag, name, plant, words):
    path = bag / name if name else stored(bag)
    path.unlink()
    plant(path)
    soon(words, bag)


@pytest.mark.parametrize("head", [
    "a: &a [x, x, x]\n" + "".join(
        f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join(['*' + chr(97 + k)] * 9)}]\n" for k in range(12)
    ),
    "a: " + "[" * 100_000 + "\n", "".join(f"{' ' * k}a:\n" for k in range(1000)),
])  # fmt: skip
def test_metadata_that_stands_for_more_than_memory_holds(bag, head):
    path = bag / "metadata.yaml"
    path.write_text(head + path.read_text())
    soon("values, or nested beyond", bag)


@pytest.mark.parametrize("statements", [
    ("DROP TABLE schema", f"CREATE VIEW schema AS {ENDLESS} SELECT x AS schema_version FROM c"),
    ("DROP TABLE message_definitions",
     f"CREATE VIEW message_definitions AS {ENDLESS} SELECT x AS id, 't' AS topic_type FROM c"),
    ("ALTER TABLE messages RENAME TO kept",
     "CREATE TABLE Messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
     " data BLOB GENERATED ALWAYS AS (zeroblob(999000000)) VIRTUAL)",
     "INSERT INTO Messages(id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM kept"),
    ("ALTER TABLE topics RENAME TO kept", "CREATE VIEW topics AS SELECT * FROM kept"),
    ("DROP TABLE messages", "CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)"),
])  # fmt: skip
def test_a_database_is_of_plain_tables(tmp_path, statements):
    event_files.write_rosbag2(tmp_path / "bag", (40, 30), [naive.events_of(ROWS)])
    with sqlite3.connect(stored(tmp_path / "bag")) as database:
        for statement in statements:
            database.execute(statement)
    database.close()
    soon("is no plain table", tmp_path / "bag")


@pytest.mark.parametrize("name", ["take#1", "a?b", "50%41", "q&mode=rw", "ünï"])
def test_the_name_of_a_folder_is_a_name(bag, name):
    (stream,) = open_events(bag.rename(bag.with_name(name))).streams
    assert open_events(bag.with_name(name)).count(stream) == len(ROWS)


def record(kind, content):
    return bytes([kind]) + struct.pack("<Q", len(content)) + content


def text(words):
    return struct.pack("<I", len(words)) + words.encode()


def listed(path, copies, size, *, apart):
    """An MCAP file with a chunk of zeros in `copies` places, or listed as often."""
    body = record(5, struct.pack("<HIQQ", 1, 0, 1000, 1000) + bytes(size))
    packed = zstd.compress(body, 19)
    out = io.BytesIO(b"\x89MCAP0\r\n" + record(1, text("ros2") + text("made")))
    schema = struct.pack("<H", 1) + text("dvs_msgs/msg/EventArray") + text("ros2msg") + text("")
    channel = struct.pack("<HH", 1, 1) + text("/events") + text("cdr") + text("")
    both = record(3, schema) + record(4, channel)
    head = struct.pack("<QQQI", 1000, 1000, len(body), 0) + text("zstd")
    chunk = record(6, head + struct.pack("<Q", len(packed)) + packed)
    index = record(7, struct.pack("<HIQQ", 1, 16, 1000, 0))
    out.seek(0, 2)
    out.write(both)
    places = []
    for k in range(copies):
        if apart or k == 0:
            places.append(out.tell())
            out.write(chunk + index)
    start = out.tell()
    out.write(both)
    for at in places * (1 if apart else copies):
        line = struct.pack("<QQQQ", 1000, 1000, at, len(chunk)) + struct.pack("<I", 10)
        line += struct.pack("<HQQ", 1, at + len(chunk), len(index)) + text("zstd")
        out.write(record(8, line + struct.pack("<QQ", len(packed), len(body))))
    counts = struct.pack("<QHIIIIQQ", copies, 1, 1, 0, 0, copies, 1000, 1000)
    out.write(record(11, counts + struct.pack("<IHQ", 10, 1, copies)))
    out.write(record(2, struct.pack("<QQI", start, 0, 0)) + b"\x89MCAP0\r\n")
    path.write_bytes(out.getvalue())
    return path


@pytest.mark.parametrize(("copies", "size", "apart", "words"), [
    (40, 1 << 10, False, "chunks that overlap in the file"),
    (40, 32 << 20, True, "chunks of the same time unpack to"),
    (1, 200 << 20, True, "chunks of the same time unpack to"),
    (1, 100 << 20, True, "unpacks to more than 67108864 bytes"),
    (1, 1 << 10, True, "not encoded as little-endian CDR"),
])  # fmt: skip
def test_chunks_are_there_once_and_fit_into_memory(tmp_path, copies, size, apart, words):
    path = listed(tmp_path / "made.mcap", copies, size, apart=apart)
    assert path.stat().st_size < 1 << 20
    soon(words, path)
