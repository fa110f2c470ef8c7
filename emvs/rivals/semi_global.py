"""Semi-global matching of two rectified images: OpenCV's, with the settings of the comparisons.

H. Hirschmüller, *Stereo Processing by Semiglobal Matching and Mutual Information*, TPAMI 2008, in
the block-wise form of OpenCV's StereoSGBM. Block, penalties and uniqueness are those with which the
authors of ESVO (TRO 2021) ran it on time surfaces.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from emvs.planes import inverse_depth_at
from emvs.rivals.parameters import SemiGlobal
from emvs.rivals.rectify import Rectified
from emvs.view import ReferenceView

Image = NDArray[np.float32]

_SUBPIXELS = 16  # StereoSGBM gives sixteenths of a pixel
_MULTIPLE = 16  # and searches a multiple of so many disparities
_WORTH_MATCHING_PX = 1.0


def disparity_range_px(stereo: Rectified, view: ReferenceView) -> tuple[int, int]:
    """Smallest and largest disparity of the view's planes, whole px.

    Raises:
        InputError: a range that a pixel of disparity cannot resolve.
    """
    scale = stereo.camera.fx_px * stereo.baseline_m
    ends = np.array([0, len(view.rho) - 1], np.float32)
    far, near = np.sort(scale * inverse_depth_at(view.rho, ends).astype(np.float64))
    if near - far < _WORTH_MATCHING_PX:
        raise InputError(
            f"depths {scale / near:.3g}..{scale / far:.3g} m span {near - far:.2f} px of disparity "
            f"on a baseline of {stereo.baseline_m:g} m: stereo matching needs at least "
            f"{_WORTH_MATCHING_PX:g} px; choose a nearer min_depth_m or a method that fuses volumes"
        )
    return int(np.floor(far)), int(np.ceil(near))


def match(
    left: NDArray[np.uint8], right: NDArray[np.uint8], range_px: tuple[int, int],
    settings: SemiGlobal,
) -> Image:  # fmt: skip
    """Matches row-aligned images.

    Args:
        left: (H, W) uint8.
        right: (H, W) uint8.
        range_px: smallest and largest disparity, px.
        settings: of the matcher.

    Returns:
        (H, W) float32 disparities of the left image, px; NaN for none.
    """
    low, high = range_px
    count = -(-(high - low + 1) // _MULTIPLE) * _MULTIPLE
    area = settings.block_px**2
    matcher = cv2.StereoSGBM.create(
        minDisparity=low,
        numDisparities=count,
        blockSize=settings.block_px,
        P1=settings.p1_per_px * area,
        P2=settings.p2_per_px * area,
        disp12MaxDiff=settings.left_right_px,
        uniquenessRatio=settings.uniqueness_percent,
    )
    # Without a rim it would report nothing in the first low + count columns.
    rim = low + count
    wide = (cv2.copyMakeBorder(i, 0, 0, rim, 0, cv2.BORDER_REPLICATE) for i in (left, right))
    sixteenths = np.asarray(matcher.compute(*wide))[:, rim:]
    disparity_px = sixteenths.astype(np.float32) / _SUBPIXELS
    found = (sixteenths >= low * _SUBPIXELS) & (disparity_px <= high) & (disparity_px > 0)
    # The rim holds no light: what has its partner there has none.
    partner_px = np.arange(left.shape[1]) - disparity_px
    found &= partner_px >= settings.block_px // 2
    return np.where(found, disparity_px, np.float32(np.nan))
