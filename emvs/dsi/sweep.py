"""The sweep of all methods: one pass over the planes per split, and no volume is ever stored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.dsi import device as devices
from emvs.dsi.backend import Backend, InFocus, Task
from emvs.dsi.backprojection import Projected
from emvs.dsi.device import CPU, Device
from emvs.dsi.maxima import Maximum
from emvs.dsi.method import Method, Split, single_cameras
from emvs.dsi.slices import Slices, volume_writer
from emvs.dsi.voting import VoteCounts
from emvs.reference_view import ReferenceView
from emvs.utils.runtime import Progress


@dataclass(frozen=True)
class Group:
    """Methods that share one split, and so one sweep.

    Attributes:
        split: the sub-intervals.
        asked: the methods that were asked for.
        swept: the methods whose maxima are needed: late fusion needs those of the single cameras.
    """

    split: Split
    asked: tuple[Method, ...]
    swept: tuple[Method, ...]


@dataclass(frozen=True, eq=False)
class Swept:
    """What the sweep leaves.

    Attributes:
        maxima: method name -> maximum, of every method with a volume.
        focus: method name -> where its rays are most in focus, of every method that asks for it.
        slices: one image row of every volume.
        votes: per camera, what became of its votes in the first group's sweep.
    """

    maxima: Mapping[str, Maximum]
    focus: Mapping[str, InFocus]
    slices: Slices
    votes: list[VoteCounts]


def grouped(methods: Sequence[Method], n_cameras: int) -> list[Group]:
    """Groups methods by their split, the whole window first where it is among them."""
    splits = sorted({m.split for m in methods}, key=lambda split: (split.intervals, split.by))
    groups = []
    for split in splits:
        asked = tuple(method for method in methods if method.split == split)
        swept = tuple(method for method in asked if not method.late)
        if len(swept) < len(asked):
            names = {method.name for method in swept}
            swept += tuple(m for m in single_cameras(n_cameras) if m.name not in names)
        groups.append(Group(split, asked, swept))
    return groups


def sweep(
    projected: Projected,
    view: ReferenceView,
    groups: Sequence[Group],
    config: MapperConfig,
    dsi_dir: Path | None,
    progress: Progress,
    device: Device = CPU,
) -> Swept:
    """Sweeps the planes once per group, casting, fusing and folding a few planes at a time.

    Memory, of the device, holds the planes of one batch of every volume: camera, sub-interval and
    polarity.

    Raises:
        InputError: a GPU with too little memory for one plane.
    """
    row_px = view.camera.height_px // 2 if config.slice_row is None else config.slice_row
    maxima: dict[str, Maximum] = {}
    focus: dict[str, InFocus] = {}
    slices: dict[str, NDArray[np.float32]] = {}
    votes: list[VoteCounts] = []
    for k, group in enumerate(groups):
        cameras = len(projected.counts)
        task = _task(group, cameras, view, row_px, config)
        backend = devices.backend(device, task, projected.rays[group.split])
        for last in _planes(backend, task, dsi_dir if config.save_dsi else None):
            progress("sweep", k * config.planes + last, len(groups) * config.planes)
        found = backend.outcome()
        maxima |= found.maxima
        focus |= found.focus
        slices |= found.rows
        votes = votes or _per_camera(found.votes, cameras, group.split)
    in_order = {method.name: slices[method.name] for group in groups for method in group.asked}
    return Swept(maxima, focus, Slices(row_px, view.rho, in_order), votes)


def _task(
    group: Group, cameras: int, view: ReferenceView, row_px: int, config: MapperConfig
) -> Task:
    size = view.camera.width_px, view.camera.height_px
    return Task(group.swept, group.asked, cameras, *size, view.rho, row_px, config)


def _planes(backend: Backend, task: Task, dsi_dir: Path | None) -> Iterator[int]:
    """One group's sweep; yields how many planes are done, batch by batch."""
    planes, step = len(task.rho), backend.planes_in_flight
    shape = planes, task.height_px, task.width_px
    with_volume = tuple(method for method in task.asked if not method.late)
    with volume_writer(dsi_dir, with_volume, shape, task.config.polarities) as volumes:
        for first in range(0, planes, step):
            last = min(first + step, planes)
            backend.cast(first, last)
            backend.fold()
            if dsi_dir is not None:
                volumes.take(backend.images())
            yield last


def _per_camera(votes: Sequence[VoteCounts], n_cameras: int, split: Split) -> list[VoteCounts]:
    """Sums the votes of volumes in the order polarity, camera, sub-interval."""
    sums = [VoteCounts()] * n_cameras
    for k, count in enumerate(votes):
        camera = k // split.intervals % n_cameras
        sums[camera] = sums[camera] + count
    return sums
