"""How long mapping takes, as a multiple of a fixed loop that is timed beside it.

Seconds say as much about the machine, and who else uses it, as about the mapper. The loop does what
a mapper does, arithmetic and scattered additions into an image that fits no first-level cache; both
are counted in CPU time of one thread, one right after the other, and the ratio is kept.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import emvs.utils.runtime  # noqa: F401  (names the threading layer before the kernel compiles)
from emvs.config import MapperConfig
from emvs.datasets import open_recording
from emvs.mapper import map_window
from eval.speed_kernels import calibration

REPEATS = 3
_VOTES, _CELLS = 60_000_000, 1 << 17


def map_ratios(sequence: Path, config: MapperConfig, repeats: int = REPEATS) -> tuple[float, ...]:
    """Maps a window again and again; CPU time of each over that of the calibration loop.

    Args:
        sequence: a recording.
        config: the window and how it is mapped; always with one thread.
        repeats: measurements, after one that is not counted.

    Returns:
        (repeats,) ratios without unit; lower is faster.
    """
    recording = open_recording(sequence)
    single = config.model_copy(update={"threads": 1})
    image = np.zeros(_CELLS, np.float32)

    def mapping() -> None:
        map_window(recording, single)

    def loop() -> None:
        calibration(image, _VOTES)

    ratios = [_cpu_s(mapping) / _cpu_s(loop) for _ in range(repeats + 1)]
    return tuple(ratios[1:])  # the first one compiled and read the disk


def _cpu_s(work: Callable[[], None]) -> float:
    started_s = time.process_time()
    work()
    return time.process_time() - started_s
