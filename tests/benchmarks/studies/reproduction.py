"""Sets the twin of MVSEC's flights beside the published table of its original.

`python tests/benchmarks reproduction --out DIR --page docs/paper.md` runs the suite
`mvsec-table-v2`, or another one with `--suite`, and writes the tables between the page's marks.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.eval.cli import job_flags
from eventsweep.eval.cli.console import Console
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.results.results import Results
from eventsweep.eval.results.series import Key, Series, measured_of
from eventsweep.eval.suite import output
from eventsweep.eval.suite.definition import load
from markdown_blocks import show
from published_table import MONO, RATIOS, TABLE, H, Published
from table_code import Code, of_suite

SUITE, MARK = "mvsec-table-v2", "reproduction"


SETTINGS = (
    ("mvsec-flying", "", "", "published thresholds"),
    ("mvsec-flying", " strict", "", "H with C = 18"),
    ("half-second", " pair", " pair", "windows of 0.5 s"),
    ("quarter-second", " pair", " pair", "windows of 0.25 s"),
    ("mvsec-flying", " mcemvs", " mcemvs", '`compatibility = "mcemvs"`'),
    ("noisy", "", "", "noise of a DAVIS346"),
    ("noisy", " mcemvs", " mcemvs", "both"),
    ("imperfect", "", "", "noise, imperfect geometry"),
    ("imperfect", " mcemvs", " mcemvs", "the same, `mcemvs`"),
    ("mvsec-flying", " project", " project", "this project's thresholds"),
    ("exact", "", "", "exact geometry, ideal sensor"),
    ("sensor", "", "", "a real sensor's pixels"),
    ("imperfect", " cap-78", " cap-78", "the same, 78 votes as full confidence"),
    ("imperfect", " cap-79", " cap-79", "the same, 78.8 votes"),
)
"""Case, ending of the names of H and of the single camera, and what the table calls both."""
EXACT = ("mvsec-flying", "exact")
"""Cases without errors, of which a suite has one."""

Scores = Mapping[Key, Series]


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {"docs/paper.md#reproduction": Code(("reproduction:report",)) + of_suite(SUITE)}


def main() -> int:
    """Runs the suite, prints and writes the tables; exit code 2 on bad input, 1 on failed jobs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder for suite.json and suite.csv")
    parser.add_argument("--page", type=Path, help="page to write the tables into")
    parser.add_argument("--suite", default=SUITE, help="which twins")
    parser.add_argument("--case", action="append", default=[], help="some of the suite's cases")
    parser.add_argument("--seeds", help="seeds instead of the suite's own, such as 0-9")
    parser.add_argument("--workers", type=int, help="worker processes")
    asked = parser.parse_args()
    with exit_code() as ended:
        result = _run(asked)
        text = report(result)
        show(text, asked.page, MARK, code)
        ended.value = 1 if result.failures else 0
    return ended.value


def _run(asked: argparse.Namespace) -> Results:
    suite, subset = load(asked.suite)
    seeds = job_flags.seed_numbers(asked.seeds, "--seeds")
    progress = Console(quiet=False, as_json=False).progress
    flags = job_flags.JobFlags(workers=asked.workers)
    with ExitStack() as stack:
        if asked.out is not None:
            stack.enter_context(output.prepare_folder(asked.out, force=True))
        result = job_flags.run_with_flags(
            suite, subset, flags, progress, seeds=seeds, cases=tuple(asked.case), speed=False
        )
        if asked.out is not None:
            output.write(asked.out, result, force=True)
    return result


def report(result: Results) -> str:
    """Both tables, in Markdown.

    Args:
        result: of the suite, whichever of its cases were run.
    """
    scores = measured_of(result).series
    flights = len(result.seeds)
    return "\n".join(
        [
            f"Means over {flights} flights (seeds) of two windows each, of 1 s unless said; in "
            "brackets the least and the greatest of a single flight.\n",
            *_ratio_lines(scores),
            "",
            *(line for case in EXACT for line in _order_lines(_case(scores, case))),
            "",
            "With noise and imperfect geometry:\n",
            *_order_lines(_case(scores, "imperfect")),
            "",
        ]
    )


def _ratio_lines(scores: Scores) -> list[str]:
    published = " | ".join(f"{H.value(m) / MONO.value(m):.2f}" for m in RATIOS)
    lines = [
        f"| H / mono | {' | '.join(RATIOS.values())} | points |",
        "|---|" + "--:|" * (len(RATIOS) + 1),
        f"| published | {published} | {H.points_m / MONO.points_m:.2f} |",
    ]
    for case, of_h, of_mono, name in SETTINGS:
        ours = [
            (_values(scores, case, H.ours + of_h, m), _values(scores, case, MONO.ours + of_mono, m))
            for m in (*RATIOS, "points")
        ]
        if all(top.size and bottom.size for top, bottom in ours):
            lines.append(f"| {name} | {' | '.join(_ratio(*pair) for pair in ours)} |")
    return lines


def _values(scores: Scores, case: str, method: str, metric: str) -> NDArray[np.float64]:
    """One value per flight, in the order of seeds; none where the method did not run."""
    series = scores.get(Key(case, method, metric))
    values = series.values if series is not None else {}
    return np.array([values[seed] for seed in sorted(values)], dtype=np.float64)


def _ratio(top: NDArray[np.float64], bottom: NDArray[np.float64]) -> str:
    """Ratio of means, with the range of single flights: too few for an interval."""
    single = top / bottom
    return f"{top.mean() / bottom.mean():.2f} ({single.min():.2f} to {single.max():.2f})"


def _case(scores: Scores, case: str) -> Scores:
    """What one case has, as if it were the suite's only one."""
    own = ((key, series) for key, series in scores.items() if key.case == case)
    return {Key("", key.method, key.metric): series for key, series in own}


def _order_lines(scores: Scores) -> list[str]:
    known = [line for line in TABLE if _values(scores, "", line.ours, "points").size]
    if H not in known:
        return []
    lines = [
        "| method | mean error, published | ours | median, published | ours | bad-pix %, published "
        "| ours | points / H, published | ours |",
        "|---|" + "--:|" * 8,
    ]
    for line in known:
        cells = [f"{line.mean_cm:.1f} cm", _cm(scores, line, "mean_error")]
        cells += [f"{line.median_cm:.1f} cm", _cm(scores, line, "median_error")]
        cells += [f"{line.bad_percent:.2f}", f"{_mean(scores, line, 'bad_published'):.2f}"]
        points = _mean(scores, line, "points") / _mean(scores, H, "points")
        cells += [f"{line.points_m / H.points_m:.2f}", f"{points:.2f}"]
        lines.append(f"| {line.method}: `{line.ours}` | {' | '.join(cells)} |")
    return [*lines, "", *(_order(scores, known, metric) for metric in RATIOS)]


def _mean(scores: Scores, line: Published, metric: str) -> float:
    return float(_values(scores, "", line.ours, metric).mean())


def _cm(scores: Scores, line: Published, metric: str) -> str:
    return f"{100 * _mean(scores, line, metric):.1f} cm"


def _order(scores: Scores, known: Sequence[Published], metric: str) -> str:
    """Which pairs of methods stand the other way round than published."""
    pairs = list(combinations(known, 2))
    turned = [
        f"`{a.ours}` and `{b.ours}`"
        for a, b in pairs
        if (a.value(metric) < b.value(metric))
        != (_mean(scores, a, metric) < _mean(scores, b, metric))
    ]
    tau = 1 - 2 * len(turned) / len(pairs)
    same = (
        f"{len(pairs) - len(turned)} of {len(pairs)} pairs of methods in the published order "
        f"(Kendall's τ {tau:.1f})"
    )
    end = f"; the other way round: {', '.join(turned)}" if turned else ""
    return f"- By {RATIOS[metric]}: {same}{end}."


if __name__ == "__main__":
    raise SystemExit(main())
