"""How many atomic additions to random cells the GPU does: the ceiling of voting."""

from __future__ import annotations

import importlib
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpu_plan import BenchmarkPlan

# mypy: disable-error-code="no-untyped-def"

cuda: Any = importlib.import_module("numba.cuda")

_ROUNDS = 5
_TYPES = {"int64": np.int64, "float32": np.float32}


@dataclass(frozen=True)
class Rate:
    """Atomic additions per second.

    Attributes:
        kind: type of what is added.
        grid: `L2`, which half of the cache holds, or `DRAM`.
        grid_bytes: size of the cells.
        per_s: additions per second, the median of five launches.
        right: whether every addition arrived.
    """

    kind: str
    grid: str
    grid_bytes: int
    per_s: float
    right: bool


def atomic_rates(plan: BenchmarkPlan, l2_bytes: int) -> list[Rate]:
    """Measures both types on a grid that the L2 cache holds and on one that it does not."""
    near = min(l2_bytes // 2, plan.far_bytes)
    return [
        _rate(plan, kind, grid, size)
        for kind in _TYPES
        for grid, size in (("L2", near), ("DRAM", plan.far_bytes))
    ]


def _rate(plan: BenchmarkPlan, kind: str, grid: str, size: int) -> Rate:
    dtype = np.dtype(_TYPES[kind])
    cells = cuda.to_device(np.zeros(size // dtype.itemsize, dtype))
    one, launches = dtype.type(1), _ROUNDS + 1
    seconds = []
    for _ in range(launches):  # the first compiles, and warms the cache
        cuda.synchronize()
        begin = time.perf_counter()
        add_at_random[plan.blocks, plan.threads](cells, plan.repeats, one)
        cuda.synchronize()
        seconds.append(time.perf_counter() - begin)
    additions = plan.blocks * plan.threads * plan.repeats
    total = float(cells.copy_to_host().sum(dtype=np.float64))
    median_s = float(np.median(seconds[1:]))
    return Rate(kind, grid, size, additions / median_s, total == float(additions * launches))


@cuda.jit
def add_at_random(cells, repeats, one):
    """Every thread adds `one` to `repeats` cells that a generator of its own draws."""
    state = (cuda.grid(1) * 2654435761) & 0xFFFFFFFF
    state ^= state >> 15
    for _ in range(repeats):
        state = (state * 1664525 + 1013904223) & 0xFFFFFFFF
        cuda.atomic.add(cells, (state * cells.shape[0]) >> 32, one)
