"""One map of ESVO: the newest events, matched on the time surfaces of one time and refined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.data.events import Events
from emvs.data.recording import Recording
from emvs.geometry import se3
from emvs.rivals.esvo_kernels import deviation_of
from emvs.rivals.esvo_match import match_blocks
from emvs.rivals.esvo_parameters import EsvoParameters
from emvs.rivals.esvo_refine import Lines, Refined, refine
from emvs.rivals.rectify import Rectified
from emvs.rivals.semi_global import disparity_range_px
from emvs.rivals.time_surface import TimeSurface
from emvs.view import ReferenceView

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Looked:
    """What one map made of its events, in the order of the events.

    Attributes:
        t_ref_us: time of the map, µs.
        t_us: (N,) int64 times of the events, µs.
        bearing: (N, 3) their rays in the rectified view of camera i, of depth 1.
        start: (N,) inverse depths by block matching, 1/m.
        refined: (N,) the same, refined; NaN where refinement failed or the result is vague.
    """

    t_ref_us: int
    t_us: NDArray[np.int64]
    bearing: Floats
    start: Floats
    refined: Refined

    @property
    def estimates(self) -> int:
        """How many events have an inverse depth."""
        return int(np.isfinite(self.refined.rho).sum())


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

    @property
    def px_per_rho(self) -> float:
        """Disparity of an inverse depth of 1/m, px."""
        return self.stereo.camera.fx_px * self.stereo.baseline_m

    def at(self, t_us: int) -> Looked:
        """Estimates the newest events before `t_us`, µs."""
        for camera, surface in zip(self.stereo.cameras, self._surfaces, strict=True):
            surface.update(self._recording.events(camera, self._fed_us, t_us))
        self._fed_us = t_us
        left, right = (
            self.stereo.image(side, surface.at(t_us)) * np.float32(255)
            for side, surface in enumerate(self._surfaces)
        )
        events, uv_px = self._newest(t_us)
        pixels = np.rint(uv_px).astype(np.int64)
        matching = self._parameters.matching
        disparity_px, _ = match_blocks(left, right, pixels, self._range_px, matching)
        found = np.isfinite(disparity_px)
        times_us, uv_px = events.t_us[found], uv_px[found]
        start = disparity_px[found].astype(np.float64) / self.px_per_rho
        bearing = np.column_stack([self.stereo.camera.unproject(uv_px), np.ones(len(uv_px))])
        lines = self._lines(t_us, times_us, bearing)
        refined = refine(left, right, lines, start, self._parameters.refinement)
        return Looked(t_us, times_us, bearing, start, self._checked(refined))

    def pose(self, t_us: int | NDArray[np.int64]) -> Floats:
        """(..., 4, 4) pose of the rectified view of camera i in the world."""
        pose: Floats = self._recording.trajectory.at(t_us) @ self.stereo.T_body_rect[0]
        return pose

    def _newest(self, t_us: int) -> tuple[Events, Floats]:
        """The newest events and their rectified pixels."""
        camera = self.stereo.cameras[0]
        since_us = t_us - round(self._parameters.recent_s * 1e6)
        events = self._recording.events(camera, since_us, t_us)
        events = events.slice(max(0, len(events) - self._parameters.most_events), len(events))
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

    def _checked(self, refined: Refined) -> Refined:
        """Without those that fit badly, are vague, or lie beyond the planes."""
        clean_up, dof = self._parameters.clean_up, self._parameters.refinement.dof
        low, high = self._range_px
        with np.errstate(invalid="ignore"):
            good = refined.spread <= clean_up.most_spread
            deviation_px = deviation_of(refined.scale, dof) * self.px_per_rho
            good &= deviation_px <= clean_up.most_deviation_px
            disparity_px = refined.rho * self.px_per_rho
            good &= (disparity_px >= low) & (disparity_px <= high)
        return Refined(np.where(good, refined.rho, np.nan), refined.scale, refined.spread)
