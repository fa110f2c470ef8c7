"""Errors in depth cells: how many steps of the sweep's planes lie between estimate and truth."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from eval.metrics import FloatArray, Metric, Pairs

CELL_THRESHOLDS: tuple[int, ...] = (1, 2, 5)


def cell_error(
    estimate_m: FloatArray, truth_m: FloatArray, rho: NDArray[np.floating]
) -> FloatArray:
    """Counts the planes between estimate and truth, in whole and parts of a cell.

    Between two planes, position is linear in inverse depth; beyond the outermost ones it goes on
    with the step of the outermost cell.

    Args:
        estimate_m: (N,) estimated depth, m.
        truth_m: (N,) true depth, m.
        rho: (P,) inverse depths of the planes in either order, 1/m; 2 or more.

    Returns:
        (N,) error, depth cells.
    """
    planes = np.sort(rho.astype(np.float64))
    return np.abs(_position(1 / estimate_m, planes) - _position(1 / truth_m, planes))


def _position(rho: FloatArray, planes: FloatArray) -> FloatArray:
    cell = np.clip(np.searchsorted(planes, rho, side="right") - 1, 0, len(planes) - 2)
    position: FloatArray = cell + (rho - planes[cell]) / (planes[cell + 1] - planes[cell])
    return position


def _mean(pairs: Pairs) -> float:
    return float("nan") if pairs.cells is None else float(np.mean(pairs.cells))


def _median(pairs: Pairs) -> float:
    return float("nan") if pairs.cells is None else float(np.median(pairs.cells))


def _beyond(pairs: Pairs, cells: int) -> float:
    return float("nan") if pairs.cells is None else 100 * float(np.mean(pairs.cells > cells))


def _bad_metric(cells: int) -> Metric:
    name, title = f"bad_{cells}cell", f"bad {cells} cells"
    formula = f"share with more than {cells} depth cells between e and g"
    return Metric(name, title, "%", "lower", formula, partial(_beyond, cells=cells))


CELL_METRICS: tuple[Metric, ...] = (
    Metric("mean_cells", "mean cells", "cells", "lower", "mean depth cells between", _mean),
    Metric(
        "median_cells",
        "median cells",
        "cells",
        "lower",
        "median depth cells between",
        _median,
        pooling="order",
    ),
    *(_bad_metric(cells) for cells in CELL_THRESHOLDS),
)
