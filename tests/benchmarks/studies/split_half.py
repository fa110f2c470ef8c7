"""How stable a ranking is: methods ranked by each half of the seeds, in every way to halve them.

`python tests/benchmarks split_half RESULT --page docs/ranking.md` says how often couples of methods
that do not tie keep their order, and how alike the orders of the halves are.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.ranking.entries import Joined, read_source
from eventsweep.eval.ranking.standings import SplitHalf, split_half
from eventsweep.eval.ranking.summary import MAIN, better_of, parts, ranked, table_of
from markdown_blocks import into_page

MARK = "stability"
LEAST_SEEDS = 4
_MOST_NAMED = 5


def main() -> int:
    """Prints and writes what came out; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", nargs="+", help="what `suite` or `ranking` wrote, oldest first")
    parser.add_argument("--metric", default=MAIN, help="by which methods are ranked")
    parser.add_argument("--page", type=Path, help="page to write the text into")
    asked = parser.parse_args()
    with exit_code() as code:
        entries = [entry for one in asked.results for entry in read_source(one).entries]
        text = told(parts(entries)[0], asked.metric)
        if asked.page is not None:
            into_page(asked.page, MARK, text)
        sys.stdout.write(text)
    return code.value


def told(joined: Joined, metric: str) -> str:
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
    found = split_half(table_of(joined, methods, metric, joined.cases), better_of(joined, metric))
    return _text(found, len(methods), joined, metric)


def _text(found: SplitHalf, methods: int, joined: Joined, metric: str) -> str:
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
