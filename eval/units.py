"""One value per method and independent unit, from the results of several runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from eval.metrics import Better
from eval.paired import Ranking, rank_methods
from eval.results import Results, Row
from eval.score import MEAN

Unit = tuple[str, int | None]


def unit_values(
    runs: Iterable[Results], metric: str, window: str = MEAN
) -> tuple[tuple[Unit, ...], dict[str, NDArray[np.float64]], Better]:
    """Collects a metric over cases and seeds.

    Args:
        runs: results, of one seed each.
        metric: name of the metric.
        window: `mean` for the plain average over windows, `all` for pixels pooled.

    Returns:
        The units, case and seed; per method one value per unit, NaN where it has none; and which
        direction is better.

    Raises:
        InputError: no such rows, or a unit that two runs hold.
    """
    found: dict[str, dict[Unit, Row]] = {}
    for run in runs:
        for row in run.rows:
            if (row.metric, row.window) == (metric, window):
                _add(found.setdefault(row.method, {}), (row.case, run.seed), row)
    units = tuple(dict.fromkeys(unit for rows in found.values() for unit in rows))
    if not units:
        raise InputError(f"no rows of metric {metric} in window {window}: score the runs again")
    values = {
        method: np.array([rows[unit].value if unit in rows else np.nan for unit in units])
        for method, rows in found.items()
    }
    return units, values, next(iter(next(iter(found.values())).values())).better


def rank_runs(runs: Sequence[Results], metric: str, window: str = MEAN) -> Ranking:
    """Ranks the methods of several runs, with ties where the difference is not significant.

    Raises:
        InputError: as `unit_values`, or a metric without a better direction.
    """
    _, values, better = unit_values(runs, metric, window)
    return rank_methods(values, better)


def _add(rows: dict[Unit, Row], unit: Unit, row: Row) -> None:
    if unit in rows:
        case, seed = unit
        raise InputError(f"case {case} with seed {seed} is in two runs: give each once")
    rows[unit] = row
