"""Depth of one view from the frames of a camera that slides sideways: no event takes part.

A plane sweep: for each inverse depth the frames on either side are moved to the view and correlated
with the frame nearest to it (zero-mean, normalised, Gaussian window). Those on the left and those
on the right find a depth each; where the two agree, and nothing else correlates as well, it is
known. Silhouettes, repeated patterns and bare surfaces are left out by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.precision import BAND
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera

Float32s = NDArray[np.float32]
Mask = NDArray[np.bool_]

NEAREST_M, FARTHEST_M, _STEPS = 0.42, 2.8, 320
_REACH_M = 0.04, 0.22  # how far from the view a frame may be taken
_WINDOW_PX = 1.6  # scale of the window that is correlated
_LEAST_VARIANCE = 4.0  # grey values squared: less is the sensor's noise
_FEWEST_FRAMES = 3
_APART = 12  # steps from the best depth to where another counts as a rival
_RIM_PX = 6


@dataclass(frozen=True, eq=False)
class FrameDepth:
    """What the frames say of one view.

    Attributes:
        depth_m: (H, W) float32 z-depth.
        known: (H, W) bool, where it can be relied on.
        disagreement: (H, W) float32, of the depths from the left and from the right, as a share.
        frame: (H, W) float32 grey values of the frame nearest to the view, without distortion.
    """

    depth_m: Float32s
    known: Mask
    disagreement: Float32s
    frame: Float32s

    @property
    def own_error(self) -> float:
        """The band that holds 68 % of this depth's own errors, as a share of depth.

        The mean of two depths with independent errors errs like half of their difference. What
        errs alike on both sides does not show, so it may be more.
        """
        return float(np.quantile(self.disagreement[self.known] / 2, BAND))


def undistorted(image: NDArray[np.uint8], camera: Camera) -> Float32s:
    """A frame as a pinhole camera of the same focal length sees it."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(np.float64)
    pinhole = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px], -1)
    uv = camera.project(np.concatenate([pinhole, np.ones((*u.shape, 1))], -1)).astype(np.float32)
    moved = cv2.remap(image.astype(np.float32), uv[..., 0], uv[..., 1], cv2.INTER_CUBIC)
    return np.asarray(moved, np.float32)


def depth_from_frames(
    frames: Sequence[Float32s], offsets_m: NDArray[np.float64], fx_px: float
) -> FrameDepth:
    """Sweeps the frames of a camera that moves along its own x axis.

    Args:
        frames: (H, W) each, without distortion.
        offsets_m: (K,) how far to the right of the view each was taken, m.
        fx_px: focal length.

    Raises:
        InputError: too few frames on one side.
    """
    near, far = _REACH_M
    sides = [
        [k for k, x in enumerate(offsets_m) if near <= sign * x <= far][::2] for sign in (-1, 1)
    ]
    if min(map(len, sides)) < _FEWEST_FRAMES:
        raise InputError(
            f"{len(sides[0])} frames left and {len(sides[1])} right of the view: needs at least "
            f"{_FEWEST_FRAMES} within {near:g} to {far:g} m on either side; choose another view"
        )
    middle = int(np.argmin(np.abs(offsets_m)))
    rho = np.linspace(1 / FARTHEST_M, 1 / NEAREST_M, _STEPS)
    scores = np.empty((2, _STEPS, *frames[middle].shape), np.float32)
    for step, inverse_depth in enumerate(rho):
        per_m = fx_px * inverse_depth
        view = _Window(_moved(frames[middle], per_m * offsets_m[middle])[0])
        for side, chosen in enumerate(sides):
            others = [_moved(frames[k], per_m * offsets_m[k]) for k in chosen]
            scores[side, step] = _mean_correlation(view, others)
    return _agreed(scores, rho, frames[middle])


class _Window:
    """An image with its weighted mean and variance around every pixel."""

    def __init__(self, image: Float32s) -> None:
        self.image, self.mean = image, _blurred(image)
        spread = _blurred(image * image) - self.mean * self.mean
        self.variance = np.maximum(spread, np.float32(_LEAST_VARIANCE))

    def correlation(self, other: _Window) -> Float32s:
        """(H, W) in -1..1."""
        together = _blurred(self.image * other.image) - self.mean * other.mean
        return np.asarray(together / np.sqrt(self.variance * other.variance), np.float32)


def _blurred(image: Float32s) -> Float32s:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), _WINDOW_PX), np.float32)


def _moved(image: Float32s, shift_px: float) -> tuple[Float32s, Mask]:
    """The image moved to the right by so many pixels, and where it has content."""
    height, width = image.shape
    motion = np.array([[1, 0, shift_px], [0, 1, 0]])
    moved = cv2.warpAffine(
        image, motion, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    from_px = np.arange(width) - shift_px
    inside = (from_px >= 0) & (from_px <= width - 1)
    return np.asarray(moved, np.float32), np.broadcast_to(inside, image.shape)


def _mean_correlation(view: _Window, others: Sequence[tuple[Float32s, Mask]]) -> Float32s:
    """Mean over the frames that see a pixel; -1 where too few do."""
    total, seen = np.zeros_like(view.image), np.zeros(view.image.shape, np.int64)
    for moved, inside in others:
        total += np.where(inside, view.correlation(_Window(moved)), np.float32(0))
        seen += inside
    enough = seen >= _FEWEST_FRAMES
    return np.where(enough, total / np.maximum(seen, 1), -1).astype(np.float32)


def _agreed(scores: Float32s, rho: NDArray[np.float64], frame: Float32s) -> FrameDepth:
    """The depth on which both sides agree, where it is the only one."""
    whole = np.where((scores > -1).all(axis=0), scores.mean(axis=0), np.float32(-1))
    (left, left_score, _), (right, right_score, _), (both, score, rival) = (
        _peak(s, rho) for s in (scores[0], scores[1], whole)
    )
    disagreement = np.abs(left - right) / both
    contrast = np.sqrt(np.maximum(_blurred(frame * frame) - _blurred(frame) ** 2, 0))
    known = (np.minimum(left_score, right_score) > 0.75) & (score > 0.8) & (score - rival > 0.05)
    known &= (disagreement < 0.02) & (np.abs(left - both) < 0.02 * both) & (contrast > 4)
    known[:_RIM_PX] = known[-_RIM_PX:] = False
    return FrameDepth(np.asarray(1 / both, np.float32), known, disagreement, frame)


def _peak(scores: Float32s, rho: NDArray[np.float64]) -> tuple[Any, Float32s, Float32s]:
    """Inverse depth of the largest score, between steps; that score; the best one elsewhere."""
    best = np.clip(scores.argmax(axis=0), 1, len(rho) - 2)
    before, top, after = (
        np.take_along_axis(scores, (best + k)[None], axis=0)[0] for k in (-1, 0, 1)
    )
    bend = np.minimum(before - 2 * top + after, np.float32(-1e-6))
    offset = np.clip(0.5 * (before - after) / bend, -1, 1)
    far = np.abs(np.arange(len(rho))[:, None, None] - best) > _APART
    return rho[best] + offset * (rho[1] - rho[0]), top, np.where(far, scores, -1).max(axis=0)
