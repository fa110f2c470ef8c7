"""Where along each ray one volume is most in focus, as its planes pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emvs import focus, focus_kernels
from emvs.running import AS_IT_IS, Maximum, RunningMaxima

Floats = NDArray[np.float32]

_STRIPS = 64  # enough for any number of threads to share them evenly


class FocusPeak:
    """First maximum over planes of a focus measure of one volume; 18 bytes remain per pixel.

    Args:
        width_px: columns.
        height_px: rows.
        measure: focus measure, by its name in `emvs.focus.MEASURES`.
        sigma_px: its scale, px.
        planes: how many will pass; needed only where there are more than 32767.
    """

    def __init__(
        self, width_px: int, height_px: int, measure: str, sigma_px: float, planes: int = 0
    ) -> None:
        self._measure, self._sigma_px = focus.measure(measure), sigma_px
        self._window = _Window(height_px, width_px, sigma_px) if measure == "variance" else None
        self._maxima = RunningMaxima(
            (AS_IT_IS,), width_px, height_px, planes=planes, lowest=-np.inf
        )

    def take(self, plane: Floats) -> None:
        """Takes in the next (H, W) plane."""
        if self._window is None:
            self._maxima.fold(self._measure(plane, self._sigma_px).reshape(1, 1, -1), 1)
            return
        state = (one[0] for one in self._maxima.arrays)
        focus_kernels.fold_variance(plane, self._maxima.planes, *self._window.arrays, *state)
        self._maxima.planes += 1

    def maximum(self) -> Maximum:
        """The maximum over all planes so far."""
        return self._maxima.of(0)


class _Window:
    """What the compiled variance needs beside the votes: weights, mirrored indices, room."""

    def __init__(self, height_px: int, width_px: int, sigma_px: float) -> None:
        weight = focus.half_window(sigma_px)
        radius = len(weight) - 1
        strips = min(height_px, _STRIPS)
        self.arrays = (
            weight,
            _mirrored(height_px, radius),
            _mirrored(width_px, radius),
            np.empty((strips, 2, width_px + 2 * radius), np.float32),
            np.empty((strips, 2, width_px), np.float32),
        )


def _mirrored(size: int, radius: int) -> NDArray[np.int64]:
    """Indices -radius .. size + radius - 1 of a row mirrored at its ends, which stand once."""
    period = max(2 * (size - 1), 1)
    place = np.arange(-radius, size + radius) % period
    return np.minimum(place, period - place)
