"""Ray-density volumes kept whole, which the mapper never does, and focus in them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import FocusParameters
from eventsweep.emvs.depth.focus import (
    FocusEstimate,
    between_the_ends,
    candidate_mask,
    judge_at,
    on_surface,
)
from eventsweep.emvs.dsi.fusion import MEANS, Fusion, fuse
from eventsweep.emvs.dsi.maxima import FocusPeak, Maximum
from eventsweep.emvs.dsi.rays import knots, rays_between
from eventsweep.emvs.dsi.voting import Scratch

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]
FUSIONS = {name: partial(fuse, Fusion(mean.code)) for name, mean in MEANS.items()}
"""Every compiled mean as a function of (C, N, H, W) votes."""


def event_rays(events, camera, T_body_cam, trajectory, T_world_rv, rv_camera, *, packets=False):
    """Rays of events in the reference view, each by its own pose on the trajectory."""
    poses = knots(trajectory, T_world_rv)
    return rays_between(events, camera, T_body_cam, poses, rv_camera, packets=packets)


def dsi(rays, rho, width_px, height_px, *, nearest=False):
    """(N, H, W) float32 votes of one camera's rays in (N,) planes `rho`, and what was counted."""
    scratch = Scratch(1, len(rho), width_px, height_px, nearest=nearest)
    counts = scratch.cast(0, rays, rho)
    return scratch.images(len(rho))[0].copy(), counts


def judge(
    confidence: Floats,
    vote_peak: Floats,
    position: Floats,
    camera_positions: Sequence[Floats],
    disparity_px: NDArray[np.floating],
    allowed: Mask | None = None,
) -> FocusEstimate:
    """`emvs.depth.focus.judge_at` at every pixel; everything is an image.

    `allowed` is where a candidate may be, by default everywhere.
    """
    everywhere = tuple(np.indices(confidence.shape).reshape(2, -1))
    candidate = candidate_mask(confidence, FocusParameters())
    cameras = [position.ravel() for position in camera_positions]
    candidate = candidate if allowed is None else candidate & allowed
    return judge_at(
        everywhere, candidate, confidence, vote_peak.ravel(), position, cameras, disparity_px
    )


def maximum_of(volume: Floats) -> Maximum:
    """The first maximum of a whole (N, H, W) volume along its first axis."""
    planes = len(volume)
    index = volume.argmax(0)

    def at(plane: NDArray[np.int64]) -> Floats:
        inside = np.clip(plane, 0, planes - 1)[None]
        value: Floats = np.take_along_axis(volume, inside, 0)[0]
        return value

    return Maximum(at(index), index.astype(np.int16), at(index - 1), at(index + 1), planes)


def found_in_volumes(
    fused: Floats, votes: Floats, disparity_px: NDArray[np.floating], measure: str = "variance"
) -> FocusEstimate:
    """What the mapper's `Focus/...` finds, by any measure, in volumes that are kept whole.

    Args:
        fused: (N, H, W) float32, the cameras' votes fused by any function.
        votes: (C, N, H, W) float32 votes of each camera.
        disparity_px: (N,) disparity of each plane, px, above 0.
        measure: by its name in `emvs.dsi.focus_measures.MEASURES`.
    """
    vote_peak = maximum_of(fused)
    own, *cameras = (_sharpest(volume, measure) for volume in (fused, *votes))
    judged = judge(
        vote_peak.value, vote_peak.position(), own.position(gaussian=True),
        [camera.position(gaussian=True) for camera in cameras], disparity_px,
        between_the_ends(own),
    )  # fmt: skip
    return on_surface(judged, disparity_px)


def _sharpest(volume: Floats, measure: str) -> Maximum:
    """Where a whole (N, H, W) volume is most in focus."""
    peak = FocusPeak(volume.shape[2], volume.shape[1], measure, FocusParameters().sigma_px)
    peak.update(volume)
    return peak.maximum()
