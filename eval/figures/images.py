"""Pictures of a window, pixel for pixel, as palette images: frame, events, depth, error."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from eventsweep.emvs.errors import InputError
from eventsweep.eval.figures.colormaps import BLANK, Scale, grey_palette, nice_above

FloatImage = NDArray[np.floating]
MaskImage = NDArray[np.bool_]
# Divide the blank, 255, too: no confidence at all stays blank. Noise does not compress: of a large
# picture 17 greys are half the file of 51, and shown smaller than it is the eye mixes them.
_CONFIDENCE_STEP, _COARSE_STEP = np.uint8(5), np.uint8(15)
_LARGE_PX = 500_000


@dataclass(frozen=True, slots=True)
class IndexedImage:
    """An image whose pixels point into a table of colours.

    Attributes:
        index: (H, W) uint8 row of the palette.
        palette: (K, 4) uint8 red, green, blue, opacity; K <= 256.
    """

    index: NDArray[np.uint8]
    palette: NDArray[np.uint8]

    def __post_init__(self) -> None:
        if self.index.size and int(self.index.max()) >= len(self.palette):
            raise InputError(
                f"colour index {self.index.max()} in a palette of {len(self.palette)}: extend it"
            )

    def rgba(self) -> NDArray[np.uint8]:
        """(H, W, 4) colours."""
        return self.palette[self.index]

    def enlarged(self, factor: int) -> IndexedImage:
        """Every pixel becomes a square of `factor` by `factor` pixels."""
        index = np.repeat(np.repeat(self.index, factor, axis=0), factor, axis=1)
        return IndexedImage(index, self.palette)

    def png(self) -> bytes:
        """Encodes the image as an 8-bit palette PNG; the same image gives the same bytes."""
        image = Image.fromarray(self.index).convert("P")
        image.putpalette(self.palette.tobytes(), rawmode="RGBA")
        stream = io.BytesIO()
        image.save(stream, format="PNG")
        return stream.getvalue()

    def data_uri(self) -> str:
        """The PNG as an address that a page can hold inline."""
        return data_uri("image/png", self.png())


def data_uri(kind: str, content: bytes) -> str:
    """A file's content as an address that a page can hold inline; `kind` such as image/png."""
    return f"data:{kind};base64,{b64encode(content).decode('ascii')}"


def frame_image(intensity: NDArray[np.uint8]) -> IndexedImage:
    """Draws (H, W) intensity, 0..255, from its darkest (black) to its brightest (white)."""
    black, white = (float(value) for value in np.percentile(intensity, (0.2, 99.8)))
    grey = np.clip((np.arange(256) - black) / max(1.0, white - black), 0, 1)
    return IndexedImage(np.rint(255 * grey).astype(np.uint8)[intensity], grey_palette())


def photo_image(image: NDArray[np.uint8]) -> IndexedImage:
    """Draws (H, W) linear values as a screen shows them: nothing stretched, white stays white."""
    shown = np.rint(255 * (np.arange(256) / 255) ** (1 / 2.2)).astype(np.uint8)
    return IndexedImage(shown[image], grey_palette())


def events_image(
    brighter: NDArray[np.integer], darker: NDArray[np.integer], scale: Scale
) -> IndexedImage:
    """Draws (H, W) counts of events per pixel; the more frequent polarity gives the colour."""
    either = np.maximum(brighter, darker).astype(np.float64)
    signed = np.where(brighter >= darker, either, -either)
    return IndexedImage(scale.index(signed, either > 0), scale.palette)


def depth_image(
    depth_m: FloatImage, mask: MaskImage, scale: Scale, point_px: int = 1
) -> IndexedImage:
    """Draws (H, W) z-depth in m, even in inverse depth, on white where the mask is off.

    Points are drawn `point_px` wide; where they overlap the nearest wins.
    """
    rho = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=mask)
    return IndexedImage(_dilated(scale.index(rho, mask), point_px), scale.palette)


def error_image(
    depth_m: FloatImage, mask: MaskImage, truth_m: FloatImage, truth_scored: MaskImage,
    scale: Scale, point_px: int = 1,
) -> IndexedImage:  # fmt: skip
    """Draws |e - g| in cm where both are valid, transparent elsewhere; the largest error wins."""
    error_cm, both = error_of(depth_m, mask, truth_m, truth_scored)
    return IndexedImage(_dilated(scale.index(error_cm, both), point_px), scale.palette)


def expected_error_image(
    error_m: FloatImage, mask: MaskImage, scale: Scale, point_px: int = 1
) -> IndexedImage:
    """Draws (H, W) the error that a method expects of its depth, on white where there is none."""
    known = mask & np.isfinite(error_m)
    error_cm = np.where(known, 100 * error_m, 0.0)
    return IndexedImage(_dilated(scale.index(error_cm, known), point_px), scale.palette)


def categories_image(
    category: NDArray[np.uint8], colours: Sequence[str], point_px: int = 1
) -> IndexedImage:
    """Draws (H, W) categories, each in its colour; 0 is none and transparent, 1 the first."""
    palette = np.zeros((BLANK + 1, 4), np.uint8)
    for k, colour in enumerate(colours):
        palette[k] = [*bytes.fromhex(colour.removeprefix("#")), 255]
    index = np.where(category > 0, category - np.uint8(1), np.uint8(BLANK))
    return IndexedImage(_dilated(index, point_px), palette)


def every_nth(image: IndexedImage, n: int) -> IndexedImage:
    """The middle of every `n` by `n` pixels."""
    return IndexedImage(image.index[n // 2 :: n, n // 2 :: n], image.palette)


def error_of(
    depth_m: FloatImage, mask: MaskImage, truth_m: FloatImage, truth_scored: MaskImage
) -> tuple[FloatImage, MaskImage]:
    """(H, W) |e - g| in cm, and where both are valid."""
    both = mask & truth_scored
    error_cm = np.zeros(depth_m.shape)
    np.subtract(depth_m, truth_m, out=error_cm, where=both, casting="same_kind")
    return 100 * np.abs(error_cm), both


def confidence_image(confidence: FloatImage, scale: Scale) -> IndexedImage:
    """Draws (H, W) confidence, dark on white, in steps too small to see that halve the file."""
    index = scale.index(confidence, np.isfinite(confidence))
    step = _COARSE_STEP if index.size > _LARGE_PX else _CONFIDENCE_STEP
    return IndexedImage(index - index % step, scale.palette)


def behind_image(intensity: NDArray[np.uint8]) -> IndexedImage:
    """The frame to look at faintly through an error image: small pictures whole, others halved."""
    image = frame_image(intensity)
    if intensity.size <= _LARGE_PX:
        return image
    height, width = (side // 2 for side in intensity.shape)
    smaller = cv2.resize(image.index, (width, height), interpolation=cv2.INTER_AREA)
    return IndexedImage(np.asarray(smaller, np.uint8), image.palette)


def error_cap_cm(errors_cm: NDArray[np.floating]) -> float:
    """The round number that three of four errors stay below."""
    if not errors_cm.size:
        return 10.0
    return nice_above(max(float(np.percentile(errors_cm, 75)), 1e-3))


def point_size_px(width_px: int) -> int:
    """How wide to draw points, so that single ones are seen when a picture is 400 px wide."""
    return 2 * max(1, round(width_px / 600)) + 1


def enlargement(width_px: int) -> int:
    """By how much to enlarge a picture, so that a browser shows pixels as even squares."""
    return max(1, round(800 / width_px))


def _dilated(index: NDArray[np.uint8], point_px: int) -> NDArray[np.uint8]:
    """Widens points; the blank gives way, a point's own pixel keeps its colour."""
    if point_px <= 1:
        return index
    kernel = np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (point_px, point_px)))
    # Rank the blank lowest: 0 is blank, 1..255 the levels.
    wide = np.asarray(cv2.dilate(index + np.uint8(1), kernel), np.uint8) - np.uint8(1)
    return np.where(index == BLANK, wide, index).astype(np.uint8)
