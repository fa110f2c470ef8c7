"""Ground truth besides depth: flow, boundaries, twist, event depth.

Everything here is exact for rigid bodies, still or moving: it follows from rendered depth, the
calibrated camera model and the motions' own curves, never from pictures.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.ground_truth_kernels import fill_event_depth
from eventsweep.sim.motion import Motion

BOUNDARY_JUMP = 0.02
"""A depth discontinuity: inverse depth misses a plane's continuation by this share of itself."""
_TWIST_STEP_S = 1e-4
# Within half a pixel of motion, inverse depth of one surface changes by less than this share.
_SAME_SURFACE = 0.02
_BAND_ROWS = 32
"""Rows at once, so that a large sensor's flow takes little memory beside it."""


def flow_px(
    camera: Camera,
    bearing: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    T_later_now: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Moves the surface point at each pixel's centre along with a rigid motion of the camera.

    `bearing` is the camera's `bearing_table()`. Where (H, W) `depth_m` is inf, things are
    infinitely far, so that only rotation moves them.

    Returns:
        (H, W, 2) float32: column and row there minus column and row here, px; NaN where the point
            is not in front of the camera any more, or the lens gives the pixel no ray. Points that
            leave the sensor have a flow as well.
    """
    flow = np.empty((*depth_m.shape, 2), np.float32)
    for first in range(0, camera.height_px, _BAND_ROWS):
        some = slice(first, min(first + _BAND_ROWS, camera.height_px))
        columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(some.start, some.stop))
        pixels = np.stack([columns, rows], axis=-1)
        flow[some] = _moved_px(camera, pixels, bearing[some], depth_m[some], T_later_now)
    return flow


def body_flow_px(
    camera: Camera,
    bearing: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    shown: NDArray[np.bool_],
    T_later_now: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The same for the N pixels that show one moving body: (N, 2) in row-major order.

    `T_later_now` (4, 4) takes a point of the body in the camera frame now to the same point of the
    body in the camera frame later.
    """
    rows, columns = np.nonzero(shown)
    pixels = np.stack([columns, rows], axis=-1)
    return _moved_px(camera, pixels, bearing[shown], depth_m[shown], T_later_now)


def _moved_px(
    camera: Camera,
    pixels: NDArray[np.int64],
    bearing: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    T_later_now: NDArray[np.float64],
) -> NDArray[np.float32]:
    rays = np.concatenate([bearing, np.ones((*bearing.shape[:-1], 1))], axis=-1)
    # Scaled by inverse depth, which leaves the projection unchanged and is finite for all depths.
    rho = 1 / depth_m.astype(np.float64)
    later = rays @ T_later_now[:3, :3].T + rho[..., None] * T_later_now[:3, 3]
    moved: NDArray[np.float64] = camera.project(later) - pixels
    return moved.astype(np.float32)


def boundary(depth_m: NDArray[np.float32], jump: float = BOUNDARY_JUMP) -> NDArray[np.bool_]:
    """Finds the pixels of (H, W) z-depth whose centre lies within 1 px of a depth discontinuity.

    On a plane, inverse depth is affine in the pixel. Between two neighbours of a row, a column or a
    diagonal lies a discontinuity where the step of inverse depth differs from the step before, from
    the step behind, and from zero, each by more than `jump` times the larger of the two inverse
    depths. So a slanted floor, and the fold where it meets a wall, is none. Both neighbours are
    marked. Only a diagonal finds the pixel in which two wires cross.
    """
    rho = 1 / depth_m.astype(np.float64)
    marked = np.zeros(depth_m.shape, bool)
    for down, right in ((0, 1), (1, 0), (1, 1)):
        _mark(rho, jump, down, right, marked)
    _mark(rho[:, ::-1], jump, 1, 1, marked[:, ::-1])
    return marked


def _mark(
    rho: NDArray[np.float64], jump: float, down: int, right: int, marked: NDArray[np.bool_]
) -> None:
    """Marks both ends of the steps by (`down`, `right`) pixels that no plane explains."""
    here, there = _ends(rho, down, right)
    step = there - here
    unlike = np.full((2, *step.shape), np.inf)
    before, behind = _ends(step, down, right)
    change = np.abs(behind - before)
    _ends(unlike[0], down, right)[0][:] = change
    _ends(unlike[1], down, right)[1][:] = change
    least = unlike.min(axis=0)
    large = jump * np.maximum(here, there)
    # At the picture's edge there is one neighbouring step only, and it may be the odd one; in
    # its corners the diagonal has none.
    jumps = (least > large) & np.isfinite(least) & (np.abs(step) > large)
    for ends in _ends(marked, down, right):
        ends |= jumps


def _ends(values: NDArray[Any], down: int, right: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """The first and the second of all pairs (`down`, `right`) apart, as views."""
    height, width = values.shape
    return values[: height - down, : width - right], values[down:, right:]


def twist(
    motion: Motion, T_body_cam: NDArray[np.float64], t_s: float, duration_s: float
) -> NDArray[np.float64]:
    """Velocity of a camera in its own frame, from differences of its motion 0.1 ms apart.

    `motion` is the body's curve over [0, `duration_s`].

    Returns:
        (6,) linear velocity in m/s, then angular velocity in rad/s, of the camera relative to the
            world, in camera axes; the error is of second order in the step (below 1e-6 of the speed
            at head motion's frequencies).
    """
    T_cam_world = se3.inverse(motion.T_world_body(t_s) @ T_body_cam)

    def offset(step_s: float) -> NDArray[np.float64]:
        T_now_then = T_cam_world @ motion.T_world_body(t_s + step_s) @ T_body_cam
        turned = Rotation.from_matrix(T_now_then[:3, :3]).as_rotvec()
        return np.concatenate([T_now_then[:3, 3], turned])

    h = min(_TWIST_STEP_S, duration_s / 4)
    if t_s - h < 0:
        return (4 * offset(h) - offset(2 * h)) / (2 * h)
    if t_s + h > duration_s:
        return (4 * offset(-h) - offset(-2 * h)) / (-2 * h)
    return (offset(h) - offset(-h)) / (2 * h)


def event_depth_m(
    before_m: NDArray[np.float32],
    after_m: NDArray[np.float32],
    span_us: tuple[int, int],
    events: Events,
    places: NDArray[np.int32] | None = None,
) -> NDArray[np.float32]:
    """(N,) z-depth at the pixel and time of each event between two frames, m; inf for none.

    Where a surface stays, its inverse depth is interpolated linearly; where an edge passed, the
    nearer of the two depths is taken.

    Args:
        before_m: (H, W) nearest depth of each pixel's samples in the frame before, m; inf for none.
        after_m: (H, W) the same in the frame behind.
        span_us: times of the two frames, µs.
        events: N events on the same sensor, none after the frame behind; one that a coarse clock
            puts before the frame before counts as at that frame.
        places: (N, 4) column and row where each event's surface lies in the frame before, and in
            the frame behind; None where frames are so close that it is the event's own pixel.

    Raises:
        InputError: depths of two sizes, times that do not rise, or an event off the sensor.
    """
    if before_m.shape != after_m.shape or span_us[0] >= span_us[1]:
        raise InputError(
            f"depth of shapes {before_m.shape} and {after_m.shape} at {span_us[0]} and "
            f"{span_us[1]} µs: need one shape (H, W), and rising times"
        )
    depth_m = np.empty(len(events), np.float32)
    if not len(events):
        return depth_m
    x, y = int(events.x.max()), int(events.y.max())
    if y >= before_m.shape[0] or x >= before_m.shape[1]:
        raise InputError(
            f"events up to column {x} and row {y}, but depth (H, W) = {before_m.shape}: "
            "give both of the same camera"
        )
    if places is None:
        own = np.stack([events.x, events.y], -1).astype(np.int32)
        places = np.hstack([own, own])
    fill_event_depth(before_m, after_m, *span_us, places, events.t_us, _SAME_SURFACE, depth_m)
    return depth_m
