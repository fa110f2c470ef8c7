"""From depth maps and ground truth to rows: per window, pooled over pixels, and averaged."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import repeat
from operator import add
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.maps.folder import StoredWindow, WindowInfo
from eventsweep.emvs.windows import Window
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.found_poses import is_on_own_poses
from eventsweep.eval.results.table import MEAN, POOLED, RIG, tidy
from eventsweep.eval.scoring.method_scores import Score, score_method, score_pairs
from eventsweep.eval.scoring.outlier_causes import OutlierClassifier, count_events
from eventsweep.eval.scoring.pairing import (
    DepthImage,
    Estimate,
    MaskImage,
    MethodPairs,
    Truth,
    bad_pixels,
    pair,
    pair_methods,
)
from eventsweep.eval.scoring.pooling import CasePool, NumberStore
from eventsweep.eval.scoring.predictions import UNIT_FACTOR
from eventsweep.eval.scoring.regions import region_masks
from eventsweep.eval.scoring.run_folder import Scored, truth_of

if TYPE_CHECKING:
    import pandas as pd

Windows = Mapping[str, Mapping[str, MethodPairs]] | Iterable[tuple[str, Mapping[str, MethodPairs]]]
BASELINE, TRAVEL = "baseline", "lateral_travel"
_POSES = 33
NO_PREDICTIONS: Mapping[str, Estimate] = MappingProxyType({})


def score_depth(
    depth_m: DepthImage,
    mask: MaskImage,
    truth_depth_m: DepthImage,
    truth_valid: MaskImage,
    focal_px: float,
    baseline_m: float | None,
    limits_m: tuple[float, float] = (0.0, float("inf")),
) -> list[Score]:
    """Scores one depth map by every metric.

    Args:
        depth_m: (H, W) estimated z-depth, m.
        mask: (H, W) where the method reports a depth.
        truth_depth_m: (H, W) true z-depth, m.
        truth_valid: (H, W) where the truth is known.
        focal_px: focal length of the view, px.
        baseline_m: distance between the two cameras, m; None leaves disparity metrics NaN.
        limits_m: closed range of true depths that are scored, m.

    Raises:
        InputError: images of different shape, a reported depth that is not finite and positive,
            or a focal length or baseline that is not.
    """
    truth = Truth(truth_depth_m, truth_valid, focal_px, baseline_m, limits_m)
    return score_pairs(pair(depth_m, mask, truth))


def case_rows(case: str, windows: Windows) -> pd.DataFrame:
    """The rows of one case: each window, then window `all`, then window `mean`.

    Windows are names and each method's pairs there; from a generator memory holds the pixels of
    one.
    """
    rows: list[dict[str, Any]] = []
    with NumberStore() as store:
        pool = CasePool(store)
        for name, methods in windows.items() if isinstance(windows, Mapping) else windows:
            scores = {method: score_method(pairs) for method, pairs in methods.items()}
            pool.add(methods, scores)
            rows += _rows(case, name, scores)
        pooled = _rows(case, POOLED, pool.scores())
    return tidy([*rows, *pooled, *mean_rows(rows)])


def _rows(
    case: str, window: str, methods: Mapping[str, Iterable[Score]]
) -> Iterator[dict[str, Any]]:
    for method, scores in methods.items():
        for score in scores:
            yield {"case": case, "window": window, "method": method, **score._asdict()}


def mean_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Averages windows of one case, one after another, every window weighing the same.

    A number that a window lacks or leaves undefined is undefined here: an average over fewer
    windows would not be comparable between methods. The windows of a case are of one seed, which
    has no interval: how much they differ does not say how much another seed would.
    """
    windows = len({row["window"] for row in rows})
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["method"], row["metric"]].append(row)
    return [_mean(group, windows) for group in groups.values()]


def _mean(rows: Sequence[Mapping[str, Any]], windows: int) -> dict[str, Any]:
    whole, counts = len(rows) == windows, [row["support"] for row in rows]
    # One after another: `sum` of floats differs between versions of Python.
    value = reduce(add, (row["value"] for row in rows)) / windows if whole else math.nan
    support = sum(counts) if whole and None not in counts else None
    return {**rows[0], "window": MEAN, "value": value, "support": support}


def score_windows(
    case: str, sequence: Scored, windows: Iterable[StoredWindow], config: EvalConfig,
    predictions: Iterable[Mapping[str, Estimate]] | None = None, reference: str | None = None,
) -> pd.DataFrame:  # fmt: skip
    """Scores windows of one case: each, all of them pooled, and their mean.

    One window after another is read, so that memory holds the pixels of one. `predictions` are for
    each window, by name, depth maps of other methods; see `window_pairs`.
    """
    of_windows = repeat(NO_PREDICTIONS) if predictions is None else predictions
    pairs = (
        (window.info.name, window_pairs(sequence, window, config, predicted, reference))
        for window, predicted in zip(windows, of_windows, strict=False)
    )
    return case_rows(case, pairs)


def window_pairs(
    sequence: Scored, window: StoredWindow, config: EvalConfig,
    predictions: Mapping[str, Estimate] = NO_PREDICTIONS, reference: str | None = None,
) -> dict[str, MethodPairs]:  # fmt: skip
    """Pairs all maps of a window with the truth, and says why bad pixels are bad.

    A data set's truth is sparse and comes without intensity: it has no regions and no causes.
    `predictions` are, by name, depth maps of other methods for the same view; all methods are
    compared with `reference` on the pixels that both report, and with each other on those that all
    report, but for maps on poses that were found: where those fail, nothing would be left.
    """
    info = window.info
    stretch = Window(info.t0_us, info.t1_us, info.t_ref_us, ())
    maps = {method: window.depth_map(method) for method in info.methods}
    return pairs_of_maps(sequence, stretch, maps, config, predictions, reference)


def pairs_of_maps(
    sequence: Scored, window: Window, maps: Mapping[str, DepthMap], config: EvalConfig,
    predictions: Mapping[str, Estimate] = NO_PREDICTIONS, reference: str | None = None,
) -> dict[str, MethodPairs]:  # fmt: skip
    """The same of depth maps in memory; `window` is the stretch of time that they were made of."""
    t_us = window.t_ref_us
    truth = truth_of(sequence, t_us, config)
    if not isinstance(sequence, EventSequence):
        _check_unit(sequence.name, truth, next(iter(maps.values())).rho)
    if isinstance(sequence, EventSequence):
        truth = replace(truth, regions=region_masks(sequence, t_us, truth.depth_m, config))
    estimates = {**map_estimates(maps), **predictions}
    compared = [name for name in estimates if not is_on_own_poses(name)]
    pairs = pair_methods(estimates, truth, compared=compared, reference=reference)
    if not isinstance(sequence, EventSequence):
        return pairs
    classifier = outlier_classifier(sequence, window, next(iter(maps.values())), truth, config)
    return {
        method: replace(
            compared,
            causes=classifier.count(
                estimates[method].depth_m, bad_pixels(estimates[method], truth)
            ),
        )
        for method, compared in pairs.items()
    }


def map_estimates(maps: Mapping[str, DepthMap]) -> dict[str, Estimate]:
    """What depth maps say of their view."""
    return {name: Estimate(m.depth_m, m.mask, m.confidence, m.rho) for name, m in maps.items()}


def _check_unit(name: str, truth: Truth, rho: NDArray[np.floating]) -> None:
    """Refuses truth of a data set that lies nowhere near the planes of its map."""
    known_m = truth.depth_m[truth.valid]
    near_m, far_m = 1 / float(rho.max()), 1 / float(rho.min())
    median_m = float(np.median(known_m)) if known_m.size else near_m
    if not near_m / UNIT_FACTOR <= median_m <= far_m * UNIT_FACTOR:
        raise InputError(
            f"{name}: its median true depth would be {median_m:.3g} m, but its map's planes lie "
            f"at {near_m:.3g} to {far_m:.3g} m: set unit_m in [truth] (0.001 for millimetres), "
            "or map the depth range of the scene"
        )


def outlier_classifier(
    sequence: EventSequence, window: Window | WindowInfo, depth_map: DepthMap, truth: Truth,
    config: EvalConfig,
) -> OutlierClassifier:  # fmt: skip
    """What finds the causes of bad pixels in a window; `truth` has its regions."""
    counts = (
        count_events(sequence, camera, window.t0_us, window.t1_us)
        for camera in range(len(sequence.rig))
    )
    return OutlierClassifier(
        sequence=sequence,
        t_us=window.t_ref_us,
        counts=tuple(counts),
        truth_m=truth.depth_m,
        range_m=(1 / float(depth_map.rho.max()), 1 / float(depth_map.rho.min())),
        masks=truth.regions,
        contrast=config.edge_contrast,
    )


def rig_rows(
    case: str, recording: Scored, windows: Sequence[Window] | Sequence[WindowInfo]
) -> pd.DataFrame:
    """What parallax there is: the baseline, and camera 0's mean travel in a window."""
    rig = recording.rig
    travels = [_lateral_travel_m(recording, window) for window in windows]
    travel_m = sum(travels) / len(travels) if travels else math.nan
    numbers = {TRAVEL: travel_m, **({BASELINE: rig.baseline_m()} if len(rig) > 1 else {})}
    about = {"case": case, "window": POOLED, "method": RIG, "unit": "m", "direction": "none"}
    return tidy({**about, "metric": name, "value": value} for name, value in numbers.items())


def _lateral_travel_m(recording: Scored, window: Window | WindowInfo) -> float:
    """The largest distance between two places of camera 0, across its viewing direction."""
    times_us = np.linspace(window.t0_us, window.t1_us, _POSES).astype(np.int64)
    within_us = np.clip(np.append(times_us, window.t_ref_us), *recording.trajectory.span_us)
    T_world_cam = recording.trajectory.at(within_us) @ recording.rig.T_body_cam[0]
    sideways_m = (se3.inverse(T_world_cam[-1]) @ T_world_cam[:-1])[:, :2, 3]
    return float(np.linalg.norm(sideways_m[:, None] - sideways_m, axis=-1).max())
