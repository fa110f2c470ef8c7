"""Every metric of one method's pairs, by region, and why its bad pixels are bad."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from eventsweep.emvs.errors import ByName
from eventsweep.eval.results.direction import Direction
from eventsweep.eval.scoring.curves import COVERAGE_METRICS, CURVE_METRICS
from eventsweep.eval.scoring.metrics import CELL_METRICS, METRICS, Metric, Pairs
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import ALL, COMMON, EQUAL, HARMONIC, SHARED, MethodPairs

CAUSE_PREFIX = "cause_"
BAD_POINTS = "outlier_points"
COMMON_NAMES = ("points", "mean_error", "median_error", "bad_published")
SHARED_NAMES = ("points", "mean_error", "bad_published")
REGION_NAMES = (
    "points", "completeness", "mean_error", "median_error", "abs_rel", "bad_published",
    "outlier_share", "f1_5cm",
)  # fmt: skip
# The pixels of both are the same ones: their number once is enough.
_NAMES = {
    COMMON: COMMON_NAMES, EQUAL: COMMON_NAMES, SHARED: SHARED_NAMES, HARMONIC: SHARED_NAMES[1:],
}  # fmt: skip
ALL_METRICS: dict[str, Metric] = ByName(
    "metric",
    {one.name: one for one in (*METRICS, *CELL_METRICS, *CURVE_METRICS, *COVERAGE_METRICS)},
)


class Score(NamedTuple):
    """One number about one depth map: the columns of a table of scores that it fills."""

    metric: str
    value: float
    unit: str
    direction: Direction
    region: str = ALL
    support: int | None = None


def score_pairs(pairs: Pairs) -> list[Score]:
    """Every metric of one set of pairs, and the two numbers that put them into proportion."""
    context = context_scores(pairs.truth_count, pairs.baseline_focal_px_m)
    return [*context, *(_score(name, pairs, ALL) for name in ALL_METRICS)]


def score_method(pairs: MethodPairs) -> list[Score]:
    """Every metric on the method's own pixels, and a few on those of each region."""
    scores = score_pairs(pairs.own)
    for region, found in pairs.by_region.items():
        if region != ALL:
            scores += [_score(name, found, region) for name in metrics_of(region)]
    return [*scores, *cause_scores(pairs.causes)]


def metrics_of(region: str) -> tuple[str, ...]:
    """Names of the metrics that are asked for in a region."""
    if region == ALL:
        return tuple(ALL_METRICS)
    return _NAMES.get(region, REGION_NAMES)


def full_name(metric: str, region: str) -> str:
    """What a row calls a metric of a region."""
    return metric if region == ALL else f"{region}_{metric}"


def context_scores(truth_points: int, baseline_focal_px_m: float) -> tuple[Score, Score]:
    """The two numbers that put all others into proportion."""
    return (
        Score("truth_points", float(truth_points), "px", "none"),
        Score("baseline_focal", baseline_focal_px_m, "px·m", "none"),
    )


def cause_scores(causes: Mapping[str, int] | None) -> Iterator[Score]:
    """Number of bad pixels and the share of every cause, NaN of one that was not measured.

    Nothing where causes are not known.
    """
    if causes is None:
        return
    bad = sum(causes.values())
    yield Score(BAD_POINTS, float(bad), "px", "none", ALL, bad)
    for cause in CAUSES:
        share = 100 * causes[cause] / bad if bad and cause in causes else float("nan")
        yield Score(CAUSE_PREFIX + cause, share, "%", "none", ALL, bad)


def _score(name: str, pairs: Pairs, region: str) -> Score:
    metric = ALL_METRICS[name]
    value, score_name = metric(pairs), full_name(name, region)
    return Score(score_name, value, metric.unit, metric.direction, region, pairs.count)
