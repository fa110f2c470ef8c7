"""Where a sweep is computed: what the loop over the planes asks of it, and the CPU's answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.fusion import Target
from eventsweep.emvs.dsi.maxima import FocusMaxima, InFocus, Maximum, RunningMaxima
from eventsweep.emvs.dsi.rays import Rays
from eventsweep.emvs.dsi.slices import SliceRecorder
from eventsweep.emvs.dsi.voting import Scratch, VoteCounts, batch_planes
from eventsweep.emvs.utils.runtime import use_threads

Float32s = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Task:
    """The sweep of volumes that share one split.

    Attributes:
        targets: the volumes, and what is kept of each.
        cameras: their number.
        width_px, height_px: of the reference view.
        rho: (N,) float32 planes, 1/m, near to far.
        row_px: the image row whose values are kept.
        config: how votes are cast and summed, scale of the focus measures.
    """

    targets: tuple[Target, ...]
    cameras: int
    width_px: int
    height_px: int
    rho: Float32s
    row_px: int
    config: MapperConfig

    @property
    def sought(self) -> tuple[Target, ...]:
        """Those whose maxima are kept."""
        return tuple(target for target in self.targets if target.measure is not None)

    @property
    def shown(self) -> tuple[Target, ...]:
        """Those of which one image row is kept."""
        return tuple(target for target in self.targets if target.row)

    def per_camera(self, votes: Sequence[VoteCounts]) -> tuple[VoteCounts, ...]:
        """Sums the votes of volumes, in the order polarity, camera, sub-interval."""
        intervals = self.targets[0].fusion.split.intervals
        sums = [VoteCounts()] * self.cameras
        for k, count in enumerate(votes):
            sums[k // intervals % self.cameras] += count
        return tuple(sums)


@dataclass(frozen=True, eq=False)
class SweepResult:
    """What a sweep leaves: maxima, focus and rows by the name of a target.

    Attributes:
        maxima: first maximum of the votes over planes.
        focus: where its rays are most in focus, of every target that asks for it.
        rows: (N, W) float32 values of one image row.
        votes: per camera, what became of its votes in the sweep of the first split.
    """

    maxima: Mapping[str, Maximum]
    focus: Mapping[str, InFocus]
    rows: Mapping[str, Float32s]
    votes: tuple[VoteCounts, ...]

    def joined(self, later: SweepResult) -> SweepResult:
        """With what the sweep of another split leaves."""
        return SweepResult(
            {**self.maxima, **later.maxima},
            {**self.focus, **later.focus},
            {**self.rows, **later.rows},
            self.votes or later.votes,
        )


class Backend(Protocol):
    """Holds the planes of one batch, and what a sweep remembers of those before."""

    planes_in_flight: int

    def cast(self, first: int, last: int) -> None:
        """Casts the votes of every volume in planes `first` to `last`, exclusive."""

    def fuse(self) -> None:
        """Fuses these planes for every target, and takes them into the running maxima."""

    def images(self) -> Float32s:
        """(V, P, H, W) votes of these planes, in the memory of the CPU; before they are fused."""

    def result(self) -> SweepResult:
        """What all planes so far leave."""


class CpuBackend:
    """The compiled loops on all cores; memory holds the scratch planes of one batch."""

    def __init__(self, task: Task, rays: Sequence[Rays]) -> None:
        size, config = (task.width_px, task.height_px), task.config
        planes, polarities = len(task.rho), config.polarities
        threads = use_threads(config.threads)
        self._task, self._rays = task, rays
        self.planes_in_flight = batch_planes(planes, threads, size[0] * size[1], len(rays))
        self._scratch = Scratch(
            len(rays), self.planes_in_flight, *size, nearest=config.voting == "nearest"
        )
        self._focus = FocusMaxima(
            task.sought, task.cameras, *size, config.focus.sigma_px,
            planes=planes, polarities=polarities,
        )  # fmt: skip
        self._maxima = RunningMaxima(
            [target.fusion for target in task.sought], *size, planes=planes, polarities=polarities,
            shared_volume=self._focus.shared_volume,
        )  # fmt: skip
        self._slices = SliceRecorder(task.shown, planes, size[0], task.row_px, polarities)
        self._votes = [VoteCounts()] * len(rays)
        self._first = self._last = 0

    def cast(self, first: int, last: int) -> None:
        """Casts the votes of every volume in planes `first` to `last`, exclusive."""
        self._first, self._last = first, last
        for k, rays in enumerate(self._rays):
            self._votes[k] += self._scratch.cast(k, rays, self._task.rho[first:last])

    def fuse(self) -> None:
        """Fuses these planes for every target, and takes them into the running maxima."""
        images, shared = self.images(), self._maxima.shared
        self._slices.take(self._first, images)
        self._focus.update(images, shared)
        self._maxima.update(self._scratch.votes, self._last - self._first)
        self._focus.update_shared(shared, images[0])

    def images(self) -> Float32s:
        """(V, P, H, W) votes of these planes: views of the scratch."""
        return self._scratch.images(self._last - self._first)

    def result(self) -> SweepResult:
        """What all planes so far leave."""
        task = self._task
        maxima = {target.name: self._maxima.of(k) for k, target in enumerate(task.sought)}
        votes = task.per_camera(self._votes)
        return SweepResult(maxima, self._focus.result(), self._slices.values, votes)
