"""Benchmarks of the event formats' readers and writers; not collected by default.

Run: pytest tests/bench_codecs.py --benchmark-only -s
Prints million events per second of processor time on one thread; with the environment's
EVENT_FORMATS_PAGE=docs/event_formats.md it also writes the table there.
The stream is what a 1280x720 sensor gives of moving edges: bursts along rows in the order of time.
"""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path

import numpy as np
import pytest

from emvs.data.events import Events
from emvs.io.events import FORMATS, open_events, write_events
from emvs.io.events.__main__ import replaced

COUNT = 1 << 22
PACKET = 1 << 18
SIZE_PX = (1280, 720)
WRITTEN = [name for name, entry in FORMATS.items() if entry.writes]


def packets(count=COUNT):
    """Rows that fire together, 4 to 24 pixels of one polarity, a microsecond or two apart."""
    rng = np.random.default_rng(0)
    for _ in range(count // PACKET):
        length = rng.integers(4, 24, PACKET // 8)
        run = np.repeat(np.arange(len(length)), length)[:PACKET]
        column = np.concatenate([np.arange(n) for n in length])[:PACKET]
        x = (rng.integers(0, 1256, len(length))[run] + column).astype(np.uint16)
        y = rng.integers(0, 720, len(length))[run].astype(np.uint16)
        p = rng.integers(0, 2, len(length))[run].astype(np.uint8)
        t_us = packets.t_us + np.cumsum(rng.integers(0, 3, len(length)))[run].astype(np.int64)
        packets.t_us = int(t_us[-1])
        yield Events(x, y, t_us, p)


packets.t_us = 0


MEASURED: dict[str, dict[str, str]] = {name: {} for name in WRITTEN}


def report(name, what, count, seconds, size_bytes):
    MEASURED[name][what] = f"{count / seconds / 1e6:.0f}"
    MEASURED[name]["bytes"] = f"{size_bytes / count:.1f}"
    print(f"\n{name:10} {what:5} {count / seconds / 1e6:7.1f} Mev/s")  # noqa: T201


@pytest.fixture(scope="module", autouse=True)
def page():
    """Writes the table, where a page is named and every number was measured."""
    yield
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"\nat most {memory} MB of memory, with the libraries and all events of one run")  # noqa: T201
    target = os.environ.get("EVENT_FORMATS_PAGE")
    if not target or not all(len(row) == 3 for row in MEASURED.values()):
        return
    lines = ["| Format | Read, Mev/s | Write, Mev/s | Bytes per event |", "|---|---|---|---|"]
    lines += [
        f"| `{name}` | {row['read']} | {row['write']} | {row['bytes']} |"
        for name, row in MEASURED.items()
    ]
    path = Path(target)
    begin, end = "<!-- speeds: begin -->\n", "<!-- speeds: end -->\n"
    text = replaced(path.read_text(encoding="utf-8"), begin, end, "\n".join(lines) + "\n")
    path.write_text(text, encoding="utf-8")


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("name", WRITTEN)
def test_read(benchmark, tmp_path, name):
    path = tmp_path / f"events{FORMATS[name].suffix}"
    stream = "davis/left" if name == "mvsec" else "events"
    count = write_events(path, name, *SIZE_PX, {stream: packets()})

    def read():
        return sum(len(part) for part in open_events(path).chunks(stream))

    assert benchmark.pedantic(read, rounds=3, warmup_rounds=1) == count
    report(name, "read", count, benchmark.stats.stats.min, path.stat().st_size)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("name", WRITTEN)
def test_write(benchmark, tmp_path, name):
    path = tmp_path / f"events{FORMATS[name].suffix}"
    stream = "davis/left" if name == "mvsec" else "events"
    parts = list(packets(COUNT // 2))

    def write():
        return write_events(path, name, *SIZE_PX, {stream: parts})

    count = benchmark.pedantic(write, rounds=2, warmup_rounds=1)
    report(name, "write", count, benchmark.stats.stats.min, path.stat().st_size)
