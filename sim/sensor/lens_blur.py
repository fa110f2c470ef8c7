"""Blur of the lens, before the pixels: a Gaussian point spread function on linear light."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Light = NDArray[np.float32]


def blurred(light: Light, sigma_px: float) -> Light:
    """(H, W) light through a lens whose point spread function has this standard deviation, px.

    Beyond the edges the picture is mirrored, so that no light is lost. A `sigma_px` of 0 returns
    the light as it is.
    """
    if not sigma_px:
        return light
    # Of float pictures, cv2 takes the Gaussian to four standard deviations.
    border = cv2.BORDER_REFLECT
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma_px, borderType=border), np.float32)
