"""Whole calls of the mapper, timed on the GPU and on the CPU, and what one says of the other."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import methods_by_name, with_volume
from eventsweep.emvs.window_result import WindowResult

VOLUMES = ("Alg1/H", "EMVS/cam0", "EMVS/cam1")
DSI_LIMIT, ARGMAX_LIMIT = 1e-3, 0.999


@dataclass(frozen=True)
class Call:
    """One load, called again and again: from events in memory to depth maps in memory.

    Attributes:
        first_s: the first call, with all that is compiled and set up, s.
        rounds_s: the others, s.
        stages_s: median of each stage, s.
        counted: votes that fell into the image, of all cameras.
        repeats: whether every call gave the same bits.
    """

    first_s: float
    rounds_s: tuple[float, ...]
    stages_s: dict[str, float]
    counted: int
    repeats: bool

    @property
    def median_s(self) -> float:
        """The median of the calls after the first, s."""
        return float(np.median(self.rounds_s))


@dataclass(frozen=True)
class Agreement:
    """How far the GPU's volumes and maxima lie from the CPU's.

    Attributes:
        volume: greatest difference of a volume's values, over the greatest value.
        relative: greatest difference over the value itself, or over one vote where it is less.
        argmax: share of pixels whose maximum lies in the same plane, in the worst method.
        counted: votes that fell into the image, GPU less CPU, over the CPU's.
    """

    volume: float
    relative: float
    argmax: float
    counted: float

    def faults(self, what: str) -> list[str]:
        """What is wrong, a sentence each."""
        found = []
        if not self.volume <= DSI_LIMIT:
            found.append(f"{what}: the DSI is off by {self.volume:.2g}, above {DSI_LIMIT:g}")
        if not self.argmax >= ARGMAX_LIMIT:
            share = f"{100 * self.argmax:.3f} %"
            found.append(f"{what}: the argmax is equal in {share} of pixels, below 99.9 %")
        return found


def call(recording: Recording, config: MapperConfig, rounds: int) -> tuple[Call, WindowResult]:
    """Maps one window `rounds` times after a first time, and keeps the last result."""
    first, first_s = _timed(recording, config)
    seconds, stages, repeats, last = [], [], True, first
    for _ in range(rounds):
        last, wall_s = _timed(recording, config)
        seconds.append(wall_s)
        stages.append(last.seconds)
        repeats &= same(first, last)
    medians = {name: float(np.median([one[name] for one in stages])) for name in last.seconds}
    return Call(first_s, tuple(seconds), medians, counted(last), repeats), last


def _timed(recording: Recording, config: MapperConfig) -> tuple[WindowResult, float]:
    begin = time.perf_counter()
    result = map_window(recording, config)
    return result, time.perf_counter() - begin


def counted(result: WindowResult) -> int:
    """Votes that fell into the image, of all cameras."""
    return sum(camera.votes.counted for camera in result.counts)


def same(one: WindowResult, other: WindowResult) -> bool:
    """Whether two results have the same bits: depth, confidence, mask and argmax."""
    return all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=name == "depth_m")
        for a, b in zip(one.depth_maps.values(), other.depth_maps.values(), strict=True)
        for name in ("depth_m", "confidence", "mask", "argmax")
    )


def agreement(
    gpu: WindowResult, cpu: WindowResult, gpu_volumes: Path, cpu_volumes: Path
) -> Agreement:
    """Compares maxima in memory and the volumes that `save_volumes` wrote."""
    files = [file_name(method.name) for method in with_volume(methods_by_name(VOLUMES, 2))]
    apart = [_apart(gpu_volumes / f"{name}.npy", cpu_volumes / f"{name}.npy") for name in files]
    volume, relative = np.max(apart, axis=0)  # NaN where one is
    shares = [
        float(np.mean(gpu.depth_maps[name].argmax == one.argmax))
        for name, one in cpu.depth_maps.items()
    ]
    votes = counted(cpu)
    return Agreement(
        float(volume), float(relative), min(shares),
        (counted(gpu) - votes) / max(1, votes),
    )  # fmt: skip


def save_volumes(recording: Recording, config: MapperConfig, folder: Path) -> Path:
    """Writes the volumes of both cameras and of their harmonic mean, and returns `folder`."""
    folder.mkdir()
    wanted = {"methods": VOLUMES, "save_dsi": True}
    map_window(recording, config.model_copy(update=wanted), dsi_dir=folder)
    return folder


def _apart(ours: Path, theirs: Path) -> tuple[float, float]:
    """Greatest difference of two volumes, over the greatest value and over the value itself."""
    volumes: Sequence[NDArray[np.float32]] = [
        np.load(path, mmap_mode="r") for path in (ours, theirs)
    ]
    most = greatest = relative = 0.0
    for one, other in zip(*volumes, strict=True):
        apart = np.abs(one - other)
        most = max(most, float(apart.max()))
        greatest = max(greatest, float(other.max()))
        relative = max(relative, float((apart / np.maximum(other, 1)).max()))
    # A NaN anywhere makes all comparisons false; this keeps it.
    finite = all(np.isfinite(plane).all() for volume in volumes for plane in volume)
    return (most / max(greatest, 1e-30), relative) if finite else (float("nan"), float("nan"))
