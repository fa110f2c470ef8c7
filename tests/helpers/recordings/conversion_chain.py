"""Conversions from each format to the next, and the memory that each takes."""

from __future__ import annotations

import sys
import time

import numpy as np

import event_files
from eventsweep.emvs.formats import FORMATS, open_events
from peak_memory import VERB, peak_mb

SIZE_PX = (1280, 720)
STEP_US = 10


def convert(source, target, to):
    """One conversion; returns its peak, MB."""
    words = ["convert", str(source), str(target), "--to", to, "--quiet"]
    size = ["--width-px", str(SIZE_PX[0]), "--height-px", str(SIZE_PX[1])]
    return peak_mb(VERB, [*words, *size])


def run_chain(folder, count, chain):
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
