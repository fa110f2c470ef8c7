"""Compiled loops over a frame's light: how bright, dark and steep it gets around a pixel."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


@numba.njit(cache=True, nogil=True)
def cell_range(
    light: NDArray[np.float32],
    grid: int,
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    slope: NDArray[np.float32],
) -> None:
    """Fills least and greatest light, and the greatest slope, of each pixel's cell.

    A cell holds the G x G nodes from a pixel's centre on, down and to the right.

    Args:
        light: (G (H - 1) + 1, G (W - 1) + 1) light on the grid.
        grid: G, nodes per pixel and axis.
        low: out, (H, W).
        high: out, (H, W).
        slope: out, (H, W), change of light per pixel of way.
    """
    rows, columns = light.shape
    height, width = low.shape
    squared = np.zeros(columns, np.float32)
    least, most, steep = np.empty((3, width), np.float32)
    for i in range(height):
        least[:], most[:], steep[:] = np.inf, -np.inf, 0.0
        for k in range(grid * i, min(grid * i + grid, rows)):
            here, below = light[k], light[min(k + 1, rows - 1)]
            for n in range(columns - 1):
                dx, dy = here[n + 1] - here[n], below[n] - here[n]
                squared[n] = dx * dx + dy * dy
            for j in range(width):
                for n in range(grid * j, min(grid * j + grid, columns)):
                    least[j] = min(least[j], here[n])
                    most[j] = max(most[j], here[n])
                    steep[j] = max(steep[j], squared[n])
        for j in range(width):
            low[i, j], high[i, j] = least[j], most[j]
            slope[i, j] = grid * np.sqrt(steep[j])


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def cell_depths(
    inverse_depth: NDArray[np.float32],
    grid: int,
    nearest: NDArray[np.float32],
    farthest: NDArray[np.float32],
) -> None:
    """Fills the greatest and the least inverse depth of each pixel's samples.

    Args:
        inverse_depth: (G H, G W), 1/m.
        grid: G, samples per pixel and axis.
        nearest: out, (H, W).
        farthest: out, (H, W).
    """
    height, width = nearest.shape
    most, least = np.empty((2, grid * width), np.float32)
    for i in range(height):
        for j in range(grid * width):
            most[j] = least[j] = inverse_depth[grid * i, j]
        for q in range(grid * i + 1, grid * (i + 1)):
            for j in range(grid * width):
                most[j] = max(most[j], inverse_depth[q, j])
                least[j] = min(least[j], inverse_depth[q, j])
        for j in range(width):
            near, far = most[grid * j], least[grid * j]
            for m in range(grid * j + 1, grid * (j + 1)):
                near, far = max(near, most[m]), min(far, least[m])
            nearest[i, j], farthest[i, j] = near, far


@numba.njit(cache=True, nogil=True)
def spread_most(values: NDArray[np.float32], before: int, behind: int) -> None:
    """Replaces each value by the greatest of its neighbourhood, in place; edges repeat.

    Args:
        values: (H, W).
        before: how many rows above and columns to the left take part.
        behind: how many below and to the right.
    """
    for i in range(len(values)):
        spread_along(values[i], before, behind)
    spread_across(values, before, behind)


@numba.njit(cache=True, nogil=True)
def spread_along(row: NDArray[np.float32], before: int, behind: int) -> None:
    """The same along one row, (W,)."""
    width = len(row)
    line = np.empty(width + before + behind, np.float32)
    for j in range(len(line)):
        line[j] = row[min(max(j - before, 0), width - 1)]
    reach, length = 1, before + behind + 1
    while reach < length:
        step = min(reach, length - reach)
        for j in range(len(line) - step):
            line[j] = max(line[j], line[j + step])
        reach += step
    for j in range(width):
        row[j] = line[j]


@numba.njit(cache=True, nogil=True)
def spread_across(values: NDArray[np.float32], before: int, behind: int) -> None:
    """The same down all columns of (H, W)."""
    height, width = values.shape
    tall = np.empty((height + before + behind, width), np.float32)
    for i in range(len(tall)):
        row = values[min(max(i - before, 0), height - 1)]
        for j in range(width):
            tall[i, j] = row[j]
    reach, length = 1, before + behind + 1
    while reach < length:
        step = min(reach, length - reach)
        for i in range(len(tall) - step):
            for j in range(width):
                tall[i, j] = max(tall[i, j], tall[i + step, j])
        reach += step
    for i in range(height):
        for j in range(width):
            values[i, j] = tall[i, j]
