"""Fuzzes the readers of event formats: `python tests/fuzz/fuzz_events.py [EXAMPLES] [KIND ...]`.

Each kind runs in a process of its own, which may reserve `ROOM` bytes more than it starts with and
take `PATIENCE_S` per example. A sound small file is damaged in one to three places, and everything
that a reader does must end in events or in an `InputError` of one line that names the file. The
example's number is its seed: `python tests/fuzz/fuzz_events.py 1 KIND FIRST` repeats it.
"""

import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import zipfile
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

# Run as a program, too: what it shares with the tests lies beside its folder.
SHARED = "helpers", "helpers/recordings", "reference"
sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in SHARED]

import h5py
import lz4.frame
import numpy as np
import scipy.io

import event_files
import naive_formats as naive
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.tables.columns import ColumnMap
from made_events import part_of, same_events

SIZE_PX = (1280, 720)
# A line of what a run prints.
LINE = re.compile(r"(\S+) +(\d+) done, +(\d+) refused, slowest +\d+ ms, +(\d+) MB more((?:\n .*)*)")
MOST_MB = 64  # more of memory that a kind may take
ROOM = 512 << 20
PATIENCE_S = 20
# A prefix of these is a whole file of its own, where it ends between two words or lines.
PREFIXES = {
    "aedat2",
    "aedat3",
    "evt2",
    "evt3",
    "evt21",
    "dat",
    "text",
    "esim-text",
    "csv",
    "csv+stated",
}


def ran(script, examples):
    """Runs a script of this folder in a process of its own, and checks what it says of each kind.

    Returns:
        The kinds.
    """
    command = [sys.executable, str(Path(__file__).with_name(f"{script}.py")), str(examples)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stderr == ""  # no library prints anything of its own
    found = {match[1]: match.groups()[1:] for match in LINE.finditer(done.stdout)}
    for kind, (count, refused, more_mb, faults) in found.items():
        assert faults == "", kind
        assert int(count) == examples, kind
        assert int(refused) > examples // 4, kind  # the damage is worth the name
        assert int(more_mb) < MOST_MB, kind
    return set(found)


def rows(count=1500):
    rng = np.random.default_rng(5)
    t_us = np.cumsum(rng.integers(0, 300, count))
    return [(int(t), k % 1280, k % 720, k % 2) for k, t in enumerate(t_us)]


def rows_in(kind):
    """The rows that a file of a kind holds."""
    small = kind == "aedat2"  # whose chips are no larger
    return [(t, x % 640, y % 480, p) if small else (t, x, y, p) for t, x, y, p in rows()]


def sound(folder, kind):
    """A sound file of a kind, or of a less compressed variant, so that damage goes deeper."""
    path, events = folder / "f", [naive.events_of(rows())]
    name = kind.partition("+")[0]
    match kind:
        case "rosbag2+mcap" | "rosbag2+file":
            mcap = {"storage": event_files.StoragePlugin.MCAP}
            settings = mcap if kind == "rosbag2+mcap" else {"compression": "file"}
            event_files.write_rosbag2(path, SIZE_PX, events, **settings)
        case "rosbag2+lone":
            payloads, storage = event_files.libcaer_payloads(rows()), event_files.StoragePlugin.MCAP
            bag = folder / "bag"
            event_files.write_packets(bag, SIZE_PX, payloads, "libcaer_cmp", storage)
            (bag / "bag.mcap").rename(path)
        case "rosbag2+evt3":
            payloads = event_files.evt3_payloads(rows(), range(100, 3000, 251))
            event_files.write_packets(path, SIZE_PX, payloads, "evt3")
        case "rosbag2+mono":
            payloads, storage = event_files.mono_payloads(rows()), event_files.StoragePlugin.MCAP
            event_files.write_packets(path, SIZE_PX, payloads, "mono", storage)
        case "dsec+plain" | "mvsec+plain":
            event_files.write_any(folder / "whole", name, SIZE_PX, events)
            with h5py.File(folder / "whole") as whole, h5py.File(path, "w") as out:
                whole.visititems(lambda key, node: plain(out, key, node))
        case "npy+rows" | "npz+rows" | "hdf5+rows" | "hdf5+stated" | "csv+stated":
            write_table(path, kind, events[0])
        case "mat+plain":
            columns = np.array([[x, y, p, t] for t, x, y, p in rows()], float)
            scipy.io.savemat(path, {"ev": columns}, appendmat=False)
        case "parquet+plain":
            event_files.write_parquet(path, events[0], compression="none", use_dictionary=False)
        case "aedat4+plain":
            event_files.write_any(path, name, SIZE_PX, events)
            path.write_bytes(uncompressed(path.read_bytes()))
        case _:
            size_px = (640, 480) if kind == "aedat2" else SIZE_PX
            event_files.write_any(path, name, size_px, [naive.events_of(rows_in(kind))])
    return path


def write_table(path, kind, e):
    """Columns side by side without names, or with names that only `STATED` explains."""
    columns = {"ev/ts": 1000 * e.t_us, "ev/xs": e.x, "ev/ys": e.y, "ev/on": 2 * e.p.astype(int) - 1}
    named = np.stack([1000 * e.t_us, e.x, e.y, e.p], axis=1)
    with path.open("wb") as file:
        match kind:
            case "npy+rows":
                np.save(file, np.asfortranarray(named / [1e9, 1, 1, 1]))
            case "npz+rows":
                np.savez(file, events=np.stack([e.x, e.y, e.t_us, e.p], axis=1))
            case "csv+stated":
                head = '"ev/ts","ev/xs","ev/ys","ev/on"'
                np.savetxt(file, named, "%d", ",", header=head, comments="")
    if kind.startswith("hdf5"):
        with h5py.File(path, "w") as out:
            for name, values in columns.items() if kind == "hdf5+stated" else ():
                out[name] = values
            if kind == "hdf5+rows":
                out["events"] = np.stack([e.x, e.y, e.t_us / 1e6, e.p], axis=1)


STATED = {
    kind: ColumnMap("ev/xs", "ev/ys", "ev/ts", "ev/on", "ns")
    for kind in ("hdf5+stated", "csv+stated")
} | {"mat+plain": ColumnMap("ev[0]", "ev[1]", "ev[3]", "ev[2]", "us")}


def plain(out, key, node):
    if isinstance(node, h5py.Dataset):
        out[key] = node[()]


def uncompressed(data):
    """An AEDAT4 file of ours without compression and without its table."""
    head = 14 + 4 + int.from_bytes(data[14:18], "little")
    table = int.from_bytes(data[54:62], "little")
    assert data[46:50] == (1).to_bytes(4, "little")
    out, at = bytearray(data[:head]), head
    out[46:50], out[54:62] = bytes(4), b"\xff" * 8
    while at < table:
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        packet = lz4.frame.decompress(data[at + 8 : at + 8 + size])
        out += data[at : at + 4] + len(packet).to_bytes(4, "little") + packet
        at += 8 + size
    return bytes(out)


KINDS = [
    *event_files.ALL, "aedat2", "rosbag2+mcap", "dsec+plain", "mvsec+plain", "aedat4+plain",
    "npz+members", "npy+rows", "npz+rows", "hdf5+rows", "hdf5+stated", "csv+stated",
    "rosbag2+evt3", "rosbag2+mono", "rosbag2+lone", "rosbag2+file", "mat+plain",
    *(["parquet+plain"] if event_files.HAS_PARQUET else []),
]  # fmt: skip


def cut(data, rng):
    return data[: int(rng.integers(0, len(data) + 1))]


def flip(data, rng):
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        out[place(data, rng)] ^= 1 << int(rng.integers(0, 8))
    return bytes(out)


def extreme(data, rng):
    """A count, size or time of the worst kind."""
    size = int(rng.choice([1, 2, 4, 8]))
    at = place(data, rng)
    at -= at % size if rng.random() < 0.7 else 0
    top = 1 << (8 * size)
    value = int(rng.choice([0, 1, 2, 3])) * (top // 4) + int(rng.integers(-2, 3))
    out = data[:at] + (value % top).to_bytes(size, "little") + data[at + size :]
    return out[: len(data)]


def stretch(data, rng):
    """A stretch is missing, repeated, zero, or from elsewhere."""
    at, other = place(data, rng), place(data, rng)
    size = int(rng.choice([1, 2, 4, 13, 16, 512, 4096]))
    part = data[at : at + size]
    new = (b"", part + part, bytes(len(part)), data[other : other + size])
    return data[:at] + new[int(rng.integers(0, 4))] + data[at + size :]


def words(data, rng):
    """Signs that mean something in text."""
    at = place(data, rng)
    new = rng.choice(
        [b"-", b".", b"e9", b"\n", b" ", b",", b"#", b"nan", b"9" * 25, b"\0", b"\xff"]
    )
    return data[:at] + bytes(new) + data[at + int(rng.integers(0, 3)) :]


def place(data, rng):
    """A byte's place: half of them in the first 600, where formats keep their words."""
    return int(rng.integers(0, max(1, min(len(data), 600) if rng.random() < 0.5 else len(data))))


DAMAGES = (cut, flip, flip, extreme, extreme, stretch, words)


def damaged(data, rng):
    for _ in range(int(rng.integers(1, 4))):
        if data:
            data = DAMAGES[int(rng.integers(0, len(DAMAGES)))](data, rng)
    return data


def damage(source, target, rng, kind):
    """Writes a damaged copy; returns whether it was only cut off."""
    if source.is_dir():
        shutil.copytree(source, target)
        files = sorted(target.iterdir())
        file = files[int(rng.integers(0, len(files)))]
        file.write_bytes(damaged(file.read_bytes(), rng))
        return False
    data = source.read_bytes()
    if kind == "npz+members":
        target.write_bytes(data)
        damage_member(target, rng)
        return False
    if rng.random() < 0.15:
        target.write_bytes(cut(data, rng))
        return True
    target.write_bytes(damaged(data, rng))
    return False


def damage_member(path, rng):
    """Damages a column inside the archive, whose check sums then hold."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = sorted(members)[int(rng.integers(0, len(members)))]
    data = members[name]
    members[name] = (
        damaged(data[:128], rng) + data[128:] if rng.random() < 0.7 else damaged(data, rng)
    )
    with zipfile.ZipFile(path, "w") as archive:
        for member, content in members.items():
            archive.writestr(member, content)


def examine(path, kind, only_cut):
    """Reads everything; returns the events' rows, or None after a proper error.

    Raises:
        AssertionError: the error is no proper one, or what is read contradicts itself.
    """
    try:
        return read_all(path, kind, only_cut)
    except InputError as error:
        assert_proper(error, path)
        return None


def assert_proper(error, path):
    """One printable line of bounded length that names the file, and memory was not the cause."""
    text = str(error)
    assert text.isprintable(), f"not one printable line: {text!r}"
    assert str(path) in text, f"does not name the file: {text}"
    assert len(text) < 1000, f"{len(text)} characters: {text}"
    assert not isinstance(error.__cause__, MemoryError), f"reserved what is not there: {text}"


def read_all(path, kind, only_cut):
    reader = open_events(path, STATED.get(kind))
    parts = []
    for name in reader.streams:
        own = list(reader.chunks(name))
        whole = Events.concat(own)
        parts.append(whole)
        if len(whole):
            consistent(reader, name, whole)
    found = naive.rows_of(Events.concat(parts))
    if only_cut:
        part = rows_in(kind)[: len(found)]
        assert found[:-1] == part[:-1], "a part was changed by cutting the file"
        assert kind in PREFIXES or found == rows_in(kind), (
            f"{len(found)} of {len(rows_in(kind))} events, silently"
        )
    return found


def consistent(reader, name, whole):
    """Slices hold what the whole holds; an index of the file's own promises sorted times."""
    assert whole.t_us.min() >= 0, "negative time"
    if reader.format in ("dsec", "tumvie", "m3ed") and (np.diff(whole.t_us) < 0).any():
        return
    if not same_events(whole, Events.concat(list(reader.chunks(name)))):
        # Blosc unpacks a damaged chunk to whatever memory held: it has no check sum.
        assert reader.format in ("dsec", "tumvie", "mvsec"), "two readings differ"
        return
    first, last = reader.span_us(name)
    assert (first, last) == (whole.t_us.min(), whole.t_us.max()), "span"
    middle = (first + last) // 2
    for t0_us, t1_us in ((first, last + 1), (middle, middle + 1000)):
        part = part_of(whole, (whole.t_us >= t0_us) & (whole.t_us < t1_us))
        assert same_events(reader.between(name, t0_us, t1_us), part), f"slice {t0_us} to {t1_us}"


@dataclass
class Tally:
    """What a run found."""

    kind: str
    done: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    peak_mb: float = 0.0
    faults: list[str] = field(default_factory=list)

    def __str__(self):
        text = f"{self.kind:15} {self.done:6} done, {self.refused:6} refused, "
        text += f"slowest {1000 * self.slowest_s:5.0f} ms, {self.peak_mb:4.0f} MB more"
        return "\n    ".join([text, *self.faults[:5]])


def fuzz(kind, examples, first=0, begin=None):
    """Runs examples of a kind in a process of its own; returns what it found."""
    ours, theirs = get_context("fork").Pipe(duplex=False)
    tally = Tally(kind)
    with tempfile.TemporaryDirectory() as folder:
        process = get_context("fork").Process(
            target=work, args=(theirs, Path(folder), kind, first, examples, begin or begun)
        )
        process.start()
        theirs.close()
        while watch(ours, tally):
            pass
        process.kill()
        process.join()
    if tally.done < examples and not tally.faults:
        tally.faults.append(f"example {first + tally.done}: crash or hang")
    return tally


def watch(pipe, tally):
    """Takes one report; False at the end, after a crash, or when none comes in time."""
    if not pipe.poll(PATIENCE_S + 20 * (not tally.done)):
        return False
    try:
        done, refused, took_s, peak_mb, fault = pipe.recv()
    except EOFError:
        return False
    tally.done, tally.refused = tally.done + done, tally.refused + refused
    tally.slowest_s = max(tally.slowest_s, took_s)
    tally.peak_mb = max(tally.peak_mb, peak_mb)
    tally.faults += fault
    return True


def begun(folder, kind):
    """What one example does: damages a sound file with `rng` and reads it."""
    source, target = sound(folder, kind), folder / "damaged"
    assert examine(source, kind, True) == rows_in(kind)

    def example(rng):
        only_cut = damage(source, target, rng, kind)
        try:
            return examine(target, kind, only_cut)
        finally:
            shutil.rmtree(target) if target.is_dir() else target.unlink(missing_ok=True)

    return example


def work(pipe, folder, kind, first, examples, begin):
    """The process's part: all examples one after another, a report after each."""
    example = begin(folder, kind)
    reserved, used = limit_memory(), peak_mb()
    for number in range(first, first + examples):
        began_s, fault, found = time.process_time(), [], None
        try:
            found = example(np.random.default_rng([7, number]))
        except BaseException as error:  # whatever a reader lets through is a fault
            last = traceback.extract_tb(error.__traceback__)[-1]
            at = f"{Path(last.filename).name}:{last.lineno}"
            fault.append(f"example {number}: {type(error).__name__} at {at}: {str(error)[:300]}")
        took_s = time.process_time() - began_s
        pipe.send((1, found is None, took_s, peak_mb() - used, fault))
    del reserved


def limit_memory():
    """Lets this process reserve only so much more; returns the limit."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + ROOM
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    return limit


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(examples="200", *words, kinds=KINDS, begin=None):
    first = int(words[-1]) if words and words[-1].isdigit() else 0
    chosen = [word for word in words if not word.isdigit()] or kinds
    tallies = []
    if begin is None:
        with tempfile.TemporaryDirectory() as folder:
            begun(Path(folder), chosen[0])  # what it loads, each process has from the start
    for kind in chosen:
        tallies.append(fuzz(kind, int(examples), first, begin))
        sys.stdout.write(f"{tallies[-1]}\n")
        sys.stdout.flush()
    return any(tally.faults for tally in tallies)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
