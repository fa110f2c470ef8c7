"""What a long recording costs: every verb on one of so many events, its rate and its memory.

`python tests/benchmarks long_recording --millions 200 --page docs/performance.md` writes a stereo
recording of moving edges, runs the verbs on it, each in a process of its own, and writes the table.
Rates are those of the clock, with all processors, so that only a quiet machine gives honest ones.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cost_stream import WINDOW_US, MovingEdges
from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import show
from peak_memory import VERB, peak_mb
from study_cost import machine

SIZE_PX, PLANES, METHOD = (640, 480), 100, "Alg1/H"
EVENTS_PER_WINDOW = 2_000_000
LARGER = 4
"""By how much more events a window has whose memory is compared."""


@dataclass(frozen=True)
class Cost:
    """What one verb took.

    Attributes:
        what: the verb, with what differs.
        events: how many it read.
        clock_s: time of the clock, from the start of the process to its end, s.
        cpu_s: of all processors, s.
        peak_mb: the most memory at once, MB, libraries included.
    """

    what: str
    events: int
    clock_s: float
    cpu_s: float
    peak_mb: float


def measured(what: str, events: int, words: list[str]) -> Cost:
    """Runs `eventsweep WORDS`."""
    before, began_s = os.times(), time.perf_counter()
    peak = peak_mb(VERB, [*words, "--quiet"])
    after, clock_s = os.times(), time.perf_counter() - began_s
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    cost = Cost(what, events, clock_s, cpu_s, peak)
    sys.stderr.write(f"{row(cost)}\n")
    return cost


def costs(folder: Path, windows: int, one: int = EVENTS_PER_WINDOW) -> Iterator[Cost]:
    """Of all verbs, on a recording that is written into `folder`.

    Args:
        folder: empty, removed by the caller.
        windows: how many.
        one: events of each camera in one window.
    """
    recording = folder / "recording"
    MovingEdges(SIZE_PX, one, windows=windows).write(recording)
    both = 2 * one * windows
    yield measured("`info`", both, ["info", str(recording)])
    target = str(folder / "cam0.raw")
    words = ["convert", str(recording), target, "--to", "evt3", "--stream", "cam0"]
    yield measured("`convert --to evt3`, one camera", both // 2, words)
    maps = folder / "maps"
    for times in (1, LARGER):
        name = f"`map`, windows of {times * one / 1e6:g} M events of each camera"
        yield measured(name, both, map_words(recording, maps / str(times), times))
    yield measured("`fuse` of the first map", both, ["fuse", str(maps / "1"), "--method", METHOD])


def map_words(recording: Path, out: Path, times: int) -> list[str]:
    """The command that maps windows one after the other, `times` as long as the shortest."""
    window_s = str(1e-6 * times * WINDOW_US)
    flags = {"window-s": window_s, "stride-s": window_s, "planes": str(PLANES)}
    words = ["map", str(recording), "--out", str(out), "--method", METHOD, "--no-check"]
    return words + [part for name, value in flags.items() for part in (f"--map.{name}", value)]


def row(cost: Cost) -> str:
    """One line of the table."""
    cells = (
        cost.what, f"{cost.clock_s:.1f}", f"{cost.cpu_s:.1f}",
        f"{cost.events / 1e6 / cost.clock_s:.2f}", f"{cost.peak_mb:.0f}",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def main(arguments: list[str] | None = None) -> int:
    """Prints and writes the table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--millions", type=int, default=200, help="events of both cameras")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    asked = parser.parse_args(arguments)
    with exit_code() as code, tempfile.TemporaryDirectory() as folder:
        windows, left = divmod(asked.millions * 1_000_000, 2 * EVENTS_PER_WINDOW)
        if left or windows < LARGER:
            unit = 2 * EVENTS_PER_WINDOW // 1_000_000
            least = LARGER * unit
            raise InputError(
                f"--millions {asked.millions}: give a multiple of {unit}, at least {least}"
            )
        about = machine()
        lines = [
            about, "",
            f"{asked.millions} M events, 2 × {SIZE_PX[0]}×{SIZE_PX[1]}; `{METHOD}`, {PLANES} "
            "planes. Every process's start is included.", "",
            "| | s | CPU s | Mev/s | peak memory, MB |", "|---|--:|--:|--:|--:|",
            *map(row, costs(Path(folder), windows)),
        ]  # fmt: skip
        show("\n".join(lines) + "\n", asked.page, "long")
    return code.value


if __name__ == "__main__":
    sys.exit(main())
