"""One scene by MuJoCo's renderer and by ours, and how far apart they are."""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from eventsweep.plugins.raster.renderer import RasterRenderer
from eventsweep.sim.rendering.renderer import StereoRenderer

LEVEL = 1 / 255


class Apart(NamedTuple):
    """Differences between two renderers.

    Attributes:
        light: of pixels that show no edge, as grey levels; above 1 as a share of their light.
        depth: of the same pixels, as shares of the depth.
        signs: share of pixels where only one sees a surface.
        edges: share of pixels with another geom, all of them beside an edge; NaN if some are not.
    """

    light: np.ndarray
    depth: np.ndarray
    signs: float
    edges: float


def apart(spec, rig, T_world_body, supersample=3, camera=0, t_s=None, **settings):
    """How far apart the renderers are in one view."""
    pictures = []
    for renderer in (StereoRenderer, RasterRenderer):
        with renderer(spec, rig, supersample, **settings) as drawn:
            if t_s is not None:
                drawn.at(t_s)
            drawn.near_first(T_world_body)
            its = drawn.frame(camera, T_world_body)
            depth_m = drawn.depth(camera, T_world_body)
            pictures.append((its.intensity, depth_m, drawn.segmentation(camera, T_world_body)))
    return _apart(*zip(*pictures, strict=True))


def _apart(light, depth_m, geoms):
    smooth = ~_edge(geoms[0], depth_m[0])
    there = np.isfinite(depth_m[0]) & np.isfinite(depth_m[1])
    other = geoms[0] != geoms[1]
    return Apart(
        (np.abs(light[1] - light[0]) / np.maximum(light[0], 1))[smooth] / LEVEL,
        (np.abs(depth_m[1][there & smooth] / depth_m[0][there & smooth] - 1)),
        float((np.isfinite(depth_m[0]) != np.isfinite(depth_m[1])).mean()),
        float("nan") if (other & smooth).any() else float(other.mean()),
    )


def _edge(geoms, depth_m):
    """Pixels with another geom, or another depth by more than a face may slope, next to them."""
    near = np.where(np.isfinite(depth_m), 1 / depth_m, 0)
    around = [ndimage.maximum_filter(x, 3) - ndimage.minimum_filter(x, 3) for x in (geoms, near)]
    return (around[0] > 0) | (around[1] > 0.1 * near)
