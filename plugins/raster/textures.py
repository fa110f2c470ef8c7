"""Textures as kernels read them: one channel each, in levels, with a border of one texel.

A level is half as wide and high as the one before. What lies in the border is what a neighbour
would be: the other end of a picture that repeats, the next side of a cube.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.sim.rendering.pixel_kernels import LUMA

Array = NDArray[np.float64]
FULL_SCALE = 65535
"""The texel that means 1."""
_SRGB = 2  # mjCOLORSPACE_SRGB
FLAT, CUBE, SKY = range(3)
"""Kinds of textures, as MuJoCo numbers them."""
# Of each side of a cube: the direction of its middle, of its columns and of its rows.
_SIDES = np.array(
    [
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]], [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 1]], [[0, -1, 0], [1, 0, 0], [0, 0, -1]],
        [[0, 0, 1], [1, 0, 0], [0, -1, 0]], [[0, 0, -1], [-1, 0, 0], [0, -1, 0]],
    ],
    float,
)  # fmt: skip
_MOST_LEVELS = 16


class Texels(NamedTuple):
    """All channels of a scene's textures.

    Attributes:
        values: (N,) uint16, level after level, side after side, row after row.
        levels: (T, 16, 3) int64, where a level begins, its width and its height, without border.
        shapes: (T, 2) int64, number of levels; 1 for a cube, else 0.
    """

    values: NDArray[np.uint16]
    levels: NDArray[np.int64]
    shapes: NDArray[np.int64]


class TextureTable:
    """Collects the channels that surfaces need, each once."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._made: dict[tuple[int, tuple[float, ...]], int] = {}
        self._values: list[NDArray[np.uint16]] = []
        self._levels: list[NDArray[np.int64]] = []
        self._shapes: list[tuple[int, int]] = []
        self._size = 0

    def kind(self, texture: int) -> int:
        """Whether it is flat, a cube or the sky."""
        return int(self._model.tex_type[texture])

    def grey(self, texture: int) -> bool:
        """Whether it has no colour."""
        pixels = self._pixels(texture)
        return bool((pixels[..., :1] == pixels[..., 1:]).all())

    def luma(self, texture: int, hue: Array) -> int:
        """The number of the luma that a texture has in light of a hue (3,), of luma 1."""
        return self._channel(texture, tuple((np.array(LUMA) * hue).tolist()))

    def colours(self, texture: int) -> int:
        """The number of the first of three channels: red, green, blue."""
        first = [self._channel(texture, tuple(row)) for row in np.eye(3).tolist()]
        return first[0]

    def opacity(self, texture: int) -> int:
        """The number of a texture's opacity; -1 where it is solid."""
        pixels = self._stored(texture)
        clear = pixels.shape[2] == 4 and bool((pixels[..., 3] < 255).any())
        return self._channel(texture, (0.0, 0.0, 0.0, 1.0)) if clear else -1

    def texels(self) -> Texels:
        """All of them."""
        empty = np.zeros((0, _MOST_LEVELS, 3), np.int64)
        return Texels(
            np.concatenate([*self._values, np.zeros(2, np.uint16)]),
            np.array(self._levels) if self._levels else empty,
            np.array(self._shapes, np.int64).reshape(-1, 2),
        )

    def _channel(self, texture: int, weights: tuple[float, ...]) -> int:
        key = texture, weights
        if key not in self._made:
            self._made[key] = len(self._levels)
            pixels = self._pixels(texture)
            if len(weights) == 4:
                pixels, weights = self._stored(texture)[..., 3:].repeat(3, axis=2), (1.0, 0.0, 0.0)
            self._add(pixels, weights, self.kind(texture) != FLAT)
        return self._made[key]

    def _pixels(self, texture: int) -> NDArray[Any]:
        """(H, W, 3) colours, linear."""
        pixels = self._stored(texture)[..., :3]
        if self._model.tex_colorspace[texture] == _SRGB and self.kind(texture) == FLAT:
            return _linear(pixels)
        return pixels

    def _stored(self, texture: int) -> NDArray[np.uint8]:
        """(H, W, 3 or 4) as the model holds them; white where MuJoCo's renderer takes them not."""
        model = self._model
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        channels, first = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        if channels not in (3, 4):
            return np.full((1, 1, 3), 255, np.uint8)
        flat = model.tex_data[first : first + height * width * channels]
        pixels: NDArray[np.uint8] = flat.reshape(height, width, channels)
        return pixels

    def _add(self, pixels: NDArray[Any], weights: tuple[float, ...], cube: bool) -> None:
        red, green, blue = weights
        full = 1.0 if pixels.dtype == np.float64 else 255.0
        values = (red * pixels[..., 0] + green * pixels[..., 1] + blue * pixels[..., 2]) / full
        width = values.shape[1]
        sides = values.reshape(-1, width, width) if cube else values[None]
        if cube and len(sides) == 1:
            sides = np.repeat(sides, 6, axis=0)
        table = np.zeros((_MOST_LEVELS, 3), np.int64)
        count = 0
        for level in _halved(sides):
            table[count] = self._size, level.shape[2], level.shape[1]
            padded = _beside(level) if cube else np.pad(level, ((0, 0), (1, 1), (1, 1)), "wrap")
            self._values.append(
                np.rint(np.clip(padded, 0, 1) * FULL_SCALE).astype(np.uint16).ravel()
            )
            self._size += padded.size
            count += 1
        self._levels.append(table)
        self._shapes.append((count, int(cube)))


def _linear(pixels: NDArray[np.uint8]) -> Array:
    """Light of values in sRGB."""
    value = np.arange(256) / 255
    table = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in value.tolist()]
    found: Array = np.rint(np.array(table) * 1e6)[pixels] / 1e6
    return found


def _halved(sides: Array) -> Iterator[Array]:
    """Pictures (N, H, W) and their smaller copies, down to one texel."""
    yield sides
    while max(sides.shape[1:]) > 1:
        for axis in (1, 2):
            sides = _halved_along(sides, axis)
        yield sides


def _halved_along(sides: Array, axis: int) -> Array:
    """Half as many along an axis, between the old ones where their number is odd."""
    before = sides.shape[axis]
    after = max(1, before // 2)
    at = (np.arange(after) + 0.5) * (before / after) - 0.5
    low = np.floor(at).astype(int)
    share = (at - low).reshape([-1 if k == axis else 1 for k in range(3)])
    high = np.minimum(low + 1, before - 1)
    first, second = sides.take(low, axis), sides.take(high, axis)
    return np.asarray(first + share * (second - first))


def _beside(sides: Array) -> Array:
    """The six sides (6, N, N) of a cube with a border: what the neighbouring sides have there."""
    size = sides.shape[1]
    padded = np.pad(sides, ((0, 0), (1, 1), (1, 1)), "edge")
    at = (np.arange(size + 2) - 0.5) / size * 2 - 1
    for side in range(6):
        rows, columns = np.divmod(np.arange((size + 2) ** 2), size + 2)
        beyond = (rows % (size + 1) == 0) != (columns % (size + 1) == 0)
        rows, columns = rows[beyond], columns[beyond]
        middle, along, down = _SIDES[side]
        ray = middle + at[columns, None] * along + at[rows, None] * down
        padded[side, rows, columns] = sides[_texel_of(ray, size)]
    _fill_corners(padded)
    return padded


def _texel_of(ray: Array, size: int) -> tuple[NDArray[np.intp], ...]:
    """Side, row and column that directions (N, 3) meet."""
    axis = np.abs(ray).argmax(1)
    ahead = np.take_along_axis(ray, axis[:, None], 1)
    side = 2 * axis + (ahead[:, 0] < 0)
    _, along, down = _SIDES[side].transpose(1, 0, 2)
    scaled = ray / np.abs(ahead)
    places = ((scaled * part).sum(1) for part in (down, along))
    row, column = (np.clip(((p + 1) / 2 * size).astype(int), 0, size - 1) for p in places)
    return side, row, column


def _fill_corners(padded: Array) -> None:
    """Where three sides meet, the mean of the three texels."""
    last = padded.shape[1] - 1
    for row, inner_row in ((0, 1), (last, last - 1)):
        for column, inner_column in ((0, 1), (last, last - 1)):
            beside = padded[:, row, inner_column] + padded[:, inner_row, column]
            padded[:, row, column] = (beside + padded[:, inner_row, inner_column]) / 3
