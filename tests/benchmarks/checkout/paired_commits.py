"""Times one command of two checkouts in turn: `python tests/benchmarks paired_commits OLD NEW`.

    python tests/benchmarks paired_commits OLD NEW --runs 5 -- run desk --out {out}
    python tests/benchmarks paired_commits OLD NEW --runs 3 -- suite quick --out {out} --no-speed
    python tests/benchmarks paired_commits OLD NEW --also="--sim.sampling fast" -- simulate desk ...
    python tests/benchmarks paired_commits OLD NEW --runs 2 --cold -- run desk --out {out}

OLD and NEW are folders with a checkout each; `{out}` is a fresh folder of every run, and so is the
job cache. One run of each comes first and does not count: it compiles the kernels; with `--cold`
every run compiles them, in a cache of its own. Then they take turns, so that a machine whose speed
drifts slows down both. Wall time and time of processors, with
children; the ratio is taken pair by pair.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


class Cost(NamedTuple):
    """What one run took, s."""

    wall: float
    cpu: float


def cost_of(root: Path, words: Sequence[str], *, cold: bool) -> Cost:
    """Runs the command of a checkout, in a folder and with a cache that are new; kernels if `cold`.

    Raises:
        SystemExit: the command failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        arguments = [word.replace("{out}", f"{folder}/out") for word in words]
        variables = {"PYTHONPATH": str(root), "EVENTSWEEP_CACHE": f"{folder}/cache"}
        if cold:
            variables["NUMBA_CACHE_DIR"] = f"{folder}/kernels"
        before, began_s = _children_s(), time.perf_counter()
        done = subprocess.run(
            [_python(root), "-m", "eventsweep", *arguments], env={**os.environ, **variables},
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        cost = Cost(time.perf_counter() - began_s, _children_s() - before)
    if done.returncode:
        sys.exit(f"{root}: {' '.join(arguments)} ended with {done.returncode}\n{done.stderr}")
    return cost


def _python(root: Path) -> str:
    """The checkout's own Python, where it has one: entry points are those of what is installed."""
    own = root / ".venv" / "bin" / "python"
    return str(own) if own.is_file() else sys.executable


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def table(old: Sequence[Cost], new: Sequence[Cost]) -> str:
    """Least and median of both, and the median of the ratios new / old."""
    lines = ["| | old | new | new / old |", "|---|--:|--:|--:|"]
    for name in Cost._fields:
        before, after = ([getattr(cost, name) for cost in costs] for costs in (old, new))
        ratios = [b / a for a, b in zip(before, after, strict=True)]
        lines += [
            f"| {name}, s: least | {min(before):.2f} | {min(after):.2f} "
            f"| {min(after) / min(before):.3f} |",
            f"| {name}, s: median | {statistics.median(before):.2f} "
            f"| {statistics.median(after):.2f} | {statistics.median(ratios):.3f} |",
        ]
    return "\n".join(lines)


def main() -> None:
    """Runs the pairs and prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--runs", type=int, default=5, help="pairs that count")
    parser.add_argument("--cold", action="store_true", help="every run compiles all kernels")
    parser.add_argument("--also", default="", help="what only the new one is told besides")
    parser.add_argument("command", nargs="+", help="after --: what eventsweep is told")
    asked = parser.parse_args()
    sides = (
        (asked.old.resolve(), asked.command),
        (asked.new.resolve(), [*asked.command, *asked.also.split()]),
    )
    first = 0 if asked.cold else 1
    rounds = range(asked.runs + first)
    pairs = [[cost_of(*side, cold=asked.cold) for side in sides] for _ in rounds][first:]
    sys.stdout.write(table(*zip(*pairs, strict=True)) + "\n")


if __name__ == "__main__":
    main()
