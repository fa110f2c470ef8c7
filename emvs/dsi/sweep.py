"""The sweep of all methods: one pass over the planes per split, and no volume is ever stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi.backend import Backend, SweepSettings, Task
from eventsweep.emvs.dsi.backprojection import Projected
from eventsweep.emvs.dsi.device import CPU, Device, backend_on
from eventsweep.emvs.dsi.maxima import InFocus, Maximum
from eventsweep.emvs.dsi.method import WHOLE, Method, Split, single_cameras
from eventsweep.emvs.dsi.slices import Slices, volume_writer
from eventsweep.emvs.dsi.voting import VoteCounts
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.utils.runtime import Progress, silent

Keep = Callable[[int, NDArray[np.float32]], None]


@dataclass(frozen=True)
class Group:
    """Methods that share one split, and so one sweep.

    Attributes:
        split: the sub-intervals.
        requested: the methods that were asked for.
        methods: the methods whose maxima are needed: late fusion needs those of the single cameras.
    """

    split: Split
    requested: tuple[Method, ...]
    methods: tuple[Method, ...]


@dataclass(frozen=True, eq=False)
class SweepResult:
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


def group_by_split(methods: Sequence[Method], n_cameras: int) -> list[Group]:
    """Groups methods by their split, the whole window first where it is among them."""
    splits = sorted({m.split for m in methods}, key=lambda split: (split.intervals, split.by))
    groups = []
    for split in splits:
        requested = tuple(method for method in methods if method.split == split)
        needed = tuple(method for method in requested if not method.late)
        if len(needed) < len(requested):
            names = {method.name for method in needed}
            needed += tuple(m for m in single_cameras(n_cameras) if m.name not in names)
        groups.append(Group(split, requested, needed))
    return groups


def sweep(
    projected: Projected,
    view: ReferenceView,
    groups: Sequence[Group],
    settings: SweepSettings,
    progress: Progress = silent,
    device: Device = CPU,
    *,
    slice_row: int | None = None,
    dsi_dir: Path | None = None,
    keep: Keep | None = None,
) -> SweepResult:
    """Sweeps the planes once per group: casts votes in a few planes, fuses them, keeps the maxima.

    Memory, of the device, holds the planes of one batch of every volume: camera, sub-interval and
    polarity.

    Args:
        projected: every camera's rays.
        view: the reference view.
        groups: the methods, by split.
        settings: how votes are cast, and what is made of them.
        progress: told the stage `sweep`, planes done and all.
        device: what computes; the rays must lie there.
        slice_row: the image row to keep of every volume, px; by default the middle one.
        dsi_dir: where to write every fused volume; None for nowhere.
        keep: takes in the votes of the whole window, if its methods need them afterwards: the
            first plane's number, and (V, P, H, W) votes that are valid during the call.

    Raises:
        InputError: a GPU with too little memory for one plane.
    """
    cameras, planes = len(projected.counts), len(view.rho)
    row_px = view.camera.height_px // 2 if slice_row is None else slice_row
    maxima: dict[str, Maximum] = {}
    focus: dict[str, InFocus] = {}
    slices: dict[str, NDArray[np.float32]] = {}
    votes: list[VoteCounts] = []
    for k, group in enumerate(groups):
        task = _task(group, cameras, view, row_px, settings)
        backend = backend_on(device, task, projected.rays[group.split])
        whole = keep if group.split == WHOLE else None
        for done in _planes(backend, task, dsi_dir, whole):
            progress("sweep", k * planes + done, len(groups) * planes)
        outcome = backend.outcome()
        maxima |= outcome.maxima
        focus |= outcome.focus
        slices |= outcome.rows
        votes = votes or _per_camera(outcome.votes, cameras, group.split)
    in_order = {method.name: slices[method.name] for group in groups for method in group.requested}
    return SweepResult(maxima, focus, Slices(row_px, view.rho, in_order), votes)


def _task(
    group: Group, cameras: int, view: ReferenceView, row_px: int, settings: SweepSettings
) -> Task:
    size = view.camera.width_px, view.camera.height_px
    return Task(group.methods, group.requested, cameras, *size, view.rho, row_px, settings)


def _planes(backend: Backend, task: Task, dsi_dir: Path | None, keep: Keep | None) -> Iterator[int]:
    """One group's sweep; yields how many planes are done, batch by batch."""
    planes, step = len(task.rho), backend.planes_in_flight
    shape = planes, task.height_px, task.width_px
    with_volume = tuple(method for method in task.requested if not method.late)
    with volume_writer(dsi_dir, with_volume, shape, task.settings.polarities) as volumes:
        for first in range(0, planes, step):
            last = min(first + step, planes)
            backend.cast(first, last)
            backend.fuse()
            if dsi_dir is not None:
                volumes.take(backend.images())
            if keep is not None:
                keep(first, backend.images())
            yield last


def _per_camera(votes: Sequence[VoteCounts], n_cameras: int, split: Split) -> list[VoteCounts]:
    """Sums the votes of volumes in the order polarity, camera, sub-interval."""
    sums = [VoteCounts()] * n_cameras
    for k, count in enumerate(votes):
        camera = k // split.intervals % n_cameras
        sums[camera] = sums[camera] + count
    return sums
