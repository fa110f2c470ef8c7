"""From the maximum of a fused DSI to a semi-dense depth map (paper, Alg. 1, line 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth import neighbours_kernels
from eventsweep.emvs.dsi.maxima import Maximum
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.reference_view import ReferenceView, inverse_depth_at
from eventsweep.emvs.utils.runtime import in_threads

Float32s = NDArray[np.float32]
Mask = NDArray[np.bool_]
Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth as one method sees it from the reference view.

    Attributes:
        method: the method's name.
        depth_m: (H, W) float32 z-depth; finite everywhere, meaningful where `mask` is set.
        confidence: (H, W) float32, the fused volume's maximum, in votes.
        mask: (H, W) bool, where there is depth.
        argmax: (H, W) int16 plane of the maximum, before interpolation and median.
        rho: (N,) float32 planes, 1/m.
        t_us, T_world_rv, camera: of the reference view: time, (4, 4) pose, pinhole camera.
        reliability: (H, W) float32, the method's own score: the larger, the better, and 0 or less
            where there is no candidate; None where it has none.
        scatter_px: (H, W) float32, how far depths lie from the surface fitted through them, around
            each pixel, px of disparity; None where none was fitted.
        error_m: (H, W) float32 half-width of the band that holds 68 % of the errors, m, where
            calibration says so (`emvs.depth.precision`); else None.
    """

    method: str
    depth_m: Float32s
    confidence: Float32s
    mask: Mask
    argmax: NDArray[np.int16]
    rho: Float32s
    t_us: int
    T_world_rv: NDArray[np.float64]
    camera: Camera
    reliability: Float32s | None = None
    scatter_px: Float32s | None = None
    error_m: Float32s | None = None

    @property
    def points(self) -> int:
        """Number of pixels with depth."""
        return int(np.count_nonzero(self.mask))

    def __repr__(self) -> str:
        size = f"{self.camera.width_px} x {self.camera.height_px} px"
        if not self.points:
            return f"DepthMap({self.method!r}, {size}, no points)"
        depth_m = self.depth_m[self.mask]
        span = f"{depth_m.min():.3g} to {depth_m.max():.3g} m"
        return f"DepthMap({self.method!r}, {size}, {self.points} points, {span})"


def extract(
    method: str,
    maximum: Maximum,
    view: ReferenceView,
    config: MapperConfig,
    sharpest: Maximum | None = None,
) -> DepthMap:
    """Turns one method's maximum into its depth map.

    Where there is a `sharpest`, the maximum of a focus measure, it says where the depth is; votes
    still say how confident it is.
    """
    mask = confidence_mask(maximum.value, config)
    where = maximum if sharpest is None else sharpest
    position = where.position() if config.refines else where.plane.astype(np.float32)
    position = masked_median(position, mask, config.median_px)
    return DepthMap(
        method=method,
        depth_m=np.reciprocal(inverse_depth_at(view.rho, position)),
        confidence=maximum.value,
        mask=without_border(mask, config.border_px),
        argmax=where.plane,
        rho=view.rho,
        t_us=view.t_us,
        T_world_rv=view.T_world_rv,
        camera=view.camera,
        reliability=prominence(maximum.value, config),
    )


def confidence_mask(confidence: Float32s, config: MapperConfig) -> Mask:
    """Keeps pixels that stand out: confidence above its Gaussian-weighted surroundings by C."""
    grey = eight_bits(confidence, config.max_confidence)
    if config.is_mcemvs:
        grey[0, 0] = 0  # where the authors' program writes its maximum
    # An empty neighbourhood exceeds its mean by a negative C, but no ray passes there.
    return (confidence > 0) & above_mean(grey, config.threshold_kernel_px, config.threshold_c)


def above_mean(grey: NDArray[np.uint8], kernel_px: int, c: float) -> Mask:
    """(H, W) bool, where a pixel exceeds the Gaussian-weighted mean around it by `c` of 255."""
    method, kind = cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY
    return cv2.adaptiveThreshold(grey, 1, method, kind, kernel_px, -c) > 0


def prominence(confidence: Float32s, config: MapperConfig) -> Float32s:
    """By how much of 255 a confidence exceeds its surroundings: what `confidence_mask` asks for.

    (H, W) float32, not rounded; 0 where no ray passes.
    """
    grey = eight_bits(confidence, config.max_confidence).astype(np.float32)
    size = (config.threshold_kernel_px, config.threshold_kernel_px)
    around = cv2.GaussianBlur(grey, size, 0, borderType=cv2.BORDER_REPLICATE)
    return np.where(confidence > 0, grey - around, np.float32(0))


def eight_bits(confidence: Float32s, max_confidence: float) -> NDArray[np.uint8]:
    """Scales confidence to 0..255 by its maximum, or by `max_confidence` where that is larger.

    A fixed scale keeps a window with few events from promoting its noise; values above it are not
    cut off, for a plateau at 255 would lose its edges to the adaptive threshold.
    """
    top = max(max_confidence, float(confidence.max()))
    if top <= 0:
        return np.zeros(confidence.shape, np.uint8)
    grey: NDArray[np.uint8] = np.rint(confidence * np.float32(255 / top)).astype(np.uint8)
    return grey


def masked_median(values: Float32s, mask: Mask, kernel_px: int) -> Float32s:
    """Replaces masked pixels by the lower median of the masked pixels around them.

    The window of `kernel_px` squared, odd, is cut off at the image's edge.
    """
    out = values.copy()
    patch = np.empty((len(values), kernel_px * kernel_px + 1), np.float32)
    in_threads(
        neighbours_kernels.masked_median, len(values), values, mask, kernel_px // 2, patch, out
    )
    return out


def without_border(mask: Mask, border_px: int) -> Mask:
    """The mask without a rim of `border_px` pixels."""
    inner = np.zeros_like(mask)
    if border_px < min(mask.shape):
        rows, columns = (slice(border_px, size - border_px) for size in mask.shape)
        inner[rows, columns] = mask[rows, columns]
    return inner


def union(method: str, maps: Sequence[DepthMap]) -> DepthMap:
    """Takes each pixel from the most confident camera among those that report it.

    Where none reports it, the mask stays empty, and the values are the most confident camera's. Of
    equally confident cameras the first is taken.
    """
    masks = np.stack([m.mask for m in maps])
    confidence = np.stack([m.confidence for m in maps])
    reported = np.where(masks | ~masks.any(axis=0), confidence, -1)
    camera = reported.argmax(axis=0)[None]
    return replace(
        maps[0],
        method=method,
        depth_m=_pick([m.depth_m for m in maps], camera),
        confidence=_pick([m.confidence for m in maps], camera),
        reliability=_pick_known([m.reliability for m in maps], camera),
        error_m=_pick_known([m.error_m for m in maps], camera),
        argmax=_pick([m.argmax for m in maps], camera),
        mask=np.logical_or.reduce(masks),
    )


def _pick_known(images: Sequence[Float32s | None], camera: NDArray[np.intp]) -> Float32s | None:
    known = [image for image in images if image is not None]
    return _pick(known, camera) if len(known) == len(images) else None


def _pick(images: Sequence[NDArray[Value]], camera: NDArray[np.intp]) -> NDArray[Value]:
    picked: NDArray[Value] = np.take_along_axis(np.stack(images), camera, axis=0)[0]
    return picked
