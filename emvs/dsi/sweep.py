"""The sweep of all volumes: one pass over the planes per split, and no volume is ever stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.backend import Backend, SweepResult, Task
from eventsweep.emvs.dsi.backprojection import Projected
from eventsweep.emvs.dsi.device import CPU, Device, backend_on
from eventsweep.emvs.dsi.fusion import WHOLE, Split, Target
from eventsweep.emvs.dsi.slices import volume_writer
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.utils.runtime import Progress, silent

Keep = Callable[[int, NDArray[np.float32]], None]


def splits_of(targets: Sequence[Target]) -> list[Split]:
    """The splits that targets need, the whole window first where it is among them, or alone."""
    splits = {target.fusion.split for target in targets} or {WHOLE}
    return sorted(splits, key=lambda split: (split.intervals, split.by))


def slice_row(view: ReferenceView, config: MapperConfig) -> int:
    """The image row that is kept of every volume: by default the middle one."""
    return view.camera.height_px // 2 if config.slice_row is None else config.slice_row


def sweep(
    projected: Projected,
    view: ReferenceView,
    targets: Sequence[Target],
    config: MapperConfig,
    progress: Progress = silent,
    device: Device = CPU,
    *,
    dsi_dir: Path | None = None,
    keep: Keep | None = None,
) -> SweepResult:
    """Sweeps the planes once per split: casts votes in a few planes, fuses them, keeps the maxima.

    Memory, of the device where the rays lie, holds the planes of one batch of every volume: camera,
    sub-interval and polarity. Every fused volume is written to `dsi_dir`, if there is one. `keep`
    takes in the votes of the whole window, where they are needed afterwards: the first plane's
    number, and (V, P, H, W) votes that are valid during the call. `progress` is called with the
    stage `sweep`, planes done and all.

    Raises:
        InputError: a GPU with too little memory for one plane.
    """
    planes, size = len(view.rho), (view.camera.width_px, view.camera.height_px)
    result = SweepResult({}, {}, {}, ())
    splits = splits_of(targets) if targets else []
    for k, split in enumerate(splits):
        alike = tuple(target for target in targets if target.fusion.split == split)
        cameras, row_px = len(projected.counts), slice_row(view, config)
        task = Task(alike, cameras, *size, view.rho, row_px, config)
        backend = backend_on(device, task, projected.rays[split])
        for done in _planes(backend, task, dsi_dir, keep if split == WHOLE else None):
            progress("sweep", k * planes + done, len(splits) * planes)
        result = result.joined(backend.result())
    return result


def _planes(backend: Backend, task: Task, dsi_dir: Path | None, keep: Keep | None) -> Iterator[int]:
    """The sweep of one split; yields how many planes are done, batch by batch."""
    planes, step = len(task.rho), backend.planes_in_flight
    shape = planes, task.height_px, task.width_px
    written = [target for target in task.sought if target.row]
    files = dsi_dir and volume_writer(dsi_dir, written, shape, task.config.polarities)
    with files or nullcontext() as append:
        for first in range(0, planes, step):
            last = min(first + step, planes)
            backend.cast(first, last)
            if append is not None:
                append(backend.images())
            if keep is not None:
                keep(first, backend.images())
            backend.fuse()
            yield last
