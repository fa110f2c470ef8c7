"""What the network sees of a pixel: the votes around it, and what the extraction by focus says.

Depth is measured in disparity of the rig; samples along the ray follow each other every half pixel
of it, or every plane where planes are sparser. Beyond three quarters of a pixel, hardly seen in
training, half planes are interpolated. So the same network serves other sensors, baselines and
numbers of planes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.depth_map import without_border
from eventsweep.emvs.depth.focus import FocusEstimate, disparity_at
from eventsweep.emvs.depth.kept_votes import LANES, KeptVotes
from eventsweep.emvs.dsi.fusion import Fusion, fuse
from eventsweep.emvs.dsi.maxima import InFocus, Maximum
from eventsweep.emvs.utils.vectors_kernels import aligned
from eventsweep.plugins.learned.networks import inputs_kernels
from eventsweep.plugins.learned.networks.network import CHANNELS, CUES, DEPTH, SIDE_PX

BATCH = 128
"""Pixels whose patches are in memory at a time."""
_SAMPLE_PX, _COARSEST_PX = 0.5, 0.75
_FARTHEST = 2 * DEPTH
_CUBIC = np.array([-1, 9, 9, -1]) / 16

Float32s = NDArray[np.float32]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Candidates:
    """The pixels of a window that the network judges.

    Attributes:
        rows: (M,) int64.
        columns: (M,) int64.
        centres: (M,) int64, the plane in focus: the middle of each patch.
        strides: (M,) int64, planes from one sample of it to the next.
        halved: (M,) bool, where another sample is interpolated between every two of them.
        sample_px: (M,) float32 disparity between two samples, px.
        focus_px: (M,) float32 disparity that the extraction by focus reports, px.
        cues: (M, len(CUES)) float32.
    """

    rows: Indices
    columns: Indices
    centres: Indices
    strides: Indices
    halved: NDArray[np.bool_]
    sample_px: Float32s
    focus_px: Float32s
    cues: Float32s

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, part: slice | Indices) -> Candidates:
        return Candidates(*(getattr(self, name)[part] for name in self.__dataclass_fields__))


def candidates(
    votes: Maximum,
    focus: InFocus,
    estimate: FocusEstimate,
    disparity_px: NDArray[np.floating],
    border_px: int,
) -> Candidates:
    """Lists the pixels to judge, in the order of rows, and what is known of each.

    `disparity_px` is (N,), of each plane, falling; `border_px` a rim that reports no depth.
    """
    rim = max(border_px, SIDE_PX // 2)
    rows, columns = np.nonzero(without_border(estimate.candidate, rim))
    at = rows, columns
    centres = focus.maximum.plane[at].astype(np.int64)
    step_px = np.abs(np.gradient(np.asarray(disparity_px, np.float64)))[centres]
    strides = np.maximum(np.rint(_SAMPLE_PX / step_px), 1).astype(np.int64)
    halved = step_px > _COARSEST_PX
    per_sample = np.where(halved, 0.5, strides)  # planes
    sample_px = (per_sample * step_px).astype(np.float32)
    fitted = estimate.position[at]
    focus_px = disparity_at(fitted, disparity_px)

    def samples(position: Float32s) -> Float32s:
        distance = (position - centres) / per_sample
        return np.clip(distance, -_FARTHEST, _FARTHEST).astype(np.float32) / np.float32(4)

    cameras = [samples(peak.position_at(*at, gaussian=True)) for peak in focus.camera_maxima]
    cues = (
        np.log2(sample_px),
        samples(fitted),
        samples(focus.maximum.position_at(*at, gaussian=True)),
        samples(votes.position_at(*at)),
        *_of_cameras(cameras, len(rows)),
        *(getattr(estimate, name)[at] for name in CUES[6:11]),
        np.log2(1 + votes.value[at]) / 8,
        np.log2(np.maximum(focus_px, np.float32(1e-3))) / 4,
    )
    table = np.stack(cues, axis=1).astype(np.float32)
    return Candidates(rows, columns, centres, strides, halved, sample_px, focus_px, table)


def _of_cameras(cameras: Sequence[Float32s], pixels: int) -> tuple[Float32s, Float32s]:
    """Where the first camera's rays are in focus, and the mean of the others; 0 where not asked."""
    nothing = np.zeros(pixels, np.float32)
    first = cameras[0] if cameras else nothing
    others = np.stack(cameras[1:]).mean(axis=0) if len(cameras) > 1 else first
    return first, np.asarray(others, np.float32)


def channels(kept: KeptVotes, fusion: Fusion, chosen: Candidates) -> Float32s:
    """The votes around some candidates, a few thousand at most, as the network reads them.

    Returns:
        (B, 3, SIDE_PX, SIDE_PX, DEPTH + 2, LANES) float32, as shares of the fused volume's largest
            value in the patch, and nothing at both ends of each ray; candidate m is lane m % LANES
            of block m // LANES. The channels are `networks.network.CHANNELS`; a single camera
            is all three.
    """
    fused, cameras = fused_patches(fusion, _sampled(kept, chosen))
    shape = len(fused), len(CHANNELS), SIDE_PX, SIDE_PX, DEPTH + 2, LANES
    shares: Float32s = aligned(math.prod(shape)).reshape(shape)
    inputs_kernels.shares(fused, cameras, shares)
    return shares


def fused_patches(fusion: Fusion, cameras: Float32s) -> tuple[Float32s, Float32s]:
    """Patches of all cameras (C, B, depth, side, side, LANES), fused, and of those that take part.

    Both are float32, the fused ones without C.
    """
    alone = fusion.camera
    if alone is not None:
        cameras = cameras[alone : alone + 1]
        return cameras[0], cameras
    count, blocks, *cells = cameras.shape
    rows = cameras.reshape(count, 1, blocks, math.prod(cells))
    return fuse(fusion, rows).reshape(blocks, *cells), cameras


def _sampled(kept: KeptVotes, chosen: Candidates) -> Float32s:
    """The votes of every camera at the samples: of planes, or of half planes where they are sparse.

    Each camera's votes are interpolated, and fused afterwards: so does the mapper with planes.
    """
    where = chosen.rows, chosen.columns, chosen.centres, chosen.strides
    if not chosen.halved.any():
        return kept.patches(*where, DEPTH, SIDE_PX)
    few = kept.patches(*where, _HALVES.shape[1], SIDE_PX)
    cameras, blocks, depth, *cells = few.shape
    between = np.matmul(_HALVES, few.reshape(cameras, blocks, depth, -1))
    finer: Float32s = np.maximum(between, 0).reshape(cameras, blocks, DEPTH, *cells)
    if chosen.halved.all():
        return finer
    lanes = np.zeros(blocks * LANES, np.bool_)
    lanes[: len(chosen)] = chosen.halved
    here = lanes.reshape(1, blocks, 1, 1, 1, LANES)
    return np.where(here, finer, kept.patches(*where, DEPTH, SIDE_PX))


def _halves() -> Float32s:
    """(DEPTH, planes) weights of the planes around in each sample; every other one lies between.

    Cubic, by the two planes on either side (Catmull and Rom).
    """
    reach = DEPTH // 4 + 1  # planes to either side: one more than samples reach
    weights = np.zeros((DEPTH, 2 * reach + 1), np.float32)
    for sample in range(DEPTH):
        before, between = divmod(sample - DEPTH // 2 + 2 * reach, 2)
        if between:
            weights[sample, before - 1 : before + 3] = _CUBIC
        else:
            weights[sample, before] = 1
    return weights


_HALVES = _halves()


def as_patches(rays: Float32s, count: int) -> Float32s:
    """The first patches of what `channels` returns: (count, 3, DEPTH, SIDE_PX, SIDE_PX)."""
    pixels = np.moveaxis(rays[..., 1:-1, :], -1, 1)
    return np.moveaxis(pixels.reshape(-1, *pixels.shape[2:])[:count], -1, 2)
