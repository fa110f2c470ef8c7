"""Row-aligned views of two cameras, and the way back: their points in the reference view.

The views share one pinhole camera and one orientation: x along the baseline, from camera i to
camera j, and z as near to the mean optical axis as that allows (Fusiello et al., *A compact
algorithm for rectification of stereo pairs*, MVA 2000). So camera i is always the left one, its
disparities are never negative, and `depth_m = fx_px * baseline_m / disparity_px`; a rig with camera
j on the left, above or below is turned about the optical axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eventsweep.emvs.baselines.pixels_kernels import splat
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap, without_border
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.reference_view import ReferenceView

# Beyond these the views no longer show what the cameras see.
_MAX_SLOPE_DEG = 40.0
_MAX_TURN_DEG = 60.0
_MAX_ZOOM = 2.0  # a view has at most so many times the columns and rows of a sensor
Matrix = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Rectified:
    """A rectified stereo pair; index 0 of each pair is camera i (left), index 1 camera j (right).

    Attributes:
        cameras: (i, j), as the rig counts them.
        camera: the pinhole camera that both views share.
        baseline_m: distance of the two centres, m.
        R_rect_cam: per camera, (3, 3): `p_rect = R_rect_cam @ p_cam`.
        T_body_rect: per camera, (4, 4) pose of its view on the body, m.
        maps: per camera, (H, W, 2) float32 rectified pixel of every sensor pixel; NaN for none.
        sources: per camera, (2, H', W') float32 sensor column and row of every rectified pixel; far
            outside for none.
    """

    cameras: tuple[int, int]
    camera: Camera
    baseline_m: float
    R_rect_cam: tuple[Matrix, Matrix]
    T_body_rect: tuple[Matrix, Matrix]
    maps: tuple[Image, Image]
    sources: tuple[Image, Image]

    @classmethod
    def of(cls, rig: Rig, i: int = 0, j: int = 1) -> Rectified:
        """Rectifies cameras i, whose depth is asked for, and j of a rig.

        Raises:
            InputError: a camera that the rig does not have, no baseline, or axes too steep.
        """
        _check_pair(rig, i, j)
        R_body_rect = _orientation(rig, i, j)
        R_rect_cam = tuple(R_body_rect.T @ rig.T_body_cam[k][:3, :3] for k in (i, j))
        bearings = [_turned(rig.cameras[k], R) for k, R in zip((i, j), R_rect_cam, strict=True)]
        camera = _shared_camera(rig.cameras[i], bearings)
        focal_px, centre_px = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
        maps = tuple((b * focal_px + centre_px).astype(np.float32) for b in bearings)
        sources = tuple(
            _sources(camera, rig.cameras[k], R) for k, R in zip((i, j), R_rect_cam, strict=True)
        )
        poses = tuple(_pose(R_body_rect, rig.T_body_cam[k]) for k in (i, j))
        return cls(
            (i, j), camera, rig.baseline_m(i, j), _two(R_rect_cam), _two(poses), _two(maps),
            _two(sources),
        )  # fmt: skip

    def events_px(self, side: int, events: Events) -> Image:
        """(N, 2) float32 rectified pixels of events of camera `cameras[side]`; NaN for none."""
        pixels: Image = self.maps[side][events.y, events.x]
        return pixels

    def image(self, side: int, sensor_image: NDArray[np.generic]) -> Image:
        """(H', W') float32 view of a sensor image by bilinear interpolation; 0 outside it."""
        source = np.ascontiguousarray(sensor_image, np.float32)
        columns, rows = self.sources[side]
        return np.asarray(cv2.remap(source, columns, rows, cv2.INTER_LINEAR), np.float32)

    def disparity_px(self, depth_m: ArrayLike) -> Matrix:
        """Disparities of z-depths in the rectified views, px."""
        return self.camera.fx_px * self.baseline_m / np.asarray(depth_m, np.float64)

    def points_body(self, uv_px: ArrayLike, disparity_px: ArrayLike) -> Matrix:
        """Triangulates (N, 2) places in the view of camera i: (N, 3) points in the body frame, m.

        The disparity, above 0, is the column there minus that in the view of camera j.
        """
        bearing = self.camera.unproject(uv_px)
        depth_m = self.camera.fx_px * self.baseline_m / np.asarray(disparity_px, np.float64)
        points_rect = np.concatenate([bearing, np.ones_like(bearing[:, :1])], axis=1)
        return se3.transform(self.T_body_rect[0], points_rect * depth_m[:, None])


def _two(pair: tuple[NDArray[np.generic], ...]) -> tuple[NDArray, NDArray]:  # type: ignore[type-arg]
    first, second = pair
    return first, second


def _check_pair(rig: Rig, i: int, j: int) -> None:
    if len(rig) < 2:
        raise InputError(
            f"rig {rig.name} has 1 camera: stereo matching needs 2; choose EMVS/cam0 or Focus/cam0"
        )
    if not (0 <= i < len(rig) and 0 <= j < len(rig)) or i == j:
        raise InputError(
            f"rig {rig.name}: cameras {i} and {j} requested: needs two different ones from "
            f"0..{len(rig) - 1}"
        )
    if rig.baseline_m(i, j) == 0:
        raise InputError(
            f"rig {rig.name}: cameras {i} and {j} are at the same point: stereo needs a baseline"
        )


def _orientation(rig: Rig, i: int, j: int) -> Matrix:
    """R_body_rect: its columns are the axes of the views on the body."""
    x = rig.T_body_cam[j][:3, 3] - rig.T_body_cam[i][:3, 3]
    x = x / np.linalg.norm(x)
    axes = [rig.T_body_cam[k][:3, 2] for k in (i, j)]
    mean = axes[0] + axes[1]
    mean = mean / max(float(np.linalg.norm(mean)), np.finfo(float).tiny)
    slope_deg = float(np.degrees(np.arcsin(min(abs(float(x @ mean)), 1.0))))
    _check_angle(rig, (i, j), slope_deg, _MAX_SLOPE_DEG, "the baseline leaves the image plane")
    z = mean - (x @ mean) * x
    z = z / np.linalg.norm(z)
    for axis in axes:
        turn_deg = float(np.degrees(np.arccos(np.clip(axis @ z, -1, 1))))
        _check_angle(
            rig, (i, j), turn_deg, _MAX_TURN_DEG, "an optical axis deviates from the mean one"
        )
    return np.stack([x, np.cross(z, x), z], axis=1)


def _check_angle(
    rig: Rig, pair: tuple[int, int], angle_deg: float, limit_deg: float, what: str
) -> None:
    if angle_deg > limit_deg:
        raise InputError(
            f"rig {rig.name}: cameras {pair[0]} and {pair[1]} cannot be rectified, {what} by "
            f"{angle_deg:.1f} degrees: the limit is {limit_deg:g}; choose a method that fuses "
            "volumes, such as Alg1/H"
        )


def _turned(camera: Camera, R_rect_cam: Matrix) -> Matrix:
    """(H, W, 2) bearings of every sensor pixel in the rectified frame; NaN for none in front."""
    bearing = camera.bearing_table()
    ray = np.concatenate([bearing, np.ones_like(bearing[..., :1])], axis=-1) @ R_rect_cam.T
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(ray[..., 2:] > 0, ray[..., :2] / ray[..., 2:], np.nan)


def _shared_camera(camera: Camera, bearings: list[Matrix]) -> Camera:
    """Common rows of both, all columns of either, at the focal length of camera i."""
    focal_px = float(np.sqrt(camera.fx_px * camera.fy_px))
    spans = [np.nanquantile(b.reshape(-1, 2), [0, 1], axis=0) * focal_px for b in bearings]
    left_px, right_px = min(s[0, 0] for s in spans), max(s[1, 0] for s in spans)
    top_px, bottom_px = max(s[0, 1] for s in spans), min(s[1, 1] for s in spans)
    limit_px = _MAX_ZOOM * max(camera.width_px, camera.height_px)
    left_px, right_px = max(left_px, -limit_px / 2), min(right_px, limit_px / 2)
    top_px, bottom_px = max(top_px, -limit_px / 2), min(bottom_px, limit_px / 2)
    if bottom_px - top_px < 1 or right_px - left_px < 1:
        raise InputError(
            "the rectified cameras share no image row: stereo matching needs overlapping views"
        )
    # A tolerance, so that a rig that is rectified already keeps its size
    width_px, height_px = (
        int(np.ceil(size - 1e-6)) + 1 for size in (right_px - left_px, bottom_px - top_px)
    )
    return Camera(width_px, height_px, focal_px, focal_px, -float(left_px), -float(top_px))


def _sources(view: Camera, camera: Camera, R_rect_cam: Matrix) -> Image:
    """Where each pixel of the view lies on the sensor."""
    bearing = view.bearing_table()
    rays_cam = np.concatenate([bearing, np.ones_like(bearing[..., :1])], axis=-1) @ R_rect_cam
    uv_px = camera.project(rays_cam)
    known = np.isfinite(uv_px).all(axis=-1, keepdims=True)
    columns_rows = np.moveaxis(np.where(known, uv_px, -1e4), -1, 0)
    return np.ascontiguousarray(columns_rows, np.float32)


def _pose(R_body_rect: Matrix, T_body_cam: Matrix) -> Matrix:
    T_body_rect = np.eye(4)
    T_body_rect[:3, :3] = R_body_rect
    T_body_rect[:3, 3] = T_body_cam[:3, 3]
    return T_body_rect


@dataclass(frozen=True, eq=False)
class Seen:
    """(H, W) z-depth of the nearest point that the view sees, and its value; 0 for none."""

    depth_m: Image
    value: Image

    @property
    def mask(self) -> Mask:
        """(H, W) bool, where there is a point."""
        return self.depth_m > 0


def see(
    points_world: NDArray[np.float64], values: NDArray[np.floating], view: ReferenceView
) -> Seen:
    """Projects points, m, into the reference view, each into the pixel whose square it hits.

    Points that are not finite are left out; (N,) `values` say what each is worth.
    """
    points_rv = se3.transform(se3.inverse(view.T_world_rv), points_world)
    shape = view.camera.height_px, view.camera.width_px
    depth_m, value = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    splat(points_rv, values.astype(np.float32), view.camera.K, depth_m, value)
    return Seen(depth_m, value)


def see_disparities(
    disparity_px: Image, value: Image, stereo: Rectified, t_us: int, recording: Recording,
    view: ReferenceView,
) -> Seen:  # fmt: skip
    """Carries a disparity image of camera i's rectified view at `t_us` into the reference view.

    Pixels with NaN or 0 and less have none; `value` says what each is worth.
    """
    with np.errstate(invalid="ignore"):
        rows, columns = np.nonzero(disparity_px > 0)
    uv_px = np.stack([columns, rows], axis=1)
    points_body = stereo.points_body(uv_px, disparity_px[rows, columns])
    points_world = se3.transform(recording.trajectory.at(t_us), points_body)
    return see(points_world, value[rows, columns], view)


def depth_map(
    method: str, depth_m: Image, confidence: Image, view: ReferenceView, config: MapperConfig
) -> DepthMap:
    """Makes a depth map of what a view sees; depths beyond the view's planes are left out.

    `depth_m` is 0 or NaN for none, `confidence` 0 or more.
    """
    # Volumes know the range too; half a plane of tolerance, as their parabolas have it.
    rho = view.rho.astype(np.float64)
    step = abs(rho[1] - rho[0]) / 2, abs(rho[-1] - rho[-2]) / 2
    low, high = sorted([(rho[0], step[0]), (rho[-1], step[1])])
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / depth_m.astype(np.float64)
        inside = (depth_m > 0) & (inverse >= low[0] - low[1]) & (inverse <= high[0] + high[1])
    filled = np.where(inside, depth_m, np.float32(1 / low[0])).astype(np.float32)
    return DepthMap(
        method=method,
        depth_m=filled,
        confidence=np.where(inside, confidence, 0).astype(np.float32),
        mask=without_border(inside, config.border_px),
        argmax=_nearest_plane(1 / filled, view.rho),
        rho=view.rho,
        t_us=view.t_us,
        T_world_rv=view.T_world_rv,
        camera=view.camera,
    )


def _nearest_plane(inverse: NDArray[np.floating], rho: Image) -> NDArray[np.int16]:
    order = np.argsort(rho)
    middles = (rho[order][1:] + rho[order][:-1]) / 2
    kind = np.int16 if len(rho) <= np.iinfo(np.int16).max else np.int32
    return order[np.searchsorted(middles, inverse)].astype(kind)
