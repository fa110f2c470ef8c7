"""Entries of a ranking, made of numbers instead of maps."""

import numpy as np

from eventsweep.eval.results.results import ArchiveFacts, MeasuredCost
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.plugins.ranking.entries import METRICS, RankedCase, RankingEntry

CASES = {"wall": (), "dark": ("light",), "crowd": ("motion", "occlusion")}


def entry(
    label,
    errors,
    seeds=5,
    *,
    spread=0.05,
    archive="",
    part="public",
    drawn="",
    source="",
    **changed,
):
    """An entry in which methods have these errors, in m, with seeds around them."""
    cases = {
        case: RankedCase(
            scene=case,
            conditions=conditions,
            sequences=tuple(f"{drawn or part}{case}{k}" for k in range(seeds)),
            rendered_from=tuple(f"{source}{case}{k}" for k in range(seeds)) if source else (),
        )
        for case, conditions in CASES.items()
    }
    values = {method: of_method(method, error, seeds, spread) for method, error in errors.items()}
    facts = {
        "suite": "tiny", "digest": "d",
        "archive": ArchiveFacts(archive, "tiny", part, "ab" * 32) if archive else None,
        "seeds": tuple(range(seeds)), "cases": cases,
        "units": {name: unit_of(name) for name in METRICS},
        "versions_of_metrics": {"mean_error": "v1"}, "values": values,
        "cost": {m: MeasuredCost("wall", 0.1 * (k + 1), 200.0) for k, m in enumerate(errors)},
        "versions": {"eventsweep": "0.1.0"}, "platform": "a machine",
    }  # fmt: skip
    return RankingEntry(label=label, **{**facts, **changed})


def unit_of(metric):
    known = ALL_METRICS.get(metric)
    return (known.unit, known.direction) if known else ("m", "lower")


def of_method(method, error, seeds, spread):
    """Every metric of a method follows from its error; seeds and scenes are the same for all."""
    rng = np.random.default_rng(sum(map(ord, method)))
    found = {}
    for name in METRICS:
        higher = unit_of(name)[1] == "higher"
        found[name] = {}
        for k, case in enumerate(CASES):
            scale = (1 + k) * (1 + spread * rng.standard_normal(seeds))
            number = np.abs(error * scale)
            if name == "points":
                number = np.full(seeds, 1000.0)
            elif name == "outlier_points":
                number = np.full(seeds, 100.0)
            elif name.startswith("cause_"):
                number = np.full(seeds, 100 / 8)
            elif higher:
                number = 10 / number
            found[name][case] = tuple(np.round(number, 6).tolist())
    return found
