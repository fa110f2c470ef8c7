"""Palette images and their PNG encoding: a colour per value, and nothing lost."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from emvs.errors import InputError


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
        return "data:image/png;base64," + base64.b64encode(self.png()).decode("ascii")
