"""From an image's values to linear light: one intensity per pixel, full scale 1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.video.images import Image
from eventsweep.sim.config import Encoding, VideoConfig

# Luminance of linear red, green and blue with BT.709's primaries, which sRGB shares.
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_DEFAULT_GAMMA = 2.2


def _srgb(value: NDArray[np.float64]) -> NDArray[np.float64]:
    """IEC 61966-2-1."""
    bent = ((np.maximum(value, 0) + 0.055) / 1.055) ** 2.4
    return np.where(value <= 0.04045, value / 12.92, bent)


class Light:
    """Turns images of one kind, uint8, uint16 or float32, into light.

    Raises:
        InputError: logarithms in whole numbers.
    """

    def __init__(self, kind: np.dtype[Any], video: VideoConfig) -> None:
        whole = kind.kind == "u"
        self.encoding: Encoding = video.encoding or ("srgb" if whole else "linear")
        if self.encoding == "log" and whole:
            raise InputError(
                f"encoding log of {kind} images: integers cannot hold logarithms; needs float "
                "images with ln of intensity"
            )
        gamma = video.gamma or _DEFAULT_GAMMA
        decoders: dict[Encoding, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
            "srgb": _srgb, "gamma": lambda v: v**gamma, "linear": lambda v: v, "log": np.exp,
        }  # fmt: skip
        self._decode = decoders[self.encoding]
        self.full_scale = video.full_scale or (float(np.iinfo(kind).max) if whole else 1.0)
        self.said = f"{self.encoding} {gamma:g}" if self.encoding == "gamma" else self.encoding
        if whole:
            table = self._decode(np.arange(np.iinfo(kind).max + 1) / self.full_scale)
            self._grey, *self._colours = [
                (weight * table).astype(np.float32) for weight in (1.0, *_LUMINANCE)
            ]

    def __call__(self, image: Image) -> NDArray[np.float32]:
        """(H, W) linear intensity of an image: of colours their luminance."""
        if image.dtype.kind == "f":
            decoded = self._decode(np.divide(image, self.full_scale, dtype=np.float64))
            grey = decoded if image.ndim == 2 else decoded @ _LUMINANCE
            return np.asarray(grey, np.float32)
        if image.ndim == 2:
            return _looked_up(image, self._grey)
        red, green, blue = (
            _looked_up(image[..., k], table) for k, table in enumerate(self._colours)
        )
        red += green
        red += blue
        return red


def _looked_up(plane: Image, table: NDArray[np.float32]) -> NDArray[np.float32]:
    if plane.dtype == np.uint8:  # faster than NumPy's look-up
        return np.asarray(cv2.LUT(np.ascontiguousarray(plane), table))
    return table[plane]
