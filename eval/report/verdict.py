"""The first sentence of a page: who is best, as far as the seeds tell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pandas as pd

from eventsweep.eval.numbers import display_unit, displayed
from eventsweep.eval.report.ranking import column
from eventsweep.eval.scoring.standings import Standing, lead_words


def lead(ranks: Sequence[Standing], rows: pd.DataFrame, metric: str, seeds: int = 1) -> str:
    """A page's verdict: who is first; with one seed, which ranks nobody, by how much."""
    if seeds > 1:
        return lead_words(ranks, seeds)
    title, unit = column(metric).title, rows.loc[rows["metric"] == metric, "unit"].iloc[0]
    first = [one for one in ranks if one.place == ranks[0].place]
    values = [f"{displayed(r.values[0], unit)} {display_unit(unit)}".rstrip() for r in ranks]
    names, are = ", ".join(one.method for one in first), "are" if len(first) > 1 else "is"
    if len(ranks[0].values) > 1:
        verdict = f"{names} {are} placed first by {title} over {len(ranks[0].values)} cases."
    elif math.isnan(ranks[0].values[0]):
        return f"No method has a {title}: none has a depth that could be scored."
    elif len(ranks) == 1:
        return f"{names}: {title} {values[0]}, from one seed."
    else:
        behind = [f", then {r.method} with {v}" for r, v in zip(ranks, values, strict=True)]
        verdict = f"{names} {are} best: {title} {values[0]}{''.join(behind[len(first) :][:1])}."
    return f"{verdict} One seed does not show whether that holds for others."
