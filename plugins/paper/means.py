"""The generalized means: their order voxel by voxel (Equation 1), and what each lets through."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.mapper import map_window
from eventsweep.plugins.paper import edges
from eventsweep.plugins.paper.evidence import Evidence
from eventsweep.plugins.paper.statements import Finding, Verdict

FUNCTIONS = ("min", "H", "G", "A", "RMS", "max")
"""In the order of Equation 1."""
SCENES = ("boxes", "desk", "planes", "low-texture")
NOISY = tuple(f"{scene}-noisy" for scene in SCENES)
_BAD = "outlier_share"
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
        return order_of([np.load(file, mmap_mode="r") for file in files])


def order_of(volumes: Sequence[NDArray[np.float32]]) -> Order:
    """Compares volumes of the same size, those that should be smaller first."""
    broken = np.zeros(volumes[0].shape, np.bool_)
    for smaller, larger in pairwise(volumes):
        broken |= smaller > larger * (1 + _ROUNDING)
    return Order(broken.size, int(np.count_nonzero(broken)), int(np.count_nonzero(volumes[0])))


def order(evidence: Evidence) -> Finding:
    """Whether Equation 1 holds in every voxel."""
    found = order_of_means(evidence.view("boxes").sequence)
    return Finding(
        f"In {found.voxels - found.broken:,} of {found.voxels:,} voxels; {found.both:,} have votes "
        "of both cameras",
        Verdict.of(found.broken == 0 and found.both > 0),
    )


def functions(evidence: Evidence) -> Finding:
    """Which functions let fewest outliers through."""
    parts, margins = [], []
    for cases, light in ((SCENES, "ideal sensor"), (NOISY, "a DAVIS346's noise")):
        shares = {f: evidence.number(cases, f"Alg1/{f}", _BAD) for f in FUNCTIONS}
        parts.append(f"{light}: " + ", ".join(f"{f} {v.mean:.1f}" for f, v in shares.items()))
        strict, lenient = (
            [shares[f].mean for f in names] for names in (FUNCTIONS[:3], FUNCTIONS[3:])
        )
        margins.append(max(strict) / min(lenient))
    texts = "; ".join(f"{case}: {_scene_order(evidence, case)}" for case in SCENES)
    beside = [edges.outliers_of(evidence, "desk", f"Alg1/{f}")[1] for f in ("H", "G", "A")]
    return Finding(
        f"Outliers, %: {'; '.join(parts)}",
        Verdict.of(max(margins) < 1, max(margins) < 0.9),
        f"From fewest to most outliers, {texts}. Near the top contours decide: on desk, "
        "outliers that no pixel beside them explains are "
        f"{beside[0]:.1f}, {beside[1]:.1f} and {beside[2]:.1f} % for H, G and A. RMS and "
        "max, and one camera alone, lie well behind.",
    )


def _scene_order(evidence: Evidence, case: str) -> str:
    shares = {f: evidence.number(case, f"Alg1/{f}", _BAD).mean for f in FUNCTIONS}
    return " < ".join(sorted(shares, key=shares.__getitem__))
