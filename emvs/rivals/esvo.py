"""ESVO's mapping, with given poses: events matched on time surfaces, refined, and fused.

Zhou, Gallego, Shen, *Event-based Stereo Visual Odometry*, TRO 2021, section IV, from its
description. Each map takes the newest events, matches blocks, refines every inverse depth, and is
carried into the reference view, where maps are fused in order of time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data import se3
from emvs.data.events import Events
from emvs.data.recording import Recording
from emvs.depthmap import DepthMap
from emvs.errors import InputError
from emvs.rivals.esvo_match import match_blocks
from emvs.rivals.esvo_parameters import EsvoParameters
from emvs.rivals.esvo_refine import Lines, Refined, refine
from emvs.rivals.esvo_regularise import regularised
from emvs.rivals.esvo_select import newest
from emvs.rivals.esvo_student_t import Estimates, fuse_into, propagate
from emvs.rivals.rectify import Rectified
from emvs.rivals.semi_global import disparity_range_px
from emvs.rivals.sgm import instants_us
from emvs.rivals.time_surface import TimeSurface
from emvs.rivals.to_view import depth_map
from emvs.view import ReferenceView
from emvs.window import Window

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

DEFAULT = EsvoParameters()


def estimate(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: EsvoParameters = DEFAULT,
) -> DepthMap:  # fmt: skip
    """Fuses the last maps up to the reference time (`ESVO/own-rate`).

    Confidence is the inverse of the standard deviation of inverse depth, m.

    Raises:
        InputError: a rig or depth range that cannot be matched, too short a window, or one whose
            events give no estimate.
    """
    times_us = instants_us(window, parameters.rate_hz)
    before = [t_us for t_us in times_us if t_us <= window.t_ref_us][-parameters.maps :]
    if not before:
        raise InputError(
            f"ESVO/own-rate: no map at {parameters.rate_hz:g} Hz between {window.t0_us} µs and the "
            f"reference time {window.t_ref_us} µs: choose a longer duration_s"
        )
    return _fused("ESVO/own-rate", before, recording, window, view, config, parameters)


def estimate_window(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig,
    parameters: EsvoParameters = DEFAULT,
) -> DepthMap:  # fmt: skip
    """Fuses every map of the window (`ESVO/window`); otherwise as `estimate`."""
    times_us = instants_us(window, parameters.rate_hz)
    return _fused("ESVO/window", times_us, recording, window, view, config, parameters)


@dataclass(frozen=True, eq=False)
class Looked:
    """What one map made of its events, in the order of the events.

    Attributes:
        t_us: (N,) int64 times of the events, µs.
        bearing: (N, 3) their rays in the rectified view of camera i, of depth 1.
        start: (N,) inverse depths by block matching, 1/m.
        refined: (N,) the same, refined; NaN where refinement failed or disagrees.
    """

    t_us: NDArray[np.int64]
    bearing: Floats
    start: Floats
    refined: Refined


class Looker:
    """Keeps both time surfaces and looks at them at growing times.

    Args:
        recording: two cameras or more, of which 0 and 1 are used.
        start_us: from when on events count, µs.
        view: whose planes limit depth.
        parameters: of the mapping.
    """

    def __init__(
        self, recording: Recording, start_us: int, view: ReferenceView, parameters: EsvoParameters
    ) -> None:
        self.stereo = Rectified.of(recording.rig)
        self._recording, self._parameters, self._fed_us = recording, parameters, start_us
        self._range_px = disparity_range_px(self.stereo, view)
        self._surfaces = [
            TimeSurface(
                recording.rig.cameras[k].width_px, recording.rig.cameras[k].height_px,
                parameters.decay_s, median_px=parameters.median_px,
                blur_sigma_px=parameters.blur_sigma_px,
            )
            for k in self.stereo.cameras
        ]  # fmt: skip

    def at(self, t_us: int) -> Looked:
        """Estimates the newest events before `t_us`, µs."""
        for camera, surface in zip(self.stereo.cameras, self._surfaces, strict=True):
            surface.update(self._recording.events(camera, self._fed_us, t_us))
        self._fed_us = t_us
        left, right = (
            self.stereo.image(side, surface.at(t_us)) * np.float32(255)
            for side, surface in enumerate(self._surfaces)
        )
        events, uv_px = self._chosen(t_us)
        pixels = np.rint(uv_px).astype(np.int64)
        matching = self._parameters.matching
        disparity_px, _ = match_blocks(left, right, pixels, self._range_px, matching)
        found = np.isfinite(disparity_px)
        times_us, uv_px = events.t_us[found], uv_px[found]
        scale = self.stereo.camera.fx_px * self.stereo.baseline_m
        start = disparity_px[found].astype(np.float64) / scale
        bearing = np.column_stack([self.stereo.camera.unproject(uv_px), np.ones(len(uv_px))])
        lines = self._lines(t_us, times_us, bearing)
        refined = refine(left, right, lines, start, self._parameters.refinement)
        return Looked(times_us, bearing, start, self._checked(refined))

    def _chosen(self, t_us: int) -> tuple[Events, Floats]:
        """The newest events and their rectified pixels."""
        camera = self.stereo.cameras[0]
        since_us = t_us - round(self._parameters.recent_s * 1e6)
        events = self._recording.events(camera, since_us, t_us)
        width_px = self._recording.rig.cameras[camera].width_px
        chosen = newest(events, self._parameters.most_events, width_px)
        events = Events(events.x[chosen], events.y[chosen], events.t_us[chosen], events.p[chosen])
        uv_px = self.stereo.events_px(0, events).astype(np.float64)
        seen = np.isfinite(uv_px).all(axis=1)
        return (
            Events(events.x[seen], events.y[seen], events.t_us[seen], events.p[seen]),
            uv_px[seen],
        )

    def _lines(self, t_us: int, times_us: NDArray[np.int64], bearing: Floats) -> Lines:
        T_now_world = se3.inverse(self.pose(t_us))
        T_now_then = T_now_world @ self.pose(times_us)
        camera = self.stereo.camera
        return Lines(
            np.einsum("nij,nj->ni", T_now_then[:, :3, :3], bearing), T_now_then[:, :3, 3].copy(),
            camera.fx_px, (camera.cx_px, camera.cy_px), self.stereo.baseline_m,
        )  # fmt: skip

    def pose(self, t_us: int | NDArray[np.int64]) -> Floats:
        """(..., 4, 4) pose of the rectified view of camera i in the world."""
        pose: Floats = self._recording.trajectory.at(t_us) @ self.stereo.T_body_rect[0]
        return pose

    def _checked(self, refined: Refined) -> Refined:
        with np.errstate(invalid="ignore"):
            good = refined.rms <= self._parameters.refinement.most_rms
        return Refined(np.where(good, refined.rho, np.nan), refined.scale, refined.rms)


def _fused(
    method: str, times_us: list[int], recording: Recording, window: Window, view: ReferenceView,
    config: MapperConfig, parameters: EsvoParameters,
) -> DepthMap:  # fmt: skip
    looker = Looker(recording, window.t0_us, view, parameters)
    known = Estimates.empty(view.camera.height_px, view.camera.width_px)
    for t_us in times_us:
        known = _with(known, looker.at(t_us), looker, view, parameters)
    if not known.count.any():
        raise InputError(
            f"{method}: none of the {len(times_us)} maps from {window.t0_us} to {times_us[-1]} µs "
            "has an event that matches in both cameras: choose another window, or check the rig's "
            "calibration"
        )
    per_px = 1 / (looker.stereo.camera.fx_px * looker.stereo.baseline_m)
    settings = parameters.regularisation
    rho = regularised(known, settings, settings.most_deviation_px * per_px)
    inside = rho > 0
    depth_m = np.divide(1, rho, out=np.zeros(rho.shape), where=inside).astype(np.float32)
    sure = np.divide(1, known.deviation, out=np.zeros(rho.shape), where=inside).astype(np.float32)
    return depth_map(method, depth_m, sure, view, config)


def _with(
    known: Estimates, looked: Looked, looker: Looker, view: ReferenceView,
    parameters: EsvoParameters,
) -> Estimates:  # fmt: skip
    """Carries a map into the reference view and fuses it there."""
    if not len(looked.t_us):
        return known
    T_rv_then = se3.inverse(view.T_world_rv) @ looker.pose(looked.t_us)
    rays = np.einsum("nij,nj->ni", T_rv_then[:, :3, :3], looked.bearing)
    refined = looked.refined
    bearing, rho, scale = propagate(rays, T_rv_then[:, :3, 3], refined.rho, refined.scale)
    camera = view.camera
    uv_px = bearing * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)
    return fuse_into(known, uv_px, rho, scale, parameters.refinement.dof)
