"""How many planes a GPU sweeps at a time: as many as its cache holds, and its memory."""

from __future__ import annotations

from emvs.backend import Task
from emvs.cuda.focus import ROOM_IMAGES
from emvs.cuda.library import Gpu
from emvs.cuda.maxima import STATE_BYTES
from emvs.errors import InputError

_CACHE_SHARE = 0.6  # of the second-level cache, for the sums that votes are added to
_MEMORY_SHARE = 0.9  # of the free memory; the rest is lost to its division into blocks
_MOST_PLANES = 16
_SUM_BYTES = {"fixed": 8, "float": 4, "nearest": 4}


def planes_in_flight(task: Task, volumes: int, focused: int, gpu: Gpu) -> int:
    """Returns how many planes make one batch.

    Votes are added at random places of one volume's planes of a batch. Where these fit into the
    cache, an addition never waits for memory.

    Args:
        task: what to sweep.
        volumes: how many volumes.
        focused: methods that need a focus measure.
        gpu: its cache and its free memory, where the rays are already.

    Raises:
        InputError: too little memory for a single plane.
    """
    cells = task.width_px * task.height_px
    sums = _SUM_BYTES[task.sums] * cells
    cached = max(1, int(_CACHE_SHARE * gpu.l2_bytes) // sums)
    per_plane = sums + 4 * cells * (volumes + (ROOM_IMAGES if focused else 0))
    states = len(task.swept) + (focused + task.cameras if focused else 0)
    always = states * STATE_BYTES * cells + 4 * volumes * len(task.rho) * task.width_px
    free = _MEMORY_SHARE * gpu.memory_bytes
    if always + per_plane > free:
        raise InputError(
            f"{gpu.name} has {gpu.memory_bytes / 1e9:.3g} GB of memory free, one plane of "
            f"{task.width_px} x {task.height_px} px needs {(always + per_plane) / 1e9:.3g} GB with "
            f"{len(task.swept)} methods and {volumes} volumes: choose device cpu, or fewer methods "
            "or sub-intervals"
        )
    fit = min(len(task.rho), cached, _MOST_PLANES)
    return fit if always + fit * per_plane <= free else int((free - always) // per_plane)
