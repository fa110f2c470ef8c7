"""How often 95 % intervals hold the truth, simulated.

`python tests/benchmarks interval_coverage --page docs/scores.md` draws many samples of seeds and
windows whose true mean is known and counts how often each kind of interval holds it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.scoring.significance import intervals, stratified_interval
from markdown_blocks import show

DESIGNS = ((2, 5), (3, 5), (5, 1), (5, 4), (5, 20), (8, 1), (8, 10), (12, 3), (20, 5))
"""Seeds, and windows of each."""
BETWEEN = (0.1, 0.5, 0.9)
"""Share of the variance that is between seeds."""
TRIALS = 1000
_AT_ONCE = 250
_SKEW = 0.5

Draw = Callable[[np.random.Generator, tuple[int, ...]], NDArray[np.float64]]


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Standard normal numbers."""
    return rng.standard_normal(shape)


def skewed(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Log-normal numbers of mean 0 and variance 1, with a skewness of 1.75."""
    growth = np.exp(_SKEW**2)
    numbers = np.exp(_SKEW * rng.standard_normal(shape))
    scaled: NDArray[np.float64] = (numbers - np.sqrt(growth)) / np.sqrt(growth * (growth - 1))
    return scaled


def coverage(
    seeds: int, windows: int, between: float, *, trials: int = TRIALS, draw: Draw = normal
) -> float:
    """How often the interval of a mean over seeds and windows holds the truth.

    Args:
        seeds: of each sample.
        windows: of each seed.
        between: share of the variance that is between seeds; the rest is between windows.
        trials: samples drawn, a multiple of 250: so many share their resampling.
        draw: how seeds and windows vary.

    Returns:
        Share of samples, 0 to 1.
    """
    rng = np.random.default_rng((seeds, windows))
    hits = 0
    for batch in range(trials // _AT_ONCE):
        of_seeds = draw(rng, (seeds, 1, _AT_ONCE)) * np.sqrt(between)
        of_windows = draw(rng, (seeds, windows, _AT_ONCE)) * np.sqrt(1 - between)
        values = (of_seeds + of_windows).reshape(-1, _AT_ONCE)
        low, high = intervals(values, [windows] * seeds, seed=batch)
        hits += int(np.count_nonzero((low <= 0) & (high >= 0)))
    return hits / trials


def coverage_of_cases(cases: int, seeds: int, *, trials: int = TRIALS) -> float:
    """The same for a study's band: cases held fixed, each as uncertain as its number says."""
    rng = np.random.default_rng((cases, seeds))
    hits = 0
    for _ in range(trials):
        values = normal(rng, (cases, seeds)) * np.arange(1, cases + 1)[:, None]
        low, high = stratified_interval(list(values))
        hits += low <= 0 <= high
    return hits / trials


def table(designs: Sequence[tuple[int, int]], trials: int) -> str:
    """Markdown: true coverage of every design."""
    head = " | ".join(f"{share:.0%} between seeds" for share in BETWEEN)
    lines = [
        f"| true coverage of 95 %, {trials} samples each | {head} | skewed, {BETWEEN[1]:.0%} |",
        "|---|" + "--:|" * (len(BETWEEN) + 1),
    ]
    for seeds, windows in designs:
        shares = [coverage(seeds, windows, share, trials=trials) for share in BETWEEN]
        shares.append(coverage(seeds, windows, BETWEEN[1], trials=trials, draw=skewed))
        cells = " | ".join(f"{100 * share:.1f} %" for share in shares)
        lines.append(f"| {seeds} seeds × {windows} windows | {cells} |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Simulates, prints the table and writes it into a page as asked; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trials", type=int, default=TRIALS, help="samples per number")
    parser.add_argument("--page", type=Path, help="page whose marked part gets the table")
    chosen = parser.parse_args(arguments)
    with exit_code() as code:
        text = table(DESIGNS, chosen.trials)
        show(text, chosen.page, "coverage")
    return code.value


if __name__ == "__main__":
    sys.exit(main())
