"""Regions of ground truth: which pixels a number is about, the same ones for every method.

A region is drawn from ground truth alone, never from what a method reports, so no method can
choose its own. Region `all` is everything that is scored: truth finite, positive, inside the
configured limits and away from the image border. The others are parts of it.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.eval.config import EvalConfig
from eventsweep.sim.ground_truth import boundary

MaskImage = NDArray[np.bool_]
_DARK = 8.0
"""Added to intensities (0..255) before the logarithm: one step of the darkest level is 0.12."""
REGIONS: dict[str, str] = {
    "all": "every pixel with ground truth",
    "interior": "the pixels away from depth discontinuities",
    "boundary": "the pixels at depth discontinuities",
    "edges": "the pixels on texture edges",
    "static": "the pixels of what stands still",
    "moving": "the pixels of what moves by itself",
}
DRAWN: tuple[str, ...] = tuple(name for name in REGIONS if name != "all")
"""Those that are drawn from ground truth."""


def region_masks(
    sequence: Sequence, t_us: int, depth_m: NDArray[np.floating], config: EvalConfig
) -> dict[str, MaskImage]:
    """Draws the regions of camera 0's undistorted view at a stored time.

    Args:
        sequence: with ground truth at `t_us`.
        t_us: time of the reference view, µs.
        depth_m: (H, W) true z-depth of that view, m; not finite where there is none.
        config: width of the boundary, and contrast that makes an edge.

    Returns:
        (H, W) masks by region; `static` and `moving` only where segmentation is stored.
    """
    camera = sequence.rig.cameras[0]
    intensity = on_view(sequence.truth_intensity(0, t_us), camera)
    near_edge = near_boundary(depth_m, config.boundary_px)
    masks = {
        "interior": ~near_edge,
        "boundary": near_edge,
        "edges": texture_edges(intensity, config.edge_contrast),
    }
    if "segmentation" in sequence.truth_names(0):
        moving = on_view(sequence.truth_dynamic(0, t_us), camera)
        masks |= {"static": ~moving, "moving": moving}
    return masks


def near_boundary(depth_m: NDArray[np.floating], radius_px: int) -> MaskImage:
    """Marks pixels within `radius_px` (rows and columns) of a depth discontinuity.

    Args:
        depth_m: (H, W) true z-depth, m; not finite where nothing is seen.
        radius_px: 1 or more; 1 marks the two pixels beside each discontinuity.
    """
    known = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.inf)
    return grown(boundary(known.astype(np.float32)), radius_px - 1)


def grown(mask: MaskImage, radius_px: int) -> MaskImage:
    """Adds to a mask all pixels within `radius_px` rows and columns of it."""
    side = 2 * radius_px + 1
    spread = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8))
    return np.asarray(spread, np.bool_)


def log_gradient(intensity: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Gradient of log intensity by central differences: (H, W, 2) by column and row, 1/px."""
    rows, columns = np.gradient(np.log(intensity.astype(np.float64) + _DARK))
    return np.stack([columns, rows], axis=-1)


def texture_edges(intensity: NDArray[np.uint8], contrast: float) -> MaskImage:
    """Marks the pixels where log intensity changes by `contrast` or more per pixel."""
    gradient = log_gradient(intensity)
    return np.hypot(gradient[..., 0], gradient[..., 1]) >= contrast


def on_view(image: NDArray[Any], camera: Camera) -> NDArray[Any]:
    """Looks an image of the sensor up at the pixels of the camera's undistorted view.

    Takes the nearest pixel, so that labels stay labels; 0 where the sensor saw nothing.
    """
    if camera.model == "pinhole":
        return image
    bearing = camera.undistorted().bearing_table()
    rays = np.concatenate([bearing, np.ones((*bearing.shape[:2], 1))], axis=-1)
    place = np.nan_to_num(np.rint(camera.project(rays)), nan=-1.0).astype(np.int64)
    column, row = place[..., 0], place[..., 1]
    inside = (column >= 0) & (row >= 0) & (column < camera.width_px) & (row < camera.height_px)
    found: NDArray[Any] = np.zeros(image.shape, image.dtype)
    found[inside] = image[row[inside], column[inside]]
    return found


def away_from_border(shape: tuple[int, ...], border_px: int) -> MaskImage:
    """(H, W) pixels with at least `border_px` pixels between them and the end of the image."""
    inside = np.zeros(shape, np.bool_)
    inside[border_px : shape[0] - border_px, border_px : shape[1] - border_px] = True
    return inside
