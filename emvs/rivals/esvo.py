"""ESVO's mapping, with given poses: events matched on time surfaces, refined, and fused.

Zhou, Gallego, Shen, *Event-based Stereo Visual Odometry*, TRO 2021, section IV, from its
description; what that leaves open is as in the authors' program (docs/baselines_esvo.md). Each map
takes the newest events (`esvo_look`); maps are carried into the reference view and fused there,
the newest first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.depth.depth_map import DepthMap
from emvs.errors import InputError
from emvs.geometry import se3
from emvs.rivals.esvo_look import Looked, Looker
from emvs.rivals.esvo_parameters import EsvoParameters
from emvs.rivals.esvo_regularise import regularised
from emvs.rivals.esvo_student_t import Estimates, fuse_into, propagate
from emvs.rivals.sgm import instants_us
from emvs.rivals.to_view import depth_map
from emvs.view import ReferenceView
from emvs.window import Window

Floats = NDArray[np.float64]


def estimate(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: EsvoParameters | None = None,
) -> DepthMap:  # fmt: skip
    """Fuses the newest maps up to the reference time (`ESVO/own-rate`).

    Confidence is the inverse of the standard deviation of inverse depth, m.

    Args:
        recording: two cameras or more, of which 0 and 1 are used.
        window: of which the part before the reference time is looked at.
        view: where depth is wanted.
        config: the border that reports no depth.
        parameters: of the mapping; by default those of `config`.

    Raises:
        InputError: a rig or depth range that cannot be matched, too short a window, or one in which
            no two estimates agree.
    """
    parameters = parameters or config.esvo
    times_us = instants_us(window, parameters.rate_hz)
    before = [t_us for t_us in times_us if t_us <= window.t_ref_us]
    if not before:
        raise InputError(
            f"ESVO/own-rate: no map at {parameters.rate_hz:g} Hz between {window.t0_us} µs and the "
            f"reference time {window.t_ref_us} µs: choose a longer duration_s"
        )
    looker = Looker(recording, window.t0_us, view, parameters)
    newest = _newest([looker.at(t_us) for t_us in before], parameters.most_points)
    return _fused("ESVO/own-rate", newest, looker, view, config, parameters)


def estimate_window(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: EsvoParameters | None = None,
) -> DepthMap:  # fmt: skip
    """Fuses every map of the window (`ESVO/window`); otherwise as `estimate`."""
    parameters = parameters or config.esvo
    looker = Looker(recording, window.t0_us, view, parameters)
    maps = [looker.at(t_us) for t_us in instants_us(window, parameters.rate_hz)]
    return _fused("ESVO/window", maps, looker, view, config, parameters)


def _newest(maps: Sequence[Looked], most_points: int) -> Sequence[Looked]:
    """The last maps whose estimates are not more than so many; at least the last one."""
    points = np.cumsum([looked.estimates for looked in reversed(maps)])
    return maps[len(maps) - max(1, int((points <= most_points).sum())) :]


def _fused(
    method: str, maps: Sequence[Looked], looker: Looker, view: ReferenceView, config: MapperConfig,
    parameters: EsvoParameters,
) -> DepthMap:  # fmt: skip
    known = Estimates.empty(view.camera.height_px, view.camera.width_px)
    for looked in reversed(maps):
        known = _with(known, looked, looker, view, parameters)
    clean_up = parameters.clean_up
    most = clean_up.most_deviation_px / looker.px_per_rho
    rho = regularised(known, clean_up, parameters.regularisation, most)
    inside = rho > 0
    if not inside.any():
        estimates = sum(looked.estimates for looked in maps)
        raise InputError(
            f"{method}: {estimates} estimates of {len(maps)} maps up to {maps[-1].t_ref_us} µs, "
            f"but no pixel where {clean_up.least_fusions + 1} of them agree: choose a longer or "
            "another window, or check the calibration"
        )
    depth_m = np.divide(1, rho, out=np.zeros(rho.shape), where=inside).astype(np.float32)
    sure = np.divide(1, known.deviation, out=np.zeros(rho.shape), where=inside).astype(np.float32)
    return depth_map(method, depth_m, sure, view, config)


def _with(
    known: Estimates, looked: Looked, looker: Looker, view: ReferenceView,
    parameters: EsvoParameters,
) -> Estimates:  # fmt: skip
    """Carries a map into the reference view and fuses it there."""
    if not looked.estimates:
        return known
    T_rv_then = se3.inverse(view.T_world_rv) @ looker.pose(looked.t_us)
    rays = np.einsum("nij,nj->ni", T_rv_then[:, :3, :3], looked.bearing)
    refined = looked.refined
    bearing, rho, scale = propagate(rays, T_rv_then[:, :3, 3], refined.rho, refined.scale)
    camera = view.camera
    uv_px = bearing * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)
    return fuse_into(known, uv_px, rho, scale, refined.spread, parameters.refinement.dof)
