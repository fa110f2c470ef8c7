"""The README's result table, from the committed baseline, and its numbers of a real recording,
from the page on learned extraction, where `real_check` wrote them: nobody types a number.

`python tests/benchmarks readme_table` writes it; with `--check` it only says whether it is
stale.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.gate.baseline import Baseline, read_baseline
from eventsweep.eval.report.html import Grid, GridCell, plural
from eventsweep.eval.report.ranking import column, mean_over_cases, standings_of, table
from eventsweep.eval.report.tables import as_markdown, ranking_table
from eventsweep.eval.results.series import means_over_seeds, rows_of_seeds
from eventsweep.eval.scoring.standings import RULE
from eventsweep.eval.suite.definition import load
from markdown_blocks import refresh
from table_code import Code, of_suite

REAL_TABLE = "plugins/learned/learned.md#real"
REAL = ("Alg1/H", "Focus/H", "Learned/H")
RANKED_BY = "mean_error"
METRICS = ("points", "mean_error", "median_error", "abs_rel", "bad_published", "delta_1")


def results_block(baseline: Baseline) -> str:
    """The table and the sentence below it, as Markdown.

    Args:
        baseline: means over its seeds, then over those cases on which every method was run; what
            is mapped with wrong poses and calibrations is a column of its own.
    """
    suite, _ = load(baseline.name)
    exact, imperfect = (
        [
            series
            for series in baseline.series
            if series.metric in METRICS and "/" in series.method and " " not in series.method
            and bool(suite.cases[series.case].imperfection) is wrong
        ]
        for wrong in (False, True)
    )  # fmt: skip
    if not exact:
        raise InputError("the baseline holds no method's scores; `eventsweep gate --update` does")
    means = mean_over_cases(means_over_seeds(exact), "mean")
    ranked = table(means, RANKED_BY, METRICS, standings_of(rows_of_seeds(exact), RANKED_BY))
    grid = ranking_table(ranked, "")
    for case in dict.fromkeys(series.case for series in imperfect):
        grid = _with_column(grid, means_over_seeds(s for s in imperfect if s.case == case), case)
    cases = {series.case for series in exact}
    return as_markdown(grid) + "\n" + _sentence(baseline, cases)


def _with_column(grid: Grid, rows: pd.DataFrame, case: str) -> Grid:
    """The table with the ranking metric of one more case behind it."""
    one = table(rows, RANKED_BY, (RANKED_BY,))
    cells = {line.method: line.cells[0] for line in one.lines}
    lines = ((*line, cells.get(line[0].text, GridCell("–"))) for line in grid.lines)
    head = one.columns[0].head(f"{one.columns[0].title}, {case}")
    return replace(grid, heads=(*grid.heads, head), lines=tuple(lines))


def _sentence(baseline: Baseline, cases: Iterable[str]) -> str:
    version = baseline.versions.get("eventsweep", "?")
    return (
        f"Mean over scenes of `{baseline.name}` ({_scenes(baseline, cases)}) and "
        f"{plural(len(baseline.seeds), 'seed')}, eventsweep {version}, from "
        "[`reports/baseline.json`](reports/baseline.json); bold is best of its column, "
        f"[definitions](docs/scores.md). {RULE.format(title=column(RANKED_BY).title)}\n"
    )


def _scenes(baseline: Baseline, cases: Iterable[str]) -> str:
    """The scenes, and the length of their windows, as the suite defines them."""
    suite, _ = load(baseline.name)
    by_windows: dict[str, list[str]] = {}
    for name in sorted(cases):
        case = suite.cases[name]
        lengths = " and ".join(f"{s:g}" for s in sorted({w.duration_s for w in case.windows}))
        about = f"{plural(len(case.windows), 'window')} of {lengths} s"
        by_windows.setdefault(about, []).append(case.scene)
    return "; ".join(f"{', '.join(names)}: {about} each" for about, names in by_windows.items())


def real_block(page: str) -> str:
    """What `real_check` measured, as a sentence.

    Args:
        page: text of the page that holds its table.

    Raises:
        InputError: the page lacks the table or one of its methods.
    """
    table = page.partition("<!-- real: begin -->")[2].partition("<!-- real: end -->")[0]
    lines = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| `")]
    rows = {cells[0].strip("`"): cells for cells in lines}
    lacking = [name for name in REAL if len(rows.get(name, ())) < 4]
    if lacking:
        raise InputError(f"the table of real events has no line of {', '.join(lacking)}")
    base, *others = REAL
    ratios = " and ".join(f"{rows[name][1]} ({name})" for name in others)
    outliers = ", ".join(f"{rows[name][3]} % ({name})" for name in REAL)
    return (
        f"Median errors are {ratios} times that of {base}; points that are off by more than 5 %: "
        f"{outliers}.\n"
    )


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "README.md#results": of_suite("suite-v5") + Code(data="reports/baseline.json"),
        "README.md#real": Code(data=REAL_TABLE),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes or checks the table; 1 where a check finds it stale, 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks readme_table", description=__doc__
    )
    parser.add_argument("page", type=Path, nargs="?", default=Path("README.md"))
    parser.add_argument("--baseline", type=Path, default=Path("reports/baseline.json"))
    parser.add_argument("--real", type=Path, default=Path("plugins/learned/learned.md"))
    parser.add_argument("--check", action="store_true", help="write nothing")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        block = results_block(read_baseline(asked.baseline))
        command = "python tests/benchmarks readme_table"
        brought = partial(refresh, asked.page, code=code, check=asked.check, command=command)
        ended.value = brought("results", block)
        real = real_block(asked.real.read_text(encoding="utf-8"))
        ended.value |= brought("real", real)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
