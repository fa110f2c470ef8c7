"""How much faster several workers are than one, from empty caches.

`python tests/benchmarks suite_efficiency --page docs/suite.md` runs `quick` with one worker and
with two, and writes the line of the page. Only a machine on which nothing else runs, and on which
the suite has compiled its kernels before, gives an honest one.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli import job_flags
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.progress import Silent
from eventsweep.eval.suite.definition import load
from markdown_blocks import show

MARK = "efficiency"


def main() -> int:
    """Prints and writes the line; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--suite", default="quick", help="what to run, as `eventsweep suite` does")
    parser.add_argument("--workers", type=int, default=2, help="how many are held against one")
    parser.add_argument("--page", type=Path, help="page to write the line into")
    asked = parser.parse_args()
    with exit_code() as code:
        alone, together = (took(asked.suite, count) for count in (1, asked.workers))
        text = line(asked.suite, asked.workers, alone, together)
        show(text, asked.page, MARK)
    return code.value


class Took(NamedTuple):
    """Time of the clock and of all processors, s."""

    wall_s: float
    cpu_s: float

    def __str__(self) -> str:
        return f"{self.wall_s:.1f} s on {self.cpu_s / self.wall_s:.2f} cores"


def took(name: str, workers: int) -> Took:
    """Time of a suite from an empty cache, its workers' start included.

    Raises:
        InputError: an unknown suite, less than one worker, or a job that failed.
    """
    suite, subset = load(name)
    with tempfile.TemporaryDirectory() as folder:
        flags = job_flags.JobFlags(workers=workers, cache=Path(folder))
        started_s, started_cpu_s = time.monotonic(), _cpu_s()
        result = job_flags.run_with_flags(suite, subset, flags, Silent(), speed=False)
        spent = Took(time.monotonic() - started_s, _cpu_s() - started_cpu_s)
    if result.failures:
        first = result.failures[0]
        raise InputError(f"{first.name} failed, so there is nothing to time: {first.failure}")
    return spent


def _cpu_s() -> float:
    """Of this process and of those that it started and that have ended, s."""
    return sum(os.times()[:4])


def line(name: str, workers: int, alone: Took, together: Took) -> str:
    """One sentence: times, cores that were busy, and the share of the ideal speed-up."""
    share = alone.wall_s / (workers * together.wall_s)
    return (
        f"`{name}` from an empty cache: {alone} with one worker, {together} with {workers}, "
        f"{share:.2f} of ideal.\n"
    )


if __name__ == "__main__":
    raise SystemExit(main())
