"""Points of any origin, seen from the reference view: nearest first, one per pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.depth.depth_map import DepthMap, without_border
from emvs.geometry import se3
from emvs.rivals.rectify import Rectified
from emvs.rivals.rectify_kernels import splat
from emvs.view import ReferenceView

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Seen:
    """What the reference view sees of some points.

    Attributes:
        depth_m: (H, W) float32 z-depth of the nearest point of each pixel; 0 for none.
        value: (H, W) float32 that point's value; 0 for none.
    """

    depth_m: Image
    value: Image

    @property
    def mask(self) -> Mask:
        """(H, W) bool, where there is a point."""
        return self.depth_m > 0


def see(
    points_world: NDArray[np.float64], values: NDArray[np.floating], view: ReferenceView
) -> Seen:
    """Projects points into the reference view, each into the pixel whose square it hits.

    Args:
        points_world: (N, 3) points, m; points that are not finite are left out.
        values: (N,) what each is worth, such as its confidence.
        view: the reference view.
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
    """Carries a disparity image of camera i's rectified view into the reference view.

    Args:
        disparity_px: (H', W') float32; NaN or 0 and less for none.
        value: (H', W') float32, what each is worth.
        stereo: the rectified pair.
        t_us: when it was seen, µs.
        recording: its poses.
        view: the reference view.
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

    Args:
        method: its name.
        depth_m: (H, W) float32 z-depth; 0 or NaN for none.
        confidence: (H, W) float32, 0 or more.
        view: the reference view.
        config: the border that reports no depth.
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
