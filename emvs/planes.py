"""Depth planes: uniform in inverse depth, near to far."""

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


def reference_planes(min_depth_m: float, max_depth_m: float, count: int) -> NDArray[np.float32]:
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
        rho: (N,) planes in equal steps, 1/m.
        position: (...) plane indices, whole or fractional.
    """
    step = (float(rho[-1]) - float(rho[0])) / (len(rho) - 1)
    return (float(rho[0]) + position.astype(np.float64) * step).astype(np.float32)
