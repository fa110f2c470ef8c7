"""How stable a ranking is: methods ranked by each half of the seeds, in every way to halve them.

`python tests/benchmarks split_half RESULT --page plugins/ranking/ranking.md` says how often couples of methods
that do not tie keep their order, and how alike the orders of the halves are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.stats import kendalltau

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.scoring.direction import Direction
from eventsweep.plugins.ranking.entries import Merged, read_source
from eventsweep.plugins.ranking.standings import Table, places, standings
from eventsweep.plugins.ranking.summary import MAIN, direction_of, parts, ranked, table_of
from markdown_blocks import show

MARK = "stability"
LEAST_SEEDS = 4
_MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class SplitHalf:
    """How stable an order is: methods ranked twice, each time by half of the seeds.

    Attributes:
        splits: in how many ways the seeds were halved.
        pairs: couples of methods that do not tie by all seeds.
        kept: share of those couples whose order is the same in both halves, over all splits.
        agreement: Kendall's tau-b of the two halves' mean places, over all splits.
        turned: couples that do not tie, and in how many splits a half turns them around.
    """

    splits: int
    pairs: int
    kept: float
    agreement: float
    turned: Mapping[tuple[str, str], int]


def split_half(table: Table, direction: Direction) -> SplitHalf:
    """Halves the seeds in every way and compares the orders.

    Args:
        table: as `standings` takes it; every case with the same number of seeds, 4 or more.
        direction: which end of the metric is better.
    """
    ranked = {one.method: one for one in standings(table, direction)}
    methods = list(table)
    distinct = [
        (a, b)
        for a, b in combinations(range(len(methods)), 2)
        if ranked[methods[a]].rank != ranked[methods[b]].rank
    ]
    by_case = places(table, direction)
    seeds = by_case[0].shape[1]
    turned: dict[tuple[str, str], int] = {}
    agreements, kept, splits = [], 0, list(_halves(seeds))
    for half in splits:
        rest = [k for k in range(seeds) if k not in half]
        one, two = (
            np.mean([found[:, chosen].mean(axis=1) for found in by_case], axis=0)
            for chosen in (list(half), rest)
        )
        agreements.append(float(kendalltau(one, two).statistic))
        for a, b in distinct:
            if (one[a] - one[b]) * (two[a] - two[b]) > 0:
                kept += 1
            else:
                pair = methods[a], methods[b]
                turned[pair] = turned.get(pair, 0) + 1
    share = kept / (len(distinct) * len(splits)) if distinct else float("nan")
    return SplitHalf(len(splits), len(distinct), share, float(np.mean(agreements)), turned)


def _halves(seeds: int) -> list[tuple[int, ...]]:
    """Every way to choose half of the seeds; of an even number each only once."""
    chosen = list(combinations(range(seeds), seeds // 2))
    return [half for half in chosen if seeds % 2 or 0 in half]


def main() -> int:
    """Prints and writes what came out; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", nargs="+", help="what `suite` or `ranking` wrote, oldest first")
    parser.add_argument("--metric", default=MAIN, help="by which methods are ranked")
    parser.add_argument("--page", type=Path, help="page to write the text into")
    asked = parser.parse_args()
    with exit_code() as code:
        entries = [entry for one in asked.results for entry in read_source(one).entries]
        text = stability_text(parts(entries)[0], asked.metric)
        show(text, asked.page, MARK)
    return code.value


def stability_text(joined: Merged, metric: str) -> str:
    """What the halves say, in words.

    Raises:
        InputError: a case with fewer than four seeds, cases with different numbers of them, or an
            unknown metric.
    """
    if metric not in joined.base.units:
        raise InputError(f"no metric {metric}: choose from {', '.join(joined.base.units)}")
    counts = {len(seeds) for case, seeds in joined.seeds.items() if case in joined.cases}
    if min(counts) < LEAST_SEEDS or len(counts) > 1:
        raise InputError(
            f"cases with {', '.join(map(str, sorted(counts)))} seeds: needs the same number of "
            f"{LEAST_SEEDS} or more for each"
        )
    methods = [one.method for one in ranked(joined, metric).standings]
    found = split_half(
        table_of(joined, methods, metric, joined.cases), direction_of(joined, metric)
    )
    return _text(found, len(methods), joined, metric)


def _text(found: SplitHalf, methods: int, joined: Merged, metric: str) -> str:
    seeds = len(joined.seeds[joined.cases[0]])
    couples = methods * (methods - 1) // 2
    lines = [
        f"{methods} methods, {len(joined.cases)} cases, {seeds} seeds halved in {found.splits} "
        f"ways, ranked by `{metric}`: Kendall's τ of the halves' orders is {found.agreement:.2f} "
        f"on average. {found.pairs} of {couples} couples do not tie by all seeds;"
    ]
    if not found.pairs:
        return f"{lines[0][:-1]}.\n"
    lines[0] += f" their order is the same in both halves {100 * found.kept:.1f} % of the time."
    often = sorted(found.turned.items(), key=lambda one: -one[1])[:_MOST_NAMED]
    if often:
        names = "; ".join(f"{a} and {b} in {n} of {found.splits}" for (a, b), n in often)
        lines.append(f"Turned around most often: {names}.")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
