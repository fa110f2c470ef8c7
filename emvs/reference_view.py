"""The reference view that all DSIs share, and its depth planes (paper, Alg. 1, line 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import DEFAULT_DEPTH_RANGE_M, PLANES, MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera


@dataclass(frozen=True, eq=False)
class ReferenceView:
    """A pose at a time, a pinhole camera, and (N,) float32 planes `rho` of inverse depth, 1/m."""

    t_us: int
    T_world_rv: NDArray[np.float64]
    camera: Camera
    rho: NDArray[np.float32]


def reference_view(recording: Recording, config: MapperConfig, t_us: int) -> ReferenceView:
    """Returns the reference view at `t_us`: by default camera 0's pose and camera, undistorted.

    Raises:
        InputError: an impossible depth range, a time that the poses do not cover, or a place on the
            baseline of a rig of one camera.
    """
    near_m, far_m = depth_range_m(recording, config)
    planes = linear_planes if config.spacing == "linear" else inverse_depth_planes
    planes = mcemvs_planes if config.is_mcemvs else planes
    return ReferenceView(
        t_us=t_us,
        T_world_rv=recording.trajectory.at(t_us) @ _T_body_rv(recording, config.reference_shift),
        camera=_camera(recording.rig.cameras[0].undistorted(), config),
        rho=planes(near_m, far_m, config.planes or PLANES),
    )


def _T_body_rv(recording: Recording, shift: float) -> NDArray[np.float64]:
    """Camera 0's pose, moved towards camera 1 by `shift` of the baseline; it does not turn."""
    T_body_rv = recording.rig.T_body_cam[0].copy()
    if shift == 0:
        return T_body_rv
    if len(recording.rig) < 2:
        raise InputError(f"reference_shift is {shift:g}: needs a rig of 2 cameras, this has 1")
    T_body_rv[:3, 3] += shift * (recording.rig.T_body_cam[1][:3, 3] - T_body_rv[:3, 3])
    return T_body_rv


def _camera(camera: Camera, config: MapperConfig) -> Camera:
    """The view's own size and lens; by default its axis keeps its place to the middle."""
    if config.is_camera_0_view:
        return camera
    width_px, height_px = config.view_width_px, config.view_height_px
    width_px = camera.width_px if width_px is None else width_px
    height_px = camera.height_px if height_px is None else height_px
    zoom = 1.0 if config.view_focal_px is None else config.view_focal_px / camera.fx_px
    zoom_y = zoom if config.view_focal_y_px is None else config.view_focal_y_px / camera.fy_px
    cx_px = (width_px - 1) / 2 + zoom * (camera.cx_px - (camera.width_px - 1) / 2)
    cy_px = (height_px - 1) / 2 + zoom_y * (camera.cy_px - (camera.height_px - 1) / 2)
    return Camera(
        width_px,
        height_px,
        camera.fx_px * zoom,
        camera.fy_px * zoom_y,
        cx_px if config.view_cx_px is None else config.view_cx_px,
        cy_px if config.view_cy_px is None else config.view_cy_px,
    )


_NEAREST_M, _FARTHEST_M = 1e-4, 1e6  # beyond them single precision cannot separate planes


def depth_range_m(recording: Recording, config: MapperConfig) -> tuple[float, float]:
    """Returns nearest and farthest depth: as configured, else as recorded, else 0.2 and 5 m."""
    near_m, far_m = recording.depth_range_m or DEFAULT_DEPTH_RANGE_M
    near_m = near_m if config.min_depth_m is None else config.min_depth_m
    far_m = far_m if config.max_depth_m is None else config.max_depth_m
    if not 0 < near_m < far_m:
        raise InputError(
            f"depth range {near_m:g}..{far_m:g} m: needs 0 < min_depth_m < max_depth_m; set both"
        )
    if near_m < _NEAREST_M or far_m > _FARTHEST_M:
        raise InputError(
            f"depth range {near_m:g}..{far_m:g} m: must lie within {_NEAREST_M:g} and "
            f"{_FARTHEST_M:g} m; set min_depth_m and max_depth_m"
        )
    return near_m, far_m


def inverse_depth_planes(min_depth_m: float, max_depth_m: float, count: int) -> NDArray[np.float32]:
    """Returns (count,) float32 planes in equal steps of inverse depth, 1/m, near to far.

    Both ends of the range are among them; there are at least 2.
    """
    return np.linspace(1 / min_depth_m, 1 / max_depth_m, count).astype(np.float32)


def linear_planes(min_depth_m: float, max_depth_m: float, count: int) -> NDArray[np.float32]:
    """Returns (count,) float32 planes in equal steps of depth, 1/m, near to far, ends included."""
    return (1 / np.linspace(min_depth_m, max_depth_m, count)).astype(np.float32)


def mcemvs_planes(min_depth_m: float, max_depth_m: float, count: int) -> NDArray[np.float32]:
    """Returns the (count,) float32 planes of the authors' implementation, 1/m, far to near.

    `1/max + i (1/min - 1/max) / count`: the nearest one lies a step beyond `min_depth_m`.
    """
    near, far = 1 / min_depth_m, 1 / max_depth_m
    return (far + np.arange(count) * (near - far) / count).astype(np.float32)


def inverse_depth_at(
    rho: NDArray[np.float32], position: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns the inverse depth at (...) fractional plane indices: (...) float32, 1/m."""
    first, last, place = float(rho[0]), float(rho[-1]), position.astype(np.float64)
    if not is_linear(rho):
        place *= (last - first) / (len(rho) - 1)
        place += first
        return place.astype(np.float32)
    place *= (1 / last - 1 / first) / (len(rho) - 1)
    place += 1 / first
    return (1 / place).astype(np.float32)


def is_linear(rho: NDArray[np.float32]) -> bool:
    """Says whether planes have equal steps of depth; else they have them of inverse depth."""
    middle, first, last = (float(rho[k]) for k in (len(rho) // 2, 0, -1))
    share = (len(rho) // 2) / (len(rho) - 1)
    inverse = first + share * (last - first)
    linear = 1 / (1 / first + share * (1 / last - 1 / first))
    return abs(middle - linear) < abs(middle - inverse)
