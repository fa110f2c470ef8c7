"""Equation 1, voxel by voxel: the order of the generalized means."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.mapper import map_window

FUNCTIONS = ("min", "H", "G", "A", "RMS", "max")
"""In the order of Equation 1."""
_ROUNDING = 4e-6
"""Relative: a few units in the last place of the 32-bit values that volumes hold."""


class Order(NamedTuple):
    """How many voxels there are, in how many of them the order fails, and where both saw votes."""

    voxels: int
    broken: int
    both: int


def order_of_means(recording: Recording) -> Order:
    """Fuses the volumes of a recording's whole length by every function, and compares them."""
    methods = tuple(f"Alg1/{name}" for name in FUNCTIONS)
    config = MapperConfig(methods=methods, save_dsi=True, threads=1)
    with TemporaryDirectory() as folder:
        map_window(recording, config, dsi_dir=Path(folder))
        files = [Path(folder, f"{file_name(method)}.npy") for method in methods]
        volumes = [np.load(file, mmap_mode="r") for file in files]
        broken = np.zeros(volumes[0].shape, np.bool_)
        for smaller, larger in pairwise(volumes):
            broken |= smaller > larger * (1 + _ROUNDING)
        both = int(np.count_nonzero(volumes[0]))
    return Order(broken.size, int(np.count_nonzero(broken)), both)
