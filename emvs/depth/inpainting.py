"""Dense depth from points: the gaps between them filled in, and marked as filled in.

Points are joined to triangles (Delaunay); a plane in space is linear in inverse depth over the
image, so a triangle on one surface is filled exactly. A triangle that spans a depth edge would be
a ramp that nobody saw: there each pixel takes the inverse depth of the corner it belongs to most,
and the edge stays a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.depth_map import DepthMap

if TYPE_CHECKING:
    from scipy.spatial import Delaunay

Float32s = NDArray[np.float32]
Mask = NDArray[np.bool_]

MAX_RATIO = 1.5  # of the corners' depths, far over near: above it a triangle spans an edge


@dataclass(frozen=True, eq=False)
class Dense:
    """A depth map with its gaps filled; what is filled in is a guess and never scored as points.

    `depth_m` is finite everywhere, and meaningful where (H, W) `measured`, the method's own points,
    or `filled`, the pixels between them, is set.
    """

    depth_m: Float32s
    measured: Mask
    filled: Mask


def inpaint(depth_map: DepthMap) -> Dense:
    """Fills the gaps between a depth map's points; nothing outside their convex hull."""
    depth_m, filled = fill(depth_map.depth_m, depth_map.mask)
    return Dense(depth_m, depth_map.mask, filled)


def fill(depth_m: Float32s, mask: Mask, max_ratio: float = MAX_RATIO) -> tuple[Float32s, Mask]:
    """Fills a depth image between its points, where `mask` is set; says where it was filled in.

    Triangles whose corners' depths differ by more than `max_ratio` keep a step.
    """
    from scipy.spatial import Delaunay, QhullError  # takes long to import

    rows, columns = np.nonzero(mask)
    out, filled = depth_m.copy(), np.zeros_like(mask)
    try:
        mesh = Delaunay(np.stack([columns, rows], axis=1).astype(np.float64))
    except (QhullError, ValueError):  # fewer than three points, or all on one line
        return out, filled
    gap_rows, gap_columns = np.nonzero(~mask)
    pixels = np.stack([gap_columns, gap_rows], axis=1).astype(np.float64)
    triangle = mesh.find_simplex(pixels)
    inside = triangle >= 0
    triangle, pixels = triangle[inside], pixels[inside]
    weight = _barycentric(mesh, triangle, pixels)
    rho = (1 / depth_m[rows, columns].astype(np.float64))[mesh.simplices[triangle]]
    smooth = (weight * rho).sum(axis=1)
    own = np.take_along_axis(rho, weight.argmax(axis=1)[:, None], axis=1)[:, 0]
    step = rho.max(axis=1) > max_ratio * rho.min(axis=1)
    at = gap_rows[inside], gap_columns[inside]
    out[at] = 1 / np.where(step, own, smooth)
    filled[at] = True
    return out, filled


def _barycentric(
    mesh: Delaunay, triangle: NDArray[np.intp], pixels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(K, 3) weights of the corners of each pixel's triangle."""
    to_weights = mesh.transform[triangle]
    two = np.einsum("kij,kj->ki", to_weights[:, :2], pixels - to_weights[:, 2])
    weight: NDArray[np.float64] = np.column_stack([two, 1 - two.sum(axis=1)])
    return weight
