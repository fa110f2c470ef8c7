"""Which imperfections bring the published table of MVSEC's flights out of its twin.

`python tests/benchmarks fit_imperfection --page docs/studies.md` maps twins of other flights than
the suite's with poses that walk and focal lengths that are off, by a grid of amounts, and writes
how far each comes from the published ratios of H to one camera. The least wrong of them is the
preset `mvsec` of `eval.perturbations`; that it holds on flights that it was not chosen on is seen
in the suite's table, `reproduction`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eventsweep.eval.cli import job_flags
from eventsweep.eval.cli.console import Console
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.perturbations import PRESETS, Perturbation
from eventsweep.eval.suite.definition import Suite, load
from eventsweep.eval.suite.series import Key, Series, of_suite
from markdown_blocks import show
from published_table import MONO, RATIOS, H

MARK = "imperfection"
FLIGHTS = (3, 4, 5)
WALKS_DEG, WALKS_MM, FOCALS_PERCENT = (0.5, 0.7, 0.94, 1.3), (0.0, 9.0, 30.0), (0.0, 1.0, 4.0)


class Candidate(NamedTuple):
    """One set of amounts, and what came out.

    Attributes:
        amount: what the mapper is told wrongly.
        ratios: of H to one camera, by metric.
        mean_cm: mean error of H and of one camera, cm.
    """

    amount: Perturbation
    ratios: Mapping[str, float]
    mean_cm: tuple[float, float]

    @property
    def off(self) -> float:
        """Factor by which the worst of the ratios is off the published one."""
        logs = [np.log(self.ratios[m] / (H.value(m) / MONO.value(m))) for m in RATIOS]
        return float(np.exp(np.abs(logs).max()))


def main() -> int:
    """Maps, prints and writes the table; exit code 2 on bad input, 1 on failed jobs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="page to write the table into")
    parser.add_argument("--workers", type=int, help="worker processes")
    asked = parser.parse_args()
    with exit_code() as code:
        tried = [Perturbation(), *_grid()]
        progress = Console(quiet=False, as_json=False).progress
        flags = job_flags.JobFlags(workers=asked.workers)
        result = job_flags.run_with_flags(
            suite(tried), "all", flags, progress, seeds=FLIGHTS, cases=(), speed=False
        )
        text = table(candidates(tried, of_suite(result).series))
        show(text, asked.page, MARK)
        code.value = 1 if result.failures else 0
    return code.value


def _grid() -> list[Perturbation]:
    return [
        Perturbation(pose_walk_deg=deg, pose_walk_mm=mm, focal_percent=percent)
        for deg, mm, percent in product(WALKS_DEG, WALKS_MM, FOCALS_PERCENT)
    ]


def suite(tried: Sequence[Perturbation]) -> Suite:
    """The noisy case of the published table's suite, once per set of amounts."""
    known, _ = load("mvsec-table-v2")
    noisy = known.cases["noisy"].model_dump() | {"mappers": ["pair"], "windows": [_WINDOW]}
    cases = {
        f"c{k:03d}": noisy | {"imperfection": amount.model_dump(exclude_defaults=True)}
        for k, amount in enumerate(tried)
    }
    values = known.model_dump() | {"name": "imperfections", "cases": cases, "subsets": {}}
    return Suite.model_validate(values)


_WINDOW = {"start_s": 0.1, "duration_s": 1.0}


def candidates(tried: Sequence[Perturbation], found: Mapping[Key, Series]) -> list[Candidate]:
    """What came out of each, the least wrong first; the first that was tried is nothing wrong."""

    def mean(k: int, method: str, metric: str) -> float:
        return float(np.mean(list(found[Key(f"c{k:03d}", method, metric)].values.values())))

    each = []
    for k, amount in enumerate(tried):
        of_h, of_mono = ({m: mean(k, f"{one.ours} pair", m) for m in RATIOS} for one in (H, MONO))
        ratios = {m: of_h[m] / of_mono[m] for m in RATIOS}
        each.append(Candidate(amount, ratios, (of_h["mean_error"], of_mono["mean_error"])))
    return [each[0], *sorted(each[1:], key=lambda one: one.off)]


def table(found: Sequence[Candidate], rows: int = 8) -> str:
    """Markdown: nothing wrong, the least wrong sets of amounts, and the preset."""
    published = " | ".join(f"{H.value(m) / MONO.value(m):.2f}" for m in RATIOS)
    lines = [
        f"Means over {len(FLIGHTS)} flights that the suite does not have, one window of 1 s each; "
        f"the best {rows} of {len(found) - 1}.\n",
        f"| walk, deg/√s | walk, mm/√s | focal, % | {' | '.join(RATIOS.values())} "
        "| worst factor | H, cm | mono, cm |",
        "|--:|--:|--:|" + "--:|" * (len(RATIOS) + 3),
        f"| published | | | {published} | | {H.mean_cm:.1f} | {MONO.mean_cm:.1f} |",
    ]
    lines += [_line(one) for one in found[: rows + 1]]
    return "\n".join(lines) + "\n"


def _line(one: Candidate) -> str:
    amount, ratios = one.amount, " | ".join(f"{one.ratios[m]:.2f}" for m in RATIOS)
    mark = " (`mvsec`)" if amount == PRESETS["mvsec"] else ""
    cm = " | ".join(f"{100 * mean:.1f}" for mean in one.mean_cm)
    return (
        f"| {amount.pose_walk_deg:g}{mark} | {amount.pose_walk_mm:g} | {amount.focal_percent:g} "
        f"| {ratios} | {one.off:.2f} | {cm} |"
    )


if __name__ == "__main__":
    sys.exit(main())
