"""The events of a ray-cast world: pictures dense in time, and a comparator of its own.

Log intensity is taken as linear between two pictures, which are so close that nothing moves by more
than `STEP_PX` from one to the next.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ray_world import Array, Panel, RayCaster, RayWorld

SAMPLES, STEP_PX = 16, 0.06
_LONGEST_S = 5e-4
_LOOKS = 12
"""How often the speed of the image is measured in a clip; a drop of it between two is small."""
_MARGIN_PX = 2.0


@dataclass(frozen=True, eq=False)
class PixelEvents:
    """Events in the order of time: columns, rows, times in µs, polarities 0 and 1; (N,) each."""

    x: NDArray[np.int64]
    y: NDArray[np.int64]
    t_us: Array
    p: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t_us)


def ray_events(
    world: RayWorld,
    duration_s: float,
    *,
    log_eps: float,
    threshold: float = 0.2,
    samples: int = SAMPLES,
    step_px: float = STEP_PX,
) -> PixelEvents:
    """The events of a world from time 0 on.

    Args:
        world: panels and camera.
        duration_s: how long, s.
        log_eps: added to intensity before the logarithm.
        threshold: change of log intensity per event, of both polarities.
        samples: S, for S x S rays per pixel.
        step_px: furthest that anything moves between two pictures.
    """
    times_s, caster = dense_times_s(world, duration_s, step_px), RayCaster(world, samples)
    now = np.log(caster.picture(0.0) + log_eps).ravel()
    reference, parts = now.copy(), []
    for span_s in pairwise(times_s):
        before, now = now, np.log(caster.picture(span_s[1]) + log_eps).ravel()
        parts.append(crossings(before, now, reference, threshold, span_s))
    pixel, t_s, p = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(t_s, kind="stable")
    rows, columns = np.divmod(pixel[order], world.camera.width_px)
    return PixelEvents(columns, rows, 1e6 * t_s[order], p[order])


def crossings(
    before: Array, now: Array, reference: Array, threshold: float, span_s: tuple[float, float]
) -> tuple[NDArray[np.int64], Array, NDArray[np.int64]]:
    """Pixels, times and polarities of the levels that log intensity passes between two pictures.

    Levels lie whole thresholds from `reference` (P,), which moves to the last one that is passed.
    """
    rise = now - reference
    count = np.floor(np.abs(rise) / threshold + 1e-9).astype(np.int64)
    pixel = np.repeat(np.arange(len(now)), count)
    first = np.repeat(np.cumsum(count) - count, count)
    step = threshold * np.sign(rise)
    level = reference[pixel] + (np.arange(len(pixel)) - first + 1) * step[pixel]
    share = (level - before[pixel]) / (now[pixel] - before[pixel])
    reference += count * step
    return pixel, span_s[0] + share * (span_s[1] - span_s[0]), (rise[pixel] > 0).astype(np.int64)


def dense_times_s(world: RayWorld, duration_s: float, step_px: float) -> Array:
    """Even times, so close that what the camera sees moves by at most `step_px` between two."""
    looks_s = np.linspace(0, duration_s, _LOOKS)
    fastest_px_s = max(image_speed_px_s(world, t_s) for t_s in looks_s)
    interval_s = min(step_px / max(fastest_px_s, 1e-9), _LONGEST_S)
    return np.linspace(0, duration_s, math.ceil(duration_s / interval_s) + 1)


def image_speed_px_s(world: RayWorld, t_s: float, over_s: float = 1e-6) -> float:
    """How fast the fastest point of any panel moves over the sensor, hidden ones included."""
    camera, (grid_x, grid_y) = world.camera, _grid(world)
    uv_px = np.stack([grid_x.ravel(), grid_y.ravel()], -1)
    rays = np.concatenate([camera.rays(uv_px), np.ones((len(uv_px), 1))], 1)
    fastest = 0.0
    for panel, inverse in zip(world.panels, world.inverse_panels(t_s), strict=True):
        a, b, near = inverse @ rays.T
        ahead = near > 1e-6
        # To the panel's own edge, lest the rays miss one that is thinner than a pixel.
        at = np.clip(np.stack([a, b])[:, ahead] / near[ahead], -1, 1)
        fastest = max(fastest, _speed_px_s(world, panel, at, t_s, over_s))
    return fastest


def _grid(world: RayWorld) -> list[Array]:
    """Every pixel of the sensor."""
    camera = world.camera
    return np.meshgrid(np.arange(camera.width_px, dtype=float), np.arange(camera.height_px))


def _speed_px_s(world: RayWorld, panel: Panel, at: Array, t_s: float, over_s: float) -> float:
    """Of points (2, N) of one panel, those that fall on the sensor."""
    points_m = np.array([panel.across_m, panel.down_m]).T @ at
    then_px, now_px = (
        _positions(world, panel, points_m, moment_s) for moment_s in (t_s, t_s + over_s)
    )
    size_px = np.array([world.camera.width_px, world.camera.height_px])
    inside = ((then_px > -_MARGIN_PX) & (then_px < size_px + _MARGIN_PX)).all(1)
    moved_px = np.linalg.norm(now_px - then_px, axis=1)[inside]
    return float(moved_px.max(initial=0.0)) / over_s


def _positions(world: RayWorld, panel: Panel, points_m: Array, t_s: float) -> Array:
    """Where points (3, N), from a panel's middle, are seen; NaN behind the camera."""
    T_world_cam = world.T_world_cam(t_s)
    centre_m = np.add(panel.centre_m, np.multiply(t_s, panel.velocity_m_s))
    in_world_m = points_m + (centre_m - T_world_cam[:3, 3])[:, None]
    in_camera_m = T_world_cam[:3, :3].T @ in_world_m
    in_camera_m[:, in_camera_m[2] <= 0] = np.nan
    return world.camera.positions(in_camera_m.T)
