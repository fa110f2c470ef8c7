"""Windows of a map beside ground truth: pairs of every method, by region, with causes; rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import repeat
from types import MappingProxyType

from emvs.data.sequence import Sequence as EventSequence
from emvs.depth.depth_map import DepthMap
from emvs.maps.folder import StoredWindow
from emvs.windows import Window
from eval.config import EvalConfig
from eval.evidence import Evidence
from eval.folders import Scored, truth_of
from eval.masks import region_masks
from eval.pairing import Estimate, MethodPairs, Truth, bad_pixels, pair_methods
from eval.results import Row
from eval.score import case_rows
from eval.seen import count_events

NOTHING_GIVEN: Mapping[str, Estimate] = MappingProxyType({})


def score_windows(
    case: str,
    sequence: Scored,
    windows: Iterable[StoredWindow],
    config: EvalConfig,
    given: Iterable[Mapping[str, Estimate]] | None = None,
) -> list[Row]:
    """Scores windows of one case: each, all of them pooled, and their mean.

    One window after another is read, so that memory holds the pixels of one.

    Args:
        case: name of the case.
        sequence: the recording, with ground truth.
        windows: its maps.
        config: masks and limits.
        given: for each window, by name, depth maps of others; None for none.

    Raises:
        InputError: what `window_pairs` and `case_rows` refuse.
    """
    others = repeat(NOTHING_GIVEN) if given is None else given
    found = (
        (window.info.name, window_pairs(sequence, window, config, theirs))
        for window, theirs in zip(windows, others, strict=False)
    )
    return case_rows(case, found)


def window_pairs(
    sequence: Scored,
    window: StoredWindow,
    config: EvalConfig,
    predictions: Mapping[str, Estimate] = NOTHING_GIVEN,
) -> dict[str, MethodPairs]:
    """Pairs all maps of a window with the truth, and says why bad pixels are bad.

    A data set's truth is sparse and comes without intensity: it has no regions and no causes.

    Args:
        sequence: the recording, with ground truth.
        window: its maps.
        config: masks and limits.
        predictions: by name, depth maps of other methods for the same view.

    Raises:
        InputError: no ground truth at the window's reference time, or damaged files.
    """
    info = window.info
    stretch = Window(info.t0_us, info.t1_us, info.t_ref_us, ())
    maps = {method: window.depth_map(method) for method in info.methods}
    return pairs_of_maps(sequence, stretch, maps, config, predictions)


def pairs_of_maps(
    sequence: Scored,
    window: Window,
    maps: Mapping[str, DepthMap],
    config: EvalConfig,
    predictions: Mapping[str, Estimate] = NOTHING_GIVEN,
) -> dict[str, MethodPairs]:
    """The same of depth maps in memory; `window` is the stretch of time that they were made of."""
    t_us = window.t_ref_us
    truth = truth_of(sequence, t_us, config)
    if isinstance(sequence, EventSequence):
        truth = replace(truth, regions=region_masks(sequence, t_us, truth.depth_m, config))
    estimates = {
        method: Estimate(depth_map.depth_m, depth_map.mask, depth_map.confidence, depth_map.rho)
        for method, depth_map in maps.items()
    }
    estimates |= predictions
    pairs = pair_methods(estimates, truth)
    if not isinstance(sequence, EventSequence):
        return pairs
    evidence = _evidence(sequence, window, next(iter(maps.values())), truth, config)
    return {
        method: replace(
            compared,
            causes=evidence.causes(estimates[method].depth_m, bad_pixels(estimates[method], truth)),
        )
        for method, compared in pairs.items()
    }


def _evidence(
    sequence: EventSequence, window: Window, depth_map: DepthMap, truth: Truth, config: EvalConfig
) -> Evidence:
    counts = (
        count_events(sequence, camera, window.t0_us, window.t1_us)
        for camera in range(len(sequence.rig))
    )
    return Evidence(
        sequence=sequence,
        t_us=window.t_ref_us,
        counts=tuple(counts),
        truth_m=truth.depth_m,
        range_m=(1 / float(depth_map.rho.max()), 1 / float(depth_map.rho.min())),
        masks=truth.regions,
        contrast=config.edge_contrast,
    )
