"""Calibration of reliability: tables of what each method's score was worth on known depth."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.precision import (
    BAND,
    WITHIN_PX,
    Precision,
    scatter_scale,
    step_of_planes_px,
    table_name,
)
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.pairing import Truth
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.training.sequences import TrainingSequence, windows

_BINS = 48
_FEWEST = 20  # points of a bin, at least
_FEW_PLANES = 40  # coarser than the usual 100: recordings of a large range have such
_SHARE = 0.005  # of all points in a bin, at least


@dataclass(frozen=True, eq=False)
class Scored:
    """Points of one method, or of several alike, whose true depth is known.

    Attributes:
        score: (M,) the method's reliability, above 0.
        error_px: (M,) error, px of disparity.
        most_step_px: largest distance of two planes in the windows they are of, px of disparity.
        scatter_px: (M,) scatter around their surfaces, px of disparity, of methods that fit some.
    """

    score: NDArray[np.float64]
    error_px: NDArray[np.float64]
    most_step_px: float
    scatter_px: NDArray[np.float64] | None = None

    def __getitem__(self, kept: NDArray[np.bool_]) -> Scored:
        scatter = None if self.scatter_px is None else self.scatter_px[kept]
        return Scored(self.score[kept], self.error_px[kept], self.most_step_px, scatter)


def collect(
    folder: Path, specs: Iterable[TrainingSequence], methods: Sequence[str],
    weights: Path | None = None,
) -> dict[str, Scored]:  # fmt: skip
    """Maps the windows of some sequences without errors, and collects their points by table.

    All of a sequence is mapped again with fewer planes.
    Learned methods use the weights that ship, unless others are given.
    """
    points: dict[str, list[Scored]] = defaultdict(list)
    for spec in specs:
        sequence = EventSequence.open(folder / spec.name)
        exact = [window for window in windows(spec) if not window.imperfection]
        for window in (*exact, replace(exact[0], planes=_FEW_PLANES)):
            config = MapperConfig(
                start_s=window.start_s, duration_s=window.duration_s, planes=window.planes,
                methods=tuple(methods), learned={"weights": weights},
            )  # fmt: skip
            result = map_window(sequence, config)
            truth = truth_of(sequence, result.view.t_us, EvalConfig())
            for name, depth_map in result.depth_maps.items():
                points[table_name(name)].append(points_of(depth_map, truth))
    return {name: joined(parts) for name, parts in points.items()}


def joined(parts: Sequence[Scored]) -> Scored:
    """Points of several windows together."""
    scatter = [part.scatter_px for part in parts if part.scatter_px is not None]
    return Scored(
        np.concatenate([part.score for part in parts]),
        np.concatenate([part.error_px for part in parts]),
        max(part.most_step_px for part in parts),
        np.concatenate(scatter) if len(scatter) == len(parts) else None,
    )


def points_of(depth_map: DepthMap, truth: Truth) -> Scored:
    """A depth map's candidates whose true depth is known."""
    if depth_map.reliability is None:
        raise InputError(f"{depth_map.method} has no reliability to calibrate")
    known = truth.scored & (depth_map.reliability > 0)
    rho, true_rho = 1 / depth_map.depth_m[known].astype(np.float64), 1 / truth.depth_m[known]
    error_px = truth.baseline_focal_px_m * np.abs(rho - true_rho)
    step_px = step_of_planes_px(depth_map, truth.baseline_focal_px_m)
    scatter = None if depth_map.scatter_px is None else depth_map.scatter_px[known]
    score = depth_map.reliability[known].astype(np.float64)
    return Scored(score, error_px, step_px, None if scatter is None else scatter.astype(np.float64))


def fit(points: Scored) -> Precision:
    """The table of a score whose points have known errors; a larger score is better.

    Scores are cut into bins, the finer the higher they are. The errors' quantile falls from bin to
    bin, as isotonic regression has it, and the precision of what is above never falls. Where
    surfaces were fitted, errors are taken as multiples of the scatter around them.
    """
    score, error_px, scatter_px = points.score, points.error_px, points.scatter_px
    if len(score) < 2 * _FEWEST:
        raise InputError(f"{len(score)} points: calibration needs {2 * _FEWEST} or more")
    order = np.argsort(score, kind="stable")
    edges = _edges(len(order))
    bins = list(pairwise([*edges, len(order)]))
    parts = [order[a:b] for a, b in bins]
    relative = error_px if scatter_px is None else error_px / scatter_scale(scatter_px)
    band = np.array([float(np.quantile(relative[part], BAND)) for part in parts])
    falling = np.asarray(isotonic_regression(band, increasing=False).x)
    right = error_px[order] <= WITHIN_PX
    above = np.cumsum(right[::-1])[::-1] / np.arange(len(order), 0, -1)
    middle = [a + (b - a) // 2 for a, b in bins]
    rising = np.maximum.accumulate(above[middle])
    knots, kept = np.unique(score[order][middle].astype(np.float64), return_index=True)
    by_scatter = scatter_px is not None
    return Precision(knots, falling[kept], rising[kept], points.most_step_px, by_scatter)


def _edges(points: int) -> list[int]:
    """Where bins of rising scores begin: they get smaller, as long as enough points are in each."""
    edges, fewest = [0], max(_FEWEST, round(_SHARE * points))
    for k in range(1, _BINS):
        edge = round(points * (1 - (1 - k / _BINS) ** 2))
        if min(edge - edges[-1], points - edge) >= fewest:
            edges.append(edge)
    return edges
