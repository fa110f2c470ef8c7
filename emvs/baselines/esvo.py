"""ESVO's mapping, with given poses: blocks matched on time surfaces, refined, and fused over time.

Zhou, Gallego, Shen, *Event-based Stereo Visual Odometry*, TRO 2021, section IV, from its
description; what that leaves open is as in the authors' program. Each map takes the newest events:
zero-mean normalised cross-correlation (ZNCC) of blocks, coarse to fine, gives the inverse depth
from which the refinement starts. Maps are carried into the reference view and fused there, the
newest first.

The refinement finds one inverse depth per event, by the difference of time-surface patches: an
event of time t - eps, with inverse depth rho in its own view, is carried to time t by the poses and
seen by both cameras there. The residuals are differences of the two time surfaces over a patch,
Student t distributed; Levenberg-Marquardt with the weights of that distribution minimises them. Its
scale, carried through the derivative of the weighted residuals, is the scale of rho:
`s_rho^2 = s_r^2 / |J|^2`. As in the authors' program the weights of that derivative take the
distribution's scale from the patch itself, which is also what says how well the patch fits.

The filter multiplies two Student t densities, approximated by one again. The bulk of an estimate
lies within twice its standard deviation, `s sqrt(nu / (nu - 2))`. The regularised map is a mean
over compatible neighbours, weighted by their variances, that leaves depth edges alone; the authors'
configuration for MVSEC leaves it out. Defaults are those of that configuration
(`mapping_upenn.yaml`), read so: a cost of at most 0.1 is (1 - ZNCC) / 2; a residual of at most 20
is the refitted scale; a deviation of 0.15 / m is 3.4 px there; an age of at least 1 is one fusion
after the first estimate; 3000 points are 4500 in whole maps, since the program keeps up to half as
many again. It gives no number of refinement steps and no age of events: 10 and 0.01 s are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.baselines.esvo_kernels import deviation_of, fuse, refine_all, search, smooth
from eventsweep.emvs.baselines.rectification import Rectified, depth_map
from eventsweep.emvs.baselines.sgm import disparity_range_px, instants_us
from eventsweep.emvs.baselines.time_surface import SurfacePair
from eventsweep.emvs.config import (
    CleanUp,
    EsvoParameters,
    MapperConfig,
    Matching,
    Refinement,
    Regularisation,
)
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.utils.runtime import in_threads
from eventsweep.emvs.windows import Window

Image = NDArray[np.float32]
Float64s = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lines:
    """Where each event's viewing ray runs in the rectified view at time t: `a + rho b`.

    Attributes:
        a: (N, 3) direction of the event's ray, of depth 1 in its own view.
        b: (N, 3) its origin, m.
        focal_px: of both views.
        centre_px: principal point (column, row) of both views.
        baseline_m: distance of the two.
    """

    a: Float64s
    b: Float64s
    focal_px: float
    centre_px: tuple[float, float]
    baseline_m: float


@dataclass(frozen=True, eq=False)
class Refined:
    """Inverse depths in the events' own views.

    Attributes:
        rho: (N,) inverse depth, 1/m; NaN where a patch leaves the picture or is flat.
        scale: (N,) scale of its Student t distribution, 1/m.
        spread: (N,) scale of the residuals, fitted to the patch; surfaces count 0..255.
    """

    rho: Float64s
    scale: Float64s
    spread: Float64s


def refine(left: Image, right: Image, lines: Lines, rho: Float64s, settings: Refinement) -> Refined:
    """Refines the inverse depths `rho` of (N,) events, on row-aligned time surfaces of 0..255."""
    out = np.full((len(rho), 3), np.nan)
    camera = (lines.focal_px, lines.centre_px[0], lines.centre_px[1], lines.baseline_m)
    half = settings.width_px // 2, settings.height_px // 2
    in_threads(
        refine_all, len(rho), left, right, lines.a, lines.b, camera, np.asarray(rho, np.float64),
        half[0], half[1], settings.steps, settings.dof, settings.scale, out,
    )  # fmt: skip
    return Refined(out[:, 0], out[:, 1], out[:, 2])


def estimate(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
) -> DepthMap:
    """Fuses the newest maps up to the reference time (`ESVO/own-rate`).

    Confidence is the inverse of the standard deviation of inverse depth, m.

    Raises:
        InputError: a rig or depth range that cannot be matched, too short a window, or one in which
            no two estimates agree.
    """
    parameters = config.esvo
    times_us = instants_us(window, parameters.rate_hz)
    before = [t_us for t_us in times_us if t_us <= window.t_ref_us]
    if not before:
        raise InputError(
            f"ESVO/own-rate: no map at {parameters.rate_hz:g} Hz between {window.t0_us} µs and the "
            f"reference time {window.t_ref_us} µs: choose a longer duration_s"
        )
    mapper = EsvoMapper(recording, window.t0_us, view, parameters)
    newest = _newest([mapper.at(t_us) for t_us in before], parameters.most_points)
    return _fused("ESVO/own-rate", newest, mapper, view, config)


def estimate_window(
    recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
) -> DepthMap:
    """Fuses every map of the window (`ESVO/window`); otherwise as `estimate`."""
    mapper = EsvoMapper(recording, window.t0_us, view, config.esvo)
    maps = [mapper.at(t_us) for t_us in instants_us(window, config.esvo.rate_hz)]
    return _fused("ESVO/window", maps, mapper, view, config)


def _newest(maps: Sequence[EsvoMap], most_points: int) -> Sequence[EsvoMap]:
    """The last maps whose estimates are not more than so many; at least the last one."""
    points = np.cumsum([m.estimates for m in reversed(maps)])
    return maps[len(maps) - max(1, int((points <= most_points).sum())) :]


def _fused(
    method: str, maps: Sequence[EsvoMap], mapper: EsvoMapper, view: ReferenceView,
    config: MapperConfig,
) -> DepthMap:  # fmt: skip
    """Carries maps into the reference view and fuses them there, the newest first."""
    camera, dof = view.camera, config.esvo.refinement.dof
    known = Estimates.empty(camera.height_px, camera.width_px)
    for added in reversed([each for each in maps if each.estimates]):
        T_rv_then = se3.inverse(view.T_world_rv) @ mapper.pose(added.t_us)
        rays = np.einsum("nij,nj->ni", T_rv_then[:, :3, :3], added.bearing)
        refined = added.refined
        bearing, rho, scale = propagate(rays, T_rv_then[:, :3, 3], refined.rho, refined.scale)
        uv_px = bearing * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)
        known = fuse_into(known, uv_px, rho, scale, refined.spread, dof)
    clean_up = config.esvo.clean_up
    most = clean_up.most_deviation_px / mapper.px_per_rho
    rho = regularised(known, clean_up, config.esvo.regularisation, most)
    inside = rho > 0
    if not inside.any():
        estimates = sum(m.estimates for m in maps)
        raise InputError(
            f"{method}: {estimates} estimates from {len(maps)} maps up to {maps[-1].t_ref_us} "
            f"µs, but no pixel where {clean_up.least_fusions + 1} of them agree: choose a longer "
            "or a different window, or check the calibration"
        )
    depth_m = np.divide(1, rho, out=np.zeros(rho.shape), where=inside).astype(np.float32)
    sure = np.divide(1, known.deviation, out=np.zeros(rho.shape), where=inside).astype(np.float32)
    return depth_map(method, depth_m, sure, view, config)


@dataclass(frozen=True, eq=False)
class EsvoMap:
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
    bearing: Float64s
    start: Float64s
    refined: Refined

    @property
    def estimates(self) -> int:
        """How many events have an inverse depth."""
        return int(np.isfinite(self.refined.rho).sum())


class EsvoMapper:
    """Keeps both time surfaces, and maps the newest events since `start_us` at growing times."""

    def __init__(
        self, recording: Recording, start_us: int, view: ReferenceView, parameters: EsvoParameters
    ) -> None:
        self.stereo = Rectified.of(recording.rig)
        self._recording, self._parameters = recording, parameters
        self._range_px = disparity_range_px(self.stereo, view)
        self._surfaces = SurfacePair(
            recording, self.stereo, start_us, parameters, parameters.blur_sigma_px
        )

    @property
    def px_per_rho(self) -> float:
        """Disparity of an inverse depth of 1/m, px."""
        return self.stereo.camera.fx_px * self.stereo.baseline_m

    def at(self, t_us: int) -> EsvoMap:
        """Estimates the newest events before `t_us`, µs."""
        self._surfaces.feed(t_us)
        left, right = (image * np.float32(255) for image in self._surfaces.images(t_us))
        events, uv_px = self._newest(t_us)
        pixels = np.rint(uv_px).astype(np.int64)
        matching = self._parameters.matching
        disparity_px, _ = match_blocks(left, right, pixels, self._range_px, matching)
        matched = np.isfinite(disparity_px)
        times_us, uv_px = events.t_us[matched], uv_px[matched]
        start = disparity_px[matched].astype(np.float64) / self.px_per_rho
        bearing = np.column_stack([self.stereo.camera.unproject(uv_px), np.ones(len(uv_px))])
        lines = self._lines(t_us, times_us, bearing)
        refined = refine(left, right, lines, start, self._parameters.refinement)
        return EsvoMap(t_us, times_us, bearing, start, self._checked(refined))

    def pose(self, t_us: int | NDArray[np.int64]) -> Float64s:
        """(..., 4, 4) pose of the rectified view of camera i in the world."""
        pose: Float64s = self._recording.trajectory.at(t_us) @ self.stereo.T_body_rect[0]
        return pose

    def _newest(self, t_us: int) -> tuple[Events, Float64s]:
        """The newest events and their rectified pixels."""
        camera = self.stereo.cameras[0]
        since_us = t_us - round(self._parameters.recent_s * 1e6)
        events = self._recording.events(camera, since_us, t_us)
        events = events.slice(max(0, len(events) - self._parameters.most_events), len(events))
        uv_px = self.stereo.events_px(0, events).astype(np.float64)
        seen = np.isfinite(uv_px).all(axis=1)
        return events.take(seen), uv_px[seen]

    def _lines(self, t_us: int, times_us: NDArray[np.int64], bearing: Float64s) -> Lines:
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


def match_blocks(
    left: Image, right: Image, pixels: NDArray[np.int64], range_px: tuple[int, int],
    settings: Matching,
) -> tuple[Image, Image]:  # fmt: skip
    """Matches a block around each of (N, 2) pixels (column, row) of row-aligned surfaces, 0..255.

    Returns:
        (N,) float32 whole disparities, px, NaN where no block of the right surface reaches
            `least_zncc`, the best lies at either end of the range, or the block leaves the picture;
            and (N,) float32 their ZNCC.
    """
    disparity_px = np.empty(len(pixels), np.float32)
    score = np.empty(len(pixels), np.float32)
    low, high = max(range_px[0] - 1, 0), range_px[1] + 1
    half = settings.width_px // 2, settings.height_px // 2
    in_threads(
        search, len(pixels), left, right, pixels, low, high, half[0], half[1], settings.coarse_px,
        disparity_px, score,
    )  # fmt: skip
    with np.errstate(invalid="ignore"):
        good = (score >= settings.least_zncc) & (disparity_px > low) & (disparity_px < high)
    return np.where(good, disparity_px, np.float32(np.nan)), score


@dataclass(frozen=True, eq=False)
class Estimates:
    """Student t distributed inverse depths, of pixels or of points.

    Attributes:
        rho: inverse depth, 1/m; NaN for none.
        scale: its scale, 1/m.
        dof: its degrees of freedom.
        count: int64, how many were fused into it.
        spread: the smallest scale of residuals among those (`Refined.spread`).
    """

    rho: Float64s
    scale: Float64s
    dof: Float64s
    count: NDArray[np.int64]
    spread: Float64s

    @classmethod
    def empty(cls, height_px: int, width_px: int) -> Estimates:
        """A map without any."""
        shape = height_px, width_px
        return cls(np.full(shape, np.nan), np.zeros(shape), np.zeros(shape),
                   np.zeros(shape, np.int64), np.zeros(shape))  # fmt: skip

    @property
    def deviation(self) -> Float64s:
        """Standard deviation of inverse depth, 1/m."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.scale * np.sqrt(self.dof / (self.dof - 2))


def propagate(
    rays: Float64s, origins_m: Float64s, rho: Float64s, scale: Float64s
) -> tuple[Float64s, Float64s, Float64s]:
    """Carries (N,) inverse depths into another view, and their scales by the derivative.

    There the (N, 3) rays `R @ (bearing, 1)` begin at (N, 3) `origins_m`.

    Returns:
        (N, 2) bearings, (N,) inverse depths, NaN behind the view, and (N,) their scales.
    """
    points = rays + rho[:, None] * origins_m
    with np.errstate(divide="ignore", invalid="ignore"):
        front = (points[:, 2] > 0) & np.isfinite(rho)
        new = np.where(front, rho / points[:, 2], np.nan)
        slope = np.abs(rays[:, 2]) / points[:, 2] ** 2
        return points[:, :2] / points[:, 2:], new, scale * slope


def fuse_into(
    known: Estimates, uv_px: Float64s, rho: Float64s, scale: Float64s, spread: Float64s, dof: float
) -> Estimates:
    """Fuses (N,) points into the four pixels around each; `known` stays as it is.

    Where a point is not compatible with what is there, it is left out if it lies behind by more
    than two standard deviations; else it takes the place of what is less sure and fits worse.
    """
    fused = Estimates(*(getattr(known, name).copy() for name in Estimates.__dataclass_fields__))
    fuse(
        uv_px, rho, scale, spread, dof, fused.rho, fused.scale, fused.dof, fused.count, fused.spread
    )
    return fused


def regularised(
    known: Estimates, clean_up: CleanUp, settings: Regularisation, most_deviation: float
) -> Float64s:
    """Cleans a fused map: (H, W) float64 inverse depths, 1/m; NaN for none.

    Estimates of more than `most_deviation`, 1/m, are left out.
    """
    deviation = known.deviation
    with np.errstate(invalid="ignore"):
        sure = (known.count > clean_up.least_fusions) & (deviation <= most_deviation)
    rho: Float64s = np.where(sure, known.rho, np.nan)
    if not settings.radius_px:
        return rho
    out = np.empty(rho.shape)
    radius_px, least = settings.radius_px, settings.least_neighbours
    in_threads(smooth, len(rho), rho, deviation, radius_px, least, out)
    return out
