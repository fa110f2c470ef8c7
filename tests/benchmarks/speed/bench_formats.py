"""Benchmarks of the event formats' readers and writers; not collected by default.

Run: pytest tests/benchmarks/speed/bench_formats.py --benchmark-only -s
Prints million events per second of processor time on one thread, and fails where a reader is slower
than `LEAST_MEV_S` promises; with the environment's EVENT_FORMATS_PAGE=docs/formats.md it also
writes the table there.
"""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path

import pytest

from event_files import ALL, WRITTEN, moving_edges, stream_of, write_any
from eventsweep.emvs.formats import FORMATS, open_events, write_events
from markdown_blocks import into_page
from table_code import Code

COUNT = 1 << 22
SIZE_PX = (1280, 720)
HDF5 = ("prophesee-hdf5", "dsec", "tumvie", "mvsec")
RAW = ("evt2", "evt21", "evt3", "rosbag1")
LEAST_MEV_S = dict.fromkeys(HDF5, 50) | dict.fromkeys(RAW, 30)


MEASURED: dict[str, dict[str, str]] = {name: {} for name in ALL}


def report(name, what, count, seconds, size_bytes):
    MEASURED[name][what] = f"{count / seconds / 1e6:.0f}"
    MEASURED[name]["bytes"] = f"{size_bytes / count:.1f}"
    print(f"\n{name:15} {what:5} {count / seconds / 1e6:7.1f} Mev/s")  # noqa: T201
    return count / seconds / 1e6


def size_of(path):
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files)


def speeds():
    """The table of what was measured."""
    lines = [
        "| Format | Read, Mev/s | Promised | Write, Mev/s | Bytes per event |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| `{name}` | {row['read']} | {LEAST_MEV_S.get(name, '–')} | {row.get('write', '–')} "
        f"| {row['bytes']} |"
        for name, row in MEASURED.items()
    ]
    return "\n".join(lines) + "\n"


def code():
    """What the numbers depend on."""
    return {
        "docs/formats.md#speeds": Code(
            ("bench_formats:test_read", "bench_formats:test_write", "bench_formats:speeds")
        )
    }


@pytest.fixture(scope="module", autouse=True)
def page():
    """Writes the table, where a page is named and every number was measured."""
    yield
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"\nat most {memory} MB of memory, with the libraries and all events of one run")  # noqa: T201
    target = os.environ.get("EVENT_FORMATS_PAGE")
    whole = all("read" in row for row in MEASURED.values())
    if not target or not whole or not all("write" in MEASURED[name] for name in WRITTEN):
        return
    into_page(Path(target), "speeds", speeds(), code)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("name", ALL)
def test_read(benchmark, tmp_path, name):
    path = write_any(tmp_path / f"events{FORMATS[name].suffix}", name, SIZE_PX, moving_edges(COUNT))

    def read():
        return sum(len(part) for part in open_events(path).chunks(stream_of(name)))

    assert benchmark.pedantic(read, rounds=3, warmup_rounds=1) == COUNT
    speed = report(name, "read", COUNT, benchmark.stats.stats.min, size_of(path))
    assert speed >= LEAST_MEV_S.get(name, 0)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("name", WRITTEN)
def test_write(benchmark, tmp_path, name):
    path = tmp_path / f"events{FORMATS[name].suffix}"
    parts = list(moving_edges(COUNT // 2))

    def write():
        return write_events(path, name, *SIZE_PX, {stream_of(name): parts})

    count = benchmark.pedantic(write, rounds=2, warmup_rounds=1)
    report(name, "write", count, benchmark.stats.stats.min, size_of(path))
