"""Memory of conversions: `python tests/benchmarks memory_convert [MILLIONS ...] [FORMAT ...]`.

Writes so many million events of moving edges (5 and 50 unless told) in the first format, then runs
`eventsweep convert` from each format to the next (those of `CHAIN` unless told), each in a process
of its own, and prints the peak memory of each: it must not grow with the file. Every event is
compared at the end. With `--page PAGE` the table goes between that page's markers.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import event_files
from eventsweep.emvs.formats import FORMATS, open_events
from markdown_blocks import into_page
from peak_memory import VERB, peak_mb

SIZE_PX = (1280, 720)
STEP_US = 10
CHAIN = (
    "dsec", "evt3", "rosbag1", "npz", "tumvie", "aedat4", "evt2", "mvsec", "csv", "esim-text",
    "text", "dsec",
)  # fmt: skip


def convert(source, target, to):
    """One conversion; returns its peak, MB."""
    words = ["convert", str(source), str(target), "--to", to, "--quiet"]
    size = ["--width-px", str(SIZE_PX[0]), "--height-px", str(SIZE_PX[1])]
    return peak_mb(VERB, [*words, *size])


def run_chain(folder, count, chain=CHAIN):
    """Peak of each conversion, MB; each file is deleted when the next one is there."""
    source = folder / f"0{FORMATS[chain[0]].suffix}"
    packets = event_files.moving_edges(count, step_us=STEP_US)
    event_files.write_any(source, chain[0], SIZE_PX, packets)
    peaks = []
    for k, to in enumerate(chain[1:], 1):
        target, began_s = folder / f"{k}{FORMATS[to].suffix}", time.perf_counter()
        peaks.append(convert(source, target, to))
        size_mb, took_s = target.stat().st_size / 1e6, time.perf_counter() - began_s
        source.unlink()
        source = target
        said = f"{count / 1e6:5.0f} M {chain[k - 1]:>9} to {to:9} {peaks[-1]:5.0f} MB of memory"
        sys.stderr.write(f"{said}, {took_s:5.0f} s, {size_mb:6.0f} MB on disk\n")
    compare(source, count)
    source.unlink()
    return peaks


def compare(path, count):
    """Ends the program where the last file holds anything but what went into the first."""
    reader, left = open_events(path), None
    expected = event_files.moving_edges(count, step_us=STEP_US)
    for part in reader.chunks(reader.streams[0]):
        start = 0
        while start < len(part):
            left = next(expected) if left is None else left
            size = min(len(left), len(part) - start)
            one, other = part.slice(start, start + size), left.slice(0, size)
            for column in ("x", "y", "t_us", "p"):
                if not np.array_equal(getattr(one, column), getattr(other, column)):
                    raise SystemExit(f"{path}: {column} differs near event {start}")
            start += size
            left = left.slice(size, len(left)) if size < len(left) else None
    if left is not None or next(expected, None) is not None:
        raise SystemExit(f"{path}: events are missing")


def table(peaks, chain=CHAIN):
    """Markdown: a row per conversion, a column per length."""
    head = ["Conversion", *(f"{count} M events, MB" for count in peaks)]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for k, (source, to) in enumerate(itertools.pairwise(chain)):
        cells = [f"`{source}` to `{to}`", *(f"{column[k]:.0f}" for column in peaks.values())]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(*words):
    page = Path(words[words.index("--page") + 1]) if "--page" in words else None
    counts = [int(word) for word in words if word.isdigit()] or [5, 50]
    chain = [word for word in words if word in FORMATS] or CHAIN
    peaks = {}
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            peaks[count] = run_chain(Path(folder), count * 10**6, chain)
    sys.stdout.write(table(peaks, chain))
    if page:
        into_page(page, "memory", table(peaks, chain))


if __name__ == "__main__":
    main(*sys.argv[1:])
