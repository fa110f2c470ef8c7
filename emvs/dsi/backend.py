"""Where a sweep is computed: what the loop over the planes asks of it, and the CPU's answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi.maxima import FocusMaxima, InFocus, Maximum, Measures, RunningMaxima
from eventsweep.emvs.dsi.method import Method
from eventsweep.emvs.dsi.rays import Rays
from eventsweep.emvs.dsi.slices import SliceRecorder
from eventsweep.emvs.dsi.voting import Scratch, VoteCounts, batch_planes, cast_all
from eventsweep.emvs.utils.runtime import use_threads

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class SweepSettings:
    """How votes are cast, and what is made of them; the same for every group of methods.

    Attributes:
        sums: how a GPU sums votes: `fixed`, `float`, or `nearest`, where on any device a ray votes
            for the nearest pixel only.
        polarities: 2 where each polarity has volumes of its own.
        measures: what depth maximises along a ray.
        threads: of the CPU; 0 for all.
    """

    sums: Literal["fixed", "float", "nearest"]
    polarities: int
    measures: Measures
    threads: int = 0


@dataclass(frozen=True, eq=False)
class Task:
    """One group's sweep.

    Attributes:
        methods: the methods whose maxima are needed; they share one split.
        requested: the methods that were asked for, whose rows are kept.
        cameras: number of cameras.
        width_px: columns of the reference view.
        height_px: rows.
        rho: (N,) float32 planes, 1/m, near to far.
        row_px: the image row whose values are kept.
        settings: how votes are cast, and what is made of them.
    """

    methods: tuple[Method, ...]
    requested: tuple[Method, ...]
    cameras: int
    width_px: int
    height_px: int
    rho: Floats
    row_px: int
    settings: SweepSettings


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one group's sweep leaves.

    Attributes:
        maxima: method name -> first maximum over planes.
        focus: method name -> where its rays are most in focus, of every method that asks for it.
        rows: method name -> (N, W) float32 values of one image row.
        votes: per volume, what became of its votes.
    """

    maxima: Mapping[str, Maximum]
    focus: Mapping[str, InFocus]
    rows: Mapping[str, Floats]
    votes: Sequence[VoteCounts]


class Backend(Protocol):
    """Holds the planes of one batch, and what a sweep remembers of those before.

    Attributes:
        planes_in_flight: planes of one batch.
    """

    planes_in_flight: int

    def cast(self, first: int, last: int) -> None:
        """Casts the votes of every volume in planes `first` to `last`, exclusive."""

    def fuse(self) -> None:
        """Fuses these planes by every method, and takes them into the running maxima."""

    def images(self) -> Floats:
        """(V, P, H, W) votes of these planes, in the memory of the CPU."""

    def outcome(self) -> Outcome:
        """What all planes so far leave."""


class CpuBackend:
    """The compiled loops on all cores.

    Memory holds the scratch planes of one batch: two per thread and volume, at the least.
    """

    def __init__(self, task: Task, rays: Sequence[Rays]) -> None:
        size, settings = (task.width_px, task.height_px), task.settings
        planes, polarities = len(task.rho), settings.polarities
        threads = use_threads(settings.threads)
        self._task, self._rays = task, rays
        self.planes_in_flight = batch_planes(planes, threads, size[0] * size[1], len(rays))
        self._scratch = Scratch(
            len(rays), self.planes_in_flight, *size, nearest=settings.sums == "nearest"
        )
        self._focus = FocusMaxima(
            task.methods, task.cameras, *size, settings.measures,
            planes=planes, polarities=polarities,
        )  # fmt: skip
        self._maxima = RunningMaxima(
            task.methods, *size, planes=planes, polarities=polarities, hands_out=self._focus.fused
        )
        self._slices = SliceRecorder(task.requested, planes, size[0], task.row_px, polarities)
        self._votes = [VoteCounts()] * len(rays)
        self._first = self._last = 0

    def cast(self, first: int, last: int) -> None:
        """Casts the votes of every volume in planes `first` to `last`, exclusive."""
        self._first, self._last = first, last
        votes = cast_all(self._scratch, self._rays, self._task.rho[first:last])
        self._votes = [a + b for a, b in zip(self._votes, votes, strict=True)]

    def fuse(self) -> None:
        """Fuses these planes by every method, and takes them into the running maxima."""
        self._maxima.update(self._scratch.votes, self._last - self._first)
        images = self.images()
        self._focus.update(images, self._maxima.handed_out)
        self._slices.take(self._first, images)

    def images(self) -> Floats:
        """(V, P, H, W) votes of these planes: views of the scratch."""
        return self._scratch.images(self._last - self._first)

    def outcome(self) -> Outcome:
        """What all planes so far leave."""
        maxima = {method.name: self._maxima.of(m) for m, method in enumerate(self._task.methods)}
        return Outcome(maxima, self._focus.result(), self._slices.values, self._votes)
