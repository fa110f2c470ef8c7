"""Sound event files of every kind, for tests, fuzzing and benchmarks: of read-only formats, too.

What the product only reads is written here from the publishers' descriptions, plainly and
vectorised. Times must not fall, but in `dat` and `prophesee-hdf5`; those of `dat` step by less
than 2^31 µs from a first one below 2^32 µs, as its 32 bits demand.
"""

import importlib.util
import itertools
import struct
from functools import partial

import h5py
import numpy as np
import scipy.io
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.formats import FORMATS, write_events

HAS_PARQUET = importlib.util.find_spec("pyarrow") is not None
# Formats that open without more words; `hdf5` is any file whose columns somebody states
# and `aedat2` has the pixels of few chips
ALL = [
    name for name in FORMATS
    if name not in ("hdf5", "aedat2") and (HAS_PARQUET or name != "parquet")
]  # fmt: skip
WRITTEN = [name for name, entry in FORMATS.items() if entry.writes]
READ_ONLY = [name for name in ALL if name not in WRITTEN]
# Those whose events a test puts together from whole columns
COLUMNS = {"v2e", "e2calib", "m3ed", "evimo2", "npy", "parquet", "mat"}
CD = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
ROS2_EVENT = np.dtype(
    {"names": ["y", "s", "ns", "p", "next_x"], "formats": ["<u2", "<u4", "<u4", "u1", "<u2"],
     "offsets": [0, 4, 8, 12, 14], "itemsize": 16}
)  # fmt: skip
ROS2_MESSAGE = 1 << 14


def moving_edges(count, packet=1 << 18, step_us=1):
    """What a 1280x720 sensor gives of moving edges, in packets: bursts along rows in time's order.

    Rows fire together, 4 to 24 pixels of one polarity, `step_us` apart on average.
    """
    rng, last_us = np.random.default_rng(0), 0
    for start in range(0, count, packet):
        size = min(packet, count - start)
        length = rng.integers(4, 24, size // 4 + 1)
        run = np.repeat(np.arange(len(length)), length)[:size]
        first = np.cumsum(length) - length
        x = rng.integers(0, 1256, len(length))[run] + np.arange(size) - first[run]
        y = rng.integers(0, 720, len(length))[run]
        p = rng.integers(0, 2, len(length))[run]
        t_us = last_us + np.cumsum(rng.integers(0, 2 * step_us + 1, len(length)))[run]
        last_us = int(t_us[-1])
        yield Events(x.astype(np.uint16), y.astype(np.uint16), t_us, p.astype(np.uint8))


def stream_of(kind):
    """The name of the stream that a file of this kind holds."""
    named = {"mvsec": "davis/left", "m3ed": "prophesee/left"}
    return "/events" if "rosbag" in kind else named.get(kind, "events")


def write_any(path, kind, size_px, packets):
    """Writes packets of events in any format, read-only ones too; returns the path."""
    writers = {
        "evt21": write_evt21, "dat": write_dat, "rosbag2": write_rosbag2,
        "prophesee-hdf5": write_prophesee_hdf5, "aedat2": write_aedat2, "aedat3": write_aedat3,
        **dict.fromkeys(COLUMNS, partial(write_columns, kind)),
    }  # fmt: skip
    if kind in writers:
        writers[kind](path, size_px, filter(len, packets))
    else:
        write_events(path, kind, *size_px, {stream_of(kind): packets})
    return path


def write_evt21(path, size_px, packets):
    """A word per run of up to 32 neighbours of one time, row and polarity."""
    high = None
    with path.open("wb") as file:
        file.write(f"% evt 2.1\n% geometry {size_px[0]}x{size_px[1]}\n% end\n".encode())
        for e in packets:
            head, words = _evt21_runs(e)
            times, before = _evt21_times(e.t_us[head] >> 6, high)
            file.write(np.insert(words, before, times).astype("<u8").tobytes())
            high = int(e.t_us[-1]) >> 6


def _evt21_runs(e):
    x, y, t, p = (column.astype(np.int64) for column in (e.x, e.y, e.t_us, e.p))
    same = (np.diff(x) == 1) & (np.diff(y) == 0) & (np.diff(t) == 0) & (np.diff(p) == 0)
    first = np.flatnonzero(np.concatenate([[True], ~same]))
    run = np.arange(len(x)) - np.repeat(first, np.diff(np.append(first, len(x))))
    head = np.flatnonzero(run % 32 == 0)
    count = np.diff(np.append(head, len(x)))
    word = p[head] << 28 | (t[head] & 63) << 22 | x[head] << 11 | y[head]
    return head, word.astype(np.uint64) << np.uint64(32) | ((1 << count) - 1).astype(np.uint64)


def _evt21_times(highs, before):
    """Time words, in steps of a quarter of their clock at most, and before which run each goes."""
    step = np.diff(highs, prepend=0 if before is None else before)
    count = -(-step >> 26)
    count[0] += before is None and step[0] == 0
    run = np.repeat(np.arange(len(highs)), count)
    k = np.arange(len(run)) - np.repeat(np.cumsum(count) - count, count) + 1
    value = (highs - step)[run] + np.minimum(k << 26, step[run])
    high = (value & (2**28 - 1)).astype(np.uint64) << np.uint64(32)
    return np.uint64(8 << 60) | high, run


def write_dat(path, size_px, packets):
    with path.open("wb") as file:
        file.write(f"% Height {size_px[1]}\n% Width {size_px[0]}\n\x0c\x08".encode("latin-1"))
        for e in packets:
            place = e.p.astype(np.int64) << 28 | e.y.astype(np.int64) << 14 | e.x
            file.write(np.stack([e.t_us & (2**32 - 1), place], axis=1).astype("<u4").tobytes())


def write_aedat2(path, size_px, packets, chip=None, loops=True):
    """As jAER has it: big-endian addresses of a chip, mirrored in both axes, and µs mod 2^32."""
    chip = chip or {(128, 128): "ch.unizh.ini.jaer.chip.retina.DVS128"}.get(
        size_px, f"eu.seebetter.ini.chips.davis.DAVIS{size_px[0]}C"
    )
    with path.open("wb") as file:
        file.write(f"#!AER-DAT2.0\r\n# made\r\n# AEChip: {chip}\r\n".encode())
        for e in packets:
            x, y, p = (c.astype(np.int64) for c in (e.x, e.y, e.p))
            x, y = size_px[0] - 1 - x, size_px[1] - 1 - y
            is_dvs = size_px == (128, 128)
            place = y << 8 | x << 1 | 1 - p if is_dvs else y << 22 | x << 12 | p << 11
            file.write(np.stack([place, e.t_us & (2**32 - 1)], axis=1).astype(">u4").tobytes())


def write_aedat3(path, size_px, packets, head="#Source 1: DAVIS240C\r\n"):
    """Packets of polarity events; the high bits of times are their heads'."""
    del size_px
    with path.open("wb") as file:
        file.write(f"#!AER-DAT3.1\r\n#Format: RAW\r\n{head}#!END-HEADER\r\n".encode())
        for e in packets:
            cuts = np.flatnonzero(np.diff(e.t_us >> 31)) + 1
            for first, stop in itertools.pairwise([0, *cuts.tolist(), len(e)]):
                file.write(aedat3_packet(e.slice(first, stop)))


def aedat3_packet(e, source=1, valid=1):
    """A packet's 28 bytes of head and 8 of each event, all of one overflow."""
    overflow = int(e.t_us[0]) >> 31 if len(e) else 0
    head = struct.pack("<hhiiiiii", 1, source, 8, 4, overflow, len(e), len(e), len(e))
    x, y, p = (c.astype(np.int64) for c in (e.x, e.y, e.p))
    data = x << 17 | y << 2 | p << 1 | valid
    return head + np.stack([data, e.t_us & (2**31 - 1)], axis=1).astype("<u4").tobytes()


def write_prophesee_hdf5(path, size_px, packets):
    """Without the maker's codec."""
    with h5py.File(path, "w") as file:
        file.attrs["geometry"] = "{}x{}".format(*size_px)
        data = file.create_dataset("CD/events", (0,), CD, maxshape=(None,), chunks=(1 << 14,))
        for e in packets:
            rows = np.empty(len(e), CD)
            rows["x"], rows["y"], rows["t"], rows["p"] = e.x, e.y, e.t_us, e.p
            data.resize(len(data) + len(e), axis=0)
            data[-len(e) :] = rows


def write_columns(kind, path, size_px, packets):
    """As h5py, NumPy and pyarrow write them for v2e, e2calib and people."""
    del size_px
    e = Events.concat(list(packets))
    columns = {"t": e.t_us, "x": e.x, "y": e.y, "p": e.p}
    match kind:
        case "v2e":
            rows = np.stack(list(columns.values()), axis=1).astype(np.uint32)
            with h5py.File(path, "w") as file:
                shape = {"maxshape": (None, 4), "compression": "gzip", "compression_opts": 1}
                file.create_dataset("events", data=rows, chunks=(1 << 14, 4), **shape)
        case "e2calib":
            with h5py.File(path, "w") as file:
                for name, values in columns.items():
                    shape = {"maxshape": (None,), "compression": "lzf"}
                    file.create_dataset(name, data=values, chunks=(1 << 16,), **shape)
        case "m3ed":
            with h5py.File(path, "w") as file:
                write_m3ed_camera(file.create_group("prophesee/left"), e)
        case "evimo2":
            write_evimo2_events(path, e)
        case "npy":
            with path.open("wb") as file:
                np.save(file, fields_of(e))
        case "mat":
            scipy.io.savemat(path, columns, appendmat=False, do_compression=True)
        case "parquet":
            write_parquet(path, e, write_page_checksum=True)


def write_m3ed_camera(group, e):
    """One camera's events, with the first row of each millisecond but the last."""
    for name, kind in (("x", "u2"), ("y", "u2"), ("t", "i8"), ("p", "i1")):
        values = e.t_us if name == "t" else getattr(e, name)
        shape = {"maxshape": (None,), "chunks": (1 << 14,), "compression": "lzf"}
        group.create_dataset(name, data=values.astype(kind), **shape)
    stamps_us = 1000 * np.arange(int(e.t_us.max(initial=0)) // 1000)
    group["ms_map_idx"] = np.searchsorted(e.t_us, stamps_us).astype("u8")


def write_evimo2_events(folder, e):
    """Three files: times in s, pixels, polarities."""
    folder.mkdir(exist_ok=True)
    np.save(folder / "dataset_events_t.npy", e.t_us / 1e6)
    np.save(folder / "dataset_events_xy.npy", np.stack([e.x, e.y], axis=1))
    np.save(folder / "dataset_events_p.npy", e.p)


def write_parquet(path, e, **settings):
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({"t_us": e.t_us, "x": e.x, "y": e.y, "p": e.p})
    pyarrow.parquet.write_table(table, path, row_group_size=1 << 19, **settings)


def fields_of(e):
    """Events as one array with fields."""
    rows = np.empty(len(e), [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "?")])
    rows["t"], rows["x"], rows["y"], rows["p"] = e.t_us, e.x, e.y, e.p
    return rows


def write_rosbag2(
    path, size_px, packets, storage=StoragePlugin.SQLITE3, package="dvs_msgs", compression="none"
):
    """Messages of up to 16384 events, recorded when their latest event happened."""
    kind, last_us = f"{package}/msg/EventArray", 0
    bag = Ros2Writer(path, version=9, storage_plugin=storage)
    bag.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with bag:
        topic = bag.add_connection("/events", kind, typestore=ros2_types(package))
        for e in packets:
            for start in range(0, len(e), ROS2_MESSAGE):
                part = e.slice(start, min(start + ROS2_MESSAGE, len(e)))
                last_us = max(last_us, int(part.t_us.max()))
                bag.write(topic, last_us * 1000, ros2_message(part, size_px))


PACKETS = "event_camera_msgs/msg/EventPacket"
PACKET = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n"
    "string encoding\nbool is_bigendian\nuint8[] events\n"
)


def write_packets(path, size_px, payloads, encoding, storage=StoragePlugin.SQLITE3, **changes):
    """A ROS2 bag of EventPackets, by the library's typed encoder: (stamp ns, time base, bytes)."""
    kind = changes.pop("kind", PACKETS)
    store = packet_types(kind)
    with Ros2Writer(path, version=9, storage_plugin=storage) as bag:
        topic = bag.add_connection("/events", kind, typestore=store)
        for seq, (stamp_ns, base_ns, payload) in enumerate(payloads):
            fields = {"time_base": base_ns} | changes
            message = packet(store, payload, encoding, size_px, kind, seq, stamp_ns, **fields)
            bag.write(topic, stamp_ns, message)
    return path


def packet_types(kind=PACKETS):
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(PACKET, kind))
    return store


def packet(
    store, payload, encoding, size_px=(640, 480), kind=PACKETS, seq=0, stamp_ns=0, **changes
):
    """The bytes of an EventPacket."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    fields = {
        "header": types["std_msgs/msg/Header"](stamp, "cam" + "x" * (seq % 5)),
        "height": size_px[1], "width": size_px[0], "seq": seq, "time_base": 0,
        "encoding": encoding, "is_bigendian": False, "events": np.frombuffer(payload, np.uint8),
    } | changes  # fmt: skip
    return bytes(store.serialize_cdr(types[kind](**fields), kind))


def evt3_payloads(rows, cuts):
    """The words of a sensor, one or more for each event, cut into messages at any of them."""
    words, high, low, row = [], None, None, None
    for t_us, x, y, p in rows:
        if t_us >> 12 != high:
            high, low = t_us >> 12, None
            words.append(0x8000 | high & 0xFFF)
        if t_us & 0xFFF != low:
            low = t_us & 0xFFF
            words.append(0x6000 | low)
        if y != row:
            row = y
            words.append(y)
        words.append(0x2000 | p << 11 | x)
    pieces = np.split(np.array(words, "<u2"), [cut % len(words) for cut in sorted(cuts)])
    return [(10**9 + 1000 * k, 0, piece.tobytes()) for k, piece in enumerate(pieces)]


def mono_payloads(rows, step=100):
    """A word per event, its ns from the packet's base."""
    out = []
    for start in range(0, len(rows), step):
        part, base_ns = rows[start : start + step], 1000 * rows[start][0]
        words = [(1000 * t - base_ns) | x << 32 | y << 48 | p << 63 for t, x, y, p in part]
        out.append((base_ns, base_ns, np.array(words, "<u8").tobytes()))
    return out


def libcaer_payloads(rows, step=100):
    """Words of iniVation's cameras: equal columns and times are said once, µs from each base."""
    out = []
    for start in range(0, len(rows), step):
        part, words, high, low, column = rows[start : start + step], [], 0, 0, None
        base_us = part[0][0] - 3 * (start > 0)
        for t, x, y, p in part:
            if (t - base_us) >> 12 != high:
                high = (t - base_us) >> 12
                words.append(high)
            if (t - base_us) & 0xFFF != low:
                low = (t - base_us) & 0xFFF
                words.append(0x1000 | low)
            if x != column:
                column = x
                words.append(0x2000 | x)
            words.append(0x3000 | p << 11 | y)
        out.append((10**9 + 1000 * start, 1000 * base_us, np.array(words, "<u2").tobytes()))
    return out


def ros2_types(package="dvs_msgs"):
    """ROS2's own types and the package's."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    event = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
    array = f"std_msgs/Header header\nuint32 height\nuint32 width\n{package}/Event[] events\n"
    store.register(get_types_from_msg(event, f"{package}/msg/Event"))
    store.register(get_types_from_msg(array, f"{package}/msg/EventArray"))
    return store


def ros2_message(e, size_px, frame=b"cam\0"):
    """An EventArray as CDR aligns it: x of all but the first event ends the row before its own."""
    head = b"\x00\x01\x00\x00" + struct.pack("<III", 0, 0, len(frame)) + frame
    head += bytes(-len(frame) % 4) + struct.pack("<III", size_px[1], size_px[0], len(e))
    rows = np.zeros(len(e), ROS2_EVENT)
    rows["y"], rows["s"], rows["p"] = e.y, e.t_us // 10**6, e.p
    rows["ns"] = e.t_us % 10**6 * 1000
    rows["next_x"][:-1] = e.x[1:]
    body = bytearray(rows.tobytes())[: -3 if len(e) else None]
    body[:4] = struct.pack("<HH", int(e.x[0]), int(e.y[0])) if len(e) else b""
    return head + bytes(body)
