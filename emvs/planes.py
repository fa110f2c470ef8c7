"""Depth planes: uniform in inverse depth or in depth, near to far."""

import numpy as np
from numpy.typing import NDArray


def inverse_depth_planes(min_depth_m: float, max_depth_m: float, count: int) -> NDArray[np.float32]:
    """Returns the planes of the sweep, near to far, with both ends of the range among them.

    Args:
        min_depth_m: depth of the first plane, m.
        max_depth_m: depth of the last plane, m.
        count: number of planes, at least 2.

    Returns:
        (count,) float32 inverse depths, 1/m, falling in equal steps.
    """
    return np.linspace(1 / min_depth_m, 1 / max_depth_m, count).astype(np.float32)


def linear_planes(min_depth_m: float, max_depth_m: float, count: int) -> NDArray[np.float32]:
    """Returns planes in equal steps of depth, near to far, with both ends of the range among them.

    Args:
        min_depth_m: depth of the first plane, m.
        max_depth_m: depth of the last plane, m.
        count: number of planes, at least 2.

    Returns:
        (count,) float32 inverse depths, 1/m, falling.
    """
    return (1 / np.linspace(min_depth_m, max_depth_m, count)).astype(np.float32)


def mcemvs_planes(min_depth_m: float, max_depth_m: float, count: int) -> NDArray[np.float32]:
    """Returns the planes of the authors' implementation: far to near, never quite at the near end.

    Args:
        min_depth_m: near end of the range, m; the nearest plane lies one step beyond it.
        max_depth_m: depth of the first plane, m.
        count: number of planes, at least 2.

    Returns:
        (count,) float32 inverse depths, 1/m: `1/max + i (1/min - 1/max) / count`.
    """
    near, far = 1 / min_depth_m, 1 / max_depth_m
    return (far + np.arange(count) * (near - far) / count).astype(np.float32)


def inverse_depth_at(
    rho: NDArray[np.float32], position: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns the inverse depth at fractional plane positions: (...) float32, 1/m.

    Args:
        rho: (N,) planes in equal steps of inverse depth or of depth, 1/m.
        position: (...) plane indices, whole or fractional.
    """
    first, last, place = float(rho[0]), float(rho[-1]), position.astype(np.float64)
    if not is_linear(rho):
        place *= (last - first) / (len(rho) - 1)
        place += first
        return place.astype(np.float32)
    place *= (1 / last - 1 / first) / (len(rho) - 1)
    place += 1 / first
    return (1 / place).astype(np.float32)


def is_linear(rho: NDArray[np.float32]) -> bool:
    """Says whether planes have equal steps of depth; else they have them of inverse depth."""
    middle, first, last = (float(rho[k]) for k in (len(rho) // 2, 0, -1))
    share = (len(rho) // 2) / (len(rho) - 1)
    inverse = first + share * (last - first)
    linear = 1 / (1 / first + share * (1 / last - 1 / first))
    return abs(middle - linear) < abs(middle - inverse)
