"""The depth map of a method whose depth is found by focus."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.depthmap import DepthMap
from emvs.dsi.backend import InFocus
from emvs.dsi.maxima import Maximum
from emvs.errors import InputError
from emvs.focus_config import FocusConfig
from emvs.focus_judge import judge, on_surface
from emvs.found import Found, at_least
from emvs.planes import inverse_depth_at
from emvs.view import ReferenceView
from emvs.window import Window

_PATH_SAMPLES = 65


def extract_in_focus(
    method: str,
    votes: Maximum,
    found: InFocus,
    view: ReferenceView,
    config: MapperConfig,
    baseline_m: float,
) -> DepthMap:
    """Turns one method's focus into its depth map: no median, and reliability chooses the pixels.

    Args:
        method: name for the result.
        votes: first maximum of the fused volume; its values are the confidence.
        found: where the fused rays and each camera's are most in focus.
        view: the reference view.
        config: interpolation, reliability, border.
        baseline_m: what disparities refer to (`parallax_baseline_m`), m.
    """
    judged = _judged(votes, found, baseline_m * view.camera.fx_px * view.rho, config)
    return DepthMap(
        method=method,
        depth_m=np.reciprocal(inverse_depth_at(view.rho, judged.position)),
        confidence=votes.value,
        mask=at_least(judged, config.focus_reliability, config.border_px),
        argmax=found.maximum.plane,
        rho=view.rho,
        t_us=view.t_us,
        T_world_rv=view.T_world_rv,
        camera=view.camera,
    )


def _judged(
    votes: Maximum, found: InFocus, disparity_px: NDArray[np.floating], config: MapperConfig
) -> Found:
    """Depth and reliability; between planes only where the configuration refines at all."""
    maxima, scales = (found.maximum, *found.witnesses), _scales(config)
    disparity_px = disparity_px.astype(np.float64)
    if not config.refines:
        loudest, own, *witnesses = (m.plane.astype(np.float32) for m in (votes, *maxima))
        return judge(votes.value, loudest, own, witnesses, disparity_px, scales)
    own, *witnesses = (m.position(bell=True) for m in maxima)
    judged = judge(votes.value, votes.position(), own, witnesses, disparity_px, scales)
    return on_surface(judged, disparity_px, scales)


def _scales(config: MapperConfig) -> FocusConfig:
    """The parameters of the extraction, as far as the mapper's configuration sets them."""
    return FocusConfig(
        measure=config.focus_measure,
        sigma_px=config.focus_sigma_px,
        threshold_kernel_px=config.focus_threshold_kernel_px,
        threshold_c=config.focus_threshold_c,
    )


def parallax_baseline_m(recording: Recording, window: Window) -> float:
    """The distance that disparities refer to, m: between cameras 0 and 1, or along the path.

    One camera has no baseline but its own path: the farthest that it gets, in the window, from
    where it is at the reference time.

    Raises:
        InputError: one camera that stays where it is.
    """
    if len(recording.rig) > 1:
        return recording.rig.baseline_m(0, 1)
    first_us, last_us = recording.trajectory.span_us
    t_us = np.linspace(max(window.t0_us, first_us), min(window.t1_us, last_us), _PATH_SAMPLES)
    T_world_cam = recording.trajectory.at(t_us.astype(np.int64)) @ recording.rig.T_body_cam[0]
    T_world_rv = recording.trajectory.at(window.t_ref_us) @ recording.rig.T_body_cam[0]
    offsets_m = T_world_cam[:, :3, 3] - T_world_rv[:3, 3]
    farthest_m = float(np.linalg.norm(offsets_m, axis=1).max())
    if farthest_m == 0:
        raise InputError(
            "Focus methods: one camera that does not move sees no parallax; choose a window in "
            "which it moves, or EMVS/cam0"
        )
    return farthest_m
