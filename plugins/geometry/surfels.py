"""What one exact depth picture says of the surfaces in it: places, normals, classes, sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.eval.scoring.regions import near_boundary
from eventsweep.plugins.geometry.nearest import along_curve

KINDS = ("plane", "curved", "edge", "thin", "far")
"""Classes of surfaces, by their number; `eval.scoring.metrics` says what each is."""
EDGE_PX, THIN_PX = 2, 5
"""Half-width of the band beside a discontinuity, and width of the widest thin thing, px."""
_THIN_JUMP = 0.05  # of inverse depth: more than a ridge changes over a few pixels
_BENT = 2e-4  # of the depth: a surface two pixels away from the tangent plane
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
_MOST_SLANTED = 4.0  # times that a pixel is longer on a slanted surface than on one seen head-on


@dataclass(frozen=True, eq=False)
class Surfels:
    """Discs on surfaces, a point each.

    Attributes:
        points_world: (N, 3) float64 centres, exactly on the surface, m.
        normals: (N, 3) float32 unit vectors in the world, towards the camera.
        radius_m: (N,) float32.
        depth_m: (N,) float32 least z-depth at which a camera saw it.
        kind: (N,) uint8 number in `KINDS`.
        views: (N,) int32 how many pictures show it.
    """

    points_world: NDArray[np.float64]
    normals: NDArray[np.float32]
    radius_m: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    kind: NDArray[np.uint8]
    views: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.points_world)


def ordered(surfels: Surfels) -> Surfels:
    """The same in the order of a space-filling curve; not copied if they are in it."""
    order = along_curve(surfels.points_world)
    if (order[1:] > order[:-1]).all():
        return surfels
    return Surfels(*(values[order] for values in vars(surfels).values()))


def surfels_of(
    depth_m: NDArray[np.float32], rays: NDArray[np.float64], T_world_cam: NDArray[np.float64],
    focal_px: float, cell_m: float, far_m: float, left_out: NDArray[np.bool_] | None = None,
) -> Surfels:  # fmt: skip
    """A surfel for each pixel of a picture.

    A disc is as large as what it stands for: a cell, or the pixel on its surface if that is larger.

    Args:
        depth_m: (H, W) exact z-depth, m; not finite where nothing is seen.
        rays: (H, W, 3) directions of the pixels, their z 1; NaN where there is none.
        T_world_cam: (4, 4) pose of the camera.
        focal_px: of the camera, px.
        cell_m: edge of the cells that surfels are drawn for, m.
        far_m: depth beyond which a surface is far, m.
        left_out: (H, W) pixels that are no truth, such as those of what moves.
    """
    seen = np.isfinite(depth_m) & (depth_m > 0) & np.isfinite(rays).all(axis=-1)
    points_cam = rays * np.where(seen, depth_m, np.nan).astype(np.float64)[..., None]
    normals = _normals(points_cam)
    kind = _kinds(depth_m, seen, points_cam, normals, far_m)
    chosen = seen if left_out is None else seen & ~left_out
    points, normals = points_cam[chosen], normals[chosen]
    facing = np.abs(np.sum(points * normals, axis=-1)) / np.linalg.norm(points, axis=-1)
    pixel_m = points[:, 2] / focal_px / np.maximum(facing, 1 / _MOST_SLANTED)
    return Surfels(
        se3.transform(T_world_cam, points),
        (normals @ T_world_cam[:3, :3].T).astype(np.float32),
        (np.maximum(pixel_m, cell_m) / np.sqrt(2)).astype(np.float32),
        depth_m[chosen],
        kind[chosen],
        np.ones(len(points), np.int32),
    )


def _normals(points_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H, W, 3) unit vectors towards the camera: across the smaller step to each side."""
    steps = [_smaller_step(points_cam, axis) for axis in (0, 1)]
    normals = np.cross(steps[1], steps[0])
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    sight = -points_cam / np.linalg.norm(points_cam, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.where(length > 0, normals / length, sight)
    away = np.sum(normals * points_cam, axis=-1, keepdims=True) > 0
    facing: NDArray[np.float64] = np.where(away, -normals, normals)
    return facing


def _smaller_step(points_cam: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """To the neighbour before or behind, whichever is less far in depth; 0 where there is none."""
    step = np.diff(points_cam, axis=axis)
    none = np.full_like(np.take(points_cam, [0], axis=axis), np.nan)
    behind, before = (np.concatenate(pair, axis=axis) for pair in ((step, none), (none, step)))
    size_behind, size_before = (
        np.nan_to_num(np.abs(one[..., 2:]), nan=np.inf) for one in (behind, before)
    )
    chosen = np.where(size_behind <= size_before, behind, before)
    return np.nan_to_num(chosen, nan=0.0)


def _kinds(
    depth_m: NDArray[np.float32], seen: NDArray[np.bool_], points_cam: NDArray[np.float64],
    normals: NDArray[np.float64], far_m: float,
) -> NDArray[np.uint8]:  # fmt: skip
    rho = np.where(seen, 1 / np.where(seen, depth_m, 1).astype(np.float64), 0.0)
    kind = np.full(depth_m.shape, KINDS.index("plane"), np.uint8)
    # The last that applies decides.
    kind[_bent(points_cam, normals)] = KINDS.index("curved")
    kind[near_boundary(depth_m, EDGE_PX)] = KINDS.index("edge")
    kind[_thin(rho)] = KINDS.index("thin")
    kind[seen & (depth_m > far_m)] = KINDS.index("far")
    return kind


def _bent(points_cam: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where a pixel two columns or rows away leaves the tangent plane."""
    bent = np.zeros(points_cam.shape[:2], np.bool_)
    for down, right in _STEPS[:2]:
        for sign in (-1, 1):
            there = shifted(points_cam, 2 * sign * down, 2 * sign * right, np.nan)
            off = np.abs(np.sum((there - points_cam) * normals, axis=-1))
            with np.errstate(invalid="ignore"):
                bent |= off > _BENT * points_cam[..., 2]
    return bent


def _thin(rho: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where what lies beside, to both sides and few pixels apart, is much farther."""
    thin = np.zeros(rho.shape, np.bool_)
    for down, right in _STEPS:
        sides = []
        for sign in (-1, 1):
            away = np.full(rho.shape, THIN_PX + 1)
            for k in range(THIN_PX, 0, -1):
                there = shifted(rho, sign * k * down, sign * k * right, np.inf)
                away[rho - there > _THIN_JUMP * rho] = k
            sides.append(away)
        thin |= sides[0] + sides[1] - 1 <= THIN_PX
    return thin


def shifted(
    image: NDArray[np.float64], down: int, right: int, outside: float
) -> NDArray[np.float64]:
    """An image whose pixels are those `down` rows and `right` columns away."""
    height, width = image.shape[:2]
    moved = np.full_like(image, outside)
    to_rows = slice(max(-down, 0), height - max(down, 0))
    from_rows = slice(max(down, 0), height - max(-down, 0))
    to_columns = slice(max(-right, 0), width - max(right, 0))
    from_columns = slice(max(right, 0), width - max(-right, 0))
    moved[to_rows, to_columns] = image[from_rows, from_columns]
    return moved
