"""How much faster several workers are than one, from empty caches.

`python tests/benchmarks suite_efficiency --page docs/suite.md` runs `quick` with one worker and
with two, and writes the line of the page. Only a machine on which nothing else runs gives an honest
one.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

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
        alone_s, together_s = (elapsed_s(asked.suite, count) for count in (1, asked.workers))
        text = line(asked.suite, asked.workers, alone_s, together_s)
        show(text, asked.page, MARK)
    return code.value


def elapsed_s(name: str, workers: int) -> float:
    """Time of the clock for a suite from an empty cache, its workers' start included, s.

    Raises:
        InputError: an unknown suite, less than one worker, or a job that failed.
    """
    suite, subset = load(name)
    with tempfile.TemporaryDirectory() as folder:
        flags = job_flags.JobFlags(workers=workers, cache=Path(folder))
        started_s = time.monotonic()
        result = job_flags.run_with_flags(suite, subset, flags, Silent(), speed=False)
        took_s = time.monotonic() - started_s
    if result.failures:
        first = result.failures[0]
        raise InputError(f"{first.name} failed, so there is nothing to time: {first.failure}")
    return took_s


def line(name: str, workers: int, alone_s: float, together_s: float) -> str:
    """One sentence: both times, and the share of the ideal speed-up."""
    share = alone_s / (workers * together_s)
    return (
        f"`{name}` from an empty cache: {alone_s:.1f} s with one worker, {together_s:.1f} s with "
        f"{workers}, {share:.2f} of ideal.\n"
    )


if __name__ == "__main__":
    raise SystemExit(main())
