"""What makes a metric's numbers comparable: a hash of what it means."""

from __future__ import annotations

import hashlib

import numpy as np

from eventsweep.eval.jobs.code_version import source_digest
from eventsweep.eval.results.table import POOLED, each
from eventsweep.eval.scoring.method_scores import BAD_POINTS, CAUSE_PREFIX
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import Estimate, MethodPairs, Truth, pair_methods
from eventsweep.eval.scoring.regions import DRAWN
from eventsweep.eval.scoring.score import case_rows

CAUSE_MODULES = ("eventsweep.eval.scoring.outlier_causes", "eventsweep.eval.scoring.regions")
"""What decides why a pixel is bad: too much to be pinned down by a few fixed maps."""


def metric_versions() -> dict[str, str]:
    """What each metric makes of fixed maps, as a hash: it changes when the metric's meaning does.

    Made of results and not of source, so that code may be rewritten without any effect. Only the
    causes of bad pixels, which depend on a whole sequence, have the hash of their source.
    """
    values: dict[str, list[str]] = {}
    for row in each(case_rows("fixed", {"w000": _fixed_pairs(1), "w001": _fixed_pairs(2)})):
        if row.window == POOLED:
            text = f"{row.method} {row.value:.9g} {row.unit} {row.direction}"
            values.setdefault(row.metric, []).append(text)
    causes = (BAD_POINTS, *(CAUSE_PREFIX + cause for cause in CAUSES))
    return {
        **{name: _short_hash("\n".join(lines)) for name, lines in values.items()},
        **dict.fromkeys(causes, source_digest(CAUSE_MODULES)[:12]),
    }


def _fixed_pairs(salt: int) -> dict[str, MethodPairs]:
    """Maps of two methods with errors of all sizes; whole numbers, the same on every machine."""
    cell = np.arange(48 * 64).reshape(48, 64)
    truth_m = 1 + (cell * 37 * salt % 101) / 32
    regions = {name: cell % (3 + k) != 0 for k, name in enumerate(DRAWN)}
    truth = Truth(truth_m, cell % 11 != 0, 200.0, 0.125, regions=regions)
    confidence, rho = (cell * 7 % 61) / 64, 1 / np.linspace(0.5, 6.0, 50)
    estimates = {}
    for name, step in (("a", 13), ("b", 29)):
        depth_m = truth_m + ((cell * step % 257) - 128) / 256 * (cell % 7) / 8
        estimates[name] = Estimate(depth_m, (cell + salt) % step != 0, confidence, rho)
    return pair_methods(estimates, truth, reference="a")


def _short_hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
