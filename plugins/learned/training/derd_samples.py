"""What DERD-Net learns from: whole columns of votes, and where the depth lies in its range."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import DerdParameters, MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import confidence_mask, without_border
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.methods.derd import DERD
from eventsweep.plugins.learned.networks.derd import (
    PLANES,
    SIDE_PX,
    DepthRange,
    columns_of,
    selecting,
)
from eventsweep.plugins.learned.training.samples import (
    SampleSet,
    Swept,
    swept_window,
    window_config,
)
from eventsweep.plugins.learned.training.sequences import TrainingSequence, TrainingWindow, windows

Floats = NDArray[np.float32]
LEAST_C = MapperConfig().threshold_c
"""Pixels are those of Algorithm 1, so that the network knows those that it is compared on."""


@dataclass(frozen=True, eq=False)
class DerdSamples(SampleSet):
    """Columns of votes.

    Attributes:
        columns: (M, PLANES, S, S) uint8, shares of the largest value in 255ths, near to far.
        near_px: (M,) float32 disparity at the near end of the depth range, px.
        far_px: (M,) float32 disparity at its far end, px.
        votes_px: (M,) float32 disparity that has most votes, px: what Algorithm 1 reports.
    """

    columns: NDArray[np.uint8]
    near_px: Floats
    far_px: Floats
    votes_px: Floats

    @property
    def compared_error_px(self) -> Floats:
        """(M,) error of Algorithm 1, px of disparity."""
        return np.asarray(np.abs(self.votes_px - self.true_px), np.float32)

    def inputs(self) -> dict[str, NDArray[Any]]:
        """Columns, what is true, and the range that both refer to."""
        return {
            "columns": self.columns,
            "true_px": self.true_px,
            "near_px": self.near_px,
            "far_px": self.far_px,
        }


def derd_windows(sequence: TrainingSequence) -> tuple[TrainingWindow, ...]:
    """The windows of a sequence that the network can read: all of it and a part, nothing wrong."""
    exact = (one for one in windows(sequence) if not one.imperfection and one.fusion == "H")
    return tuple(replace(one, planes=PLANES) for one in exact)


def derd_samples(sequence: EventSequence, window: TrainingWindow, most: int) -> DerdSamples:
    """Draws at most so many pixels at random of a window whose true depth is known."""
    method = DERD.build("DERD/H")
    least = DerdParameters(threshold_c=LEAST_C)
    config = window_config(window).model_copy(update={"derd": least})
    swept = swept_window(sequence, config, method)
    true_px = _true_px(sequence, swept)
    votes = swept.result.maxima[method.name]
    chosen = without_border(confidence_mask(votes.value, selecting(config)), SIDE_PX // 2)
    known = np.flatnonzero(chosen & np.isfinite(true_px))
    picked = np.sort(np.random.default_rng([window.seed, 0xDE2D]).permutation(known)[:most])
    rows, columns = np.divmod(picked, true_px.shape[1])
    parts = columns_of(method.fusion, swept.kept, swept.view, rows, columns)
    shares = [_in_255ths(*part) for part in parts]
    span = DepthRange.of(swept.view.rho)
    per_rho_px = swept.disparity_px[0] / float(swept.view.rho[0])
    voted_px = np.interp(votes.position().flat[picked], np.arange(PLANES), swept.disparity_px)
    return DerdSamples(
        true_px=true_px.flat[picked],
        columns=np.concatenate([np.empty((0, PLANES, SIDE_PX, SIDE_PX), np.uint8), *shares]),
        near_px=np.full(len(picked), per_rho_px / span.near_m, np.float32),
        far_px=np.full(len(picked), per_rho_px / span.far_m, np.float32),
        votes_px=voted_px.astype(np.float32),
    )


def _true_px(sequence: EventSequence, swept: Swept) -> Floats:
    """(H, W) true disparity, px; NaN where it is not known."""
    truth = truth_of(sequence, swept.view.t_us, EvalConfig())
    per_rho_px = swept.disparity_px[0] / float(swept.view.rho[0])
    return np.where(truth.scored, per_rho_px / truth.depth_m, np.nan).astype(np.float32)


def _in_255ths(shares: Floats, count: int) -> NDArray[np.uint8]:
    """(B, D, S, S, L) shares of `count` pixels as (count, D, S, S) bytes."""
    pixels = np.moveaxis(shares, -1, 1).reshape(-1, *shares.shape[1:-1])[:count]
    return np.asarray(np.rint(pixels * np.float32(255)), np.uint8)
