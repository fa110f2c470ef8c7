"""Fusion of the cameras' volumes, voxel by voxel."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.dsi.method import CODES, Fusion, FusionTables, Method, Volume
from eventsweep.emvs.errors import InputError


def fuse(code: int, volumes: Volume) -> Volume:
    """Fuses (C, N, H, W) votes of C cameras to (N, H, W) float32 by the compiled code."""
    return fuse_by(Method("", code, ""), volumes)


def fuse_by(
    method: Method, volumes: Volume, polarities: int = 1, out: Volume | None = None
) -> Volume:
    """Fuses planes by a method, level by level.

    Args:
        method: what to do.
        volumes: (V, N, H, W) votes; V is polarities x cameras x intervals, the last runs fastest.
        polarities: 2 where each polarity has volumes of its own; their fusions are summed.
        out: (N, H, W) float32 that compiled fusions may fill: memory that is new for every batch
            costs as much as what is written into it.

    Returns:
        (N, H, W) float32.

    Raises:
        InputError: a function of one's own that gives another shape, or a value below 0 or NaN.
    """
    if method.function is not None:
        return _by_function(method, method.function, volumes, polarities)
    count, planes, height, width = volumes.shape
    votes = _in_cells(np.asarray(volumes, np.float32))
    tables = FusionTables.of((method,), count, polarities)
    out = np.empty((planes, height, width), np.float32) if out is None else out
    level, spare, _ = tables.scratch(height, width)
    fusion_kernels.fuse(*tables.arrays, votes, level, spare, out)  # type: ignore[call-arg]
    return out


def _in_cells(volumes: Volume) -> Volume:
    """(V, N, H, W) volumes as (V, N, cells), a plane first in each; copied only if need be."""
    count, planes, height, width = volumes.shape
    size, step = volumes.itemsize, volumes.strides[1]
    if volumes.strides != (planes * step, step, width * size, size) or step % size:
        return np.ascontiguousarray(volumes).reshape(count, planes, height * width)
    shape, strides = (count, planes, step // size), (planes * step, step, size)
    return np.lib.stride_tricks.as_strided(volumes, shape, strides)


def _by_function(method: Method, function: Fusion, volumes: Volume, polarities: int) -> Volume:
    given = volumes.reshape(polarities, -1, method.split.intervals, *volumes.shape[1:])
    given.flags.writeable = False
    fused = [np.asarray(function(part), np.float32) for part in given]
    for out in fused:
        if out.shape != volumes.shape[1:] or not np.all(out >= 0):
            raise InputError(
                f"the function of {method.name} returned shape {out.shape}: it must return "
                f"{volumes.shape[1:]}, every value at least 0 and none NaN"
            )
    total = np.sum(fused, axis=0) if len(fused) > 1 else fused[0]
    return np.ascontiguousarray(total)


def _fusion(code: int) -> Callable[[Volume], Volume]:
    return lambda volumes: fuse(code, volumes)


# name -> function of (C, N, H, W) votes. For every voxel (paper, Eq. 1):
# min <= H <= G <= A <= RMS <= max
FUSIONS: dict[str, Callable[[Volume], Volume]] = {
    name: _fusion(code) for name, code in CODES.items()
}
