"""Ground truth beside depth: optical flow, depth boundaries, camera twist, geoms, event depth.

Everything here is exact for rigid bodies, still or moving: it follows from rendered depth, the
calibrated camera model and the motions' own curves, never from pictures.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from emvs.data.tables import Geom
from emvs.geometry import se3
from emvs.geometry.camera import Camera
from sim.motion.curves import Motion
from sim.rendering.moving_bodies import moving_geoms

BOUNDARY_JUMP = 0.02
"""A depth discontinuity: inverse depth misses a plane's continuation by this share of itself."""
_TWIST_STEP_S = 1e-4


def flow_px(
    camera: Camera,
    bearing: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    T_later_now: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Moves the surface point at each pixel's centre along with a rigid motion of the camera.

    Args:
        camera: any model.
        bearing: (H, W, 2) its `bearing_table()`.
        depth_m: (H, W) z-depth now, m; inf where nothing is seen: infinitely far, so that only
            rotation moves it.
        T_later_now: (4, 4) from the camera frame now to the camera frame later.

    Returns:
        (H, W, 2) float32: column and row there minus column and row here, px; NaN where the point
        is not in front of the camera any more, or the lens gives the pixel no ray. Points that
        leave the sensor have a flow as well.
    """
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    return _moved_px(camera, np.stack([columns, rows], axis=-1), bearing, depth_m, T_later_now)


def body_flow_px(
    camera: Camera,
    bearing: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    shown: NDArray[np.bool_],
    T_later_now: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The same for the pixels of one moving body, with the body's motion in `T_later_now`.

    Args:
        camera: any model.
        bearing: (H, W, 2) its `bearing_table()`.
        depth_m: (H, W) z-depth now, m.
        shown: (H, W) bool, which N pixels show the body.
        T_later_now: (4, 4) takes a point of the body in the camera frame now to the same point of
            the body in the camera frame later.

    Returns:
        (N, 2) float32 in row-major order of the pixels, as `flow_px`.
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
    """Finds the pixels whose centre lies within 1 px of a depth discontinuity.

    On a plane, inverse depth is affine in the pixel. Between two neighbours of a row, a column or
    a diagonal lies a discontinuity where the step of inverse depth differs from the step before,
    from the step behind, and from zero, each by more than `jump` times the larger of the two
    inverse depths. So a slanted floor, and the fold where it meets a wall, is none. Both neighbours
    are marked. Only a diagonal finds the pixel in which two wires cross.

    Args:
        depth_m: (H, W) z-depth, m; inf where nothing is seen.
        jump: relative size of a discontinuity.

    Returns:
        (H, W) bool.
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
    found = (least > large) & np.isfinite(least) & (np.abs(step) > large)
    for ends in _ends(marked, down, right):
        ends |= found


def _ends(values: NDArray[Any], down: int, right: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """The first and the second of all pairs (`down`, `right`) apart, as views."""
    height, width = values.shape
    return values[: height - down, : width - right], values[down:, right:]


def twist(
    motion: Motion, T_body_cam: NDArray[np.float64], t_s: float, duration_s: float
) -> NDArray[np.float64]:
    """Velocity of a camera in its own frame, from differences of its motion 0.1 ms apart.

    Args:
        motion: the body's curve over [0, `duration_s`].
        T_body_cam: (4, 4) where the camera sits.
        t_s: when, s.
        duration_s: where the curve ends, s.

    Returns:
        (6,) linear velocity in m/s, then angular velocity in rad/s, of the camera relative to the
        world, in camera axes; the error is of second order in the step (below 1e-6 of the speed at
        head motion's frequencies).
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


def geom_table(model: Any) -> dict[int, Geom]:
    """What the geom ids of a compiled MuJoCo model mean.

    A geom without a name goes by its body's, or by its number. Dynamic is what hangs on a joint,
    or on a mocap body.
    """
    table, moving = {}, moving_geoms(model)
    for geom_id in range(model.ngeom):
        body_id = int(model.geom_bodyid[geom_id])
        name = model.geom(geom_id).name or (model.body(body_id).name if body_id else "")
        table[geom_id] = Geom(name=name or f"geom{geom_id}", dynamic=bool(moving[geom_id]))
    return table
