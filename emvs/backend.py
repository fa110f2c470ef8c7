"""Where a sweep is computed: what the loop over the planes asks of it, and the CPU's answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.focus_fold import FocusFold, InFocus
from emvs.rays import Rays
from emvs.recipe import Method
from emvs.running import Maximum, RunningMaxima
from emvs.sweep import Scratch, VoteCounts, batch_planes, cast_all
from emvs.utils.runtime import use_threads
from emvs.volume import SliceRecorder

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Task:
    """One group's sweep.

    Attributes:
        swept: the methods whose maxima are needed; they share one split.
        asked: the methods that were asked for.
        cameras: number of cameras.
        width_px: columns of the reference view.
        height_px: rows.
        rho: (N,) float32 planes, 1/m, near to far.
        row_px: the image row whose values are kept.
        config: voting, extraction, polarities, threads.
    """

    swept: tuple[Method, ...]
    asked: tuple[Method, ...]
    cameras: int
    width_px: int
    height_px: int
    rho: Floats
    row_px: int
    config: MapperConfig

    @property
    def sums(self) -> str:
        """How a GPU sums votes: `nearest`, `fixed` or `float`."""
        nearest = self.config.voting == "nearest"
        return "nearest" if nearest else self.config.voting_precision


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

    def fold(self) -> None:
        """Fuses these planes by every method and folds them into what is remembered."""

    def images(self) -> Floats:
        """(V, P, H, W) votes of these planes, in the memory of the CPU."""

    def outcome(self) -> Outcome:
        """What all planes so far leave."""


class CpuBackend:
    """The compiled loops on all cores.

    Memory holds the scratch planes of one batch: two per thread and volume, at the least.
    """

    def __init__(self, task: Task, rays: Sequence[Rays]) -> None:
        size, config = (task.width_px, task.height_px), task.config
        planes, threads = len(task.rho), use_threads(config.threads)
        self._task, self._rays = task, rays
        self.planes_in_flight = batch_planes(planes, threads, size[0] * size[1], len(rays))
        self._scratch = Scratch(
            len(rays), self.planes_in_flight, *size, nearest=config.voting == "nearest"
        )
        self._maxima = RunningMaxima(task.swept, *size, planes=planes, polarities=config.polarities)
        self._focus = FocusFold(task.swept, task.cameras, *size, config)
        self._recorder = SliceRecorder(task.asked, planes, size[0], task.row_px, config.polarities)
        self._votes = [VoteCounts()] * len(rays)
        self._first = self._last = 0

    def cast(self, first: int, last: int) -> None:
        """Casts the votes of every volume in planes `first` to `last`, exclusive."""
        self._first, self._last = first, last
        cast = cast_all(self._scratch, self._rays, self._task.rho[first:last])
        self._votes = [a + b for a, b in zip(self._votes, cast, strict=True)]

    def fold(self) -> None:
        """Fuses these planes by every method and folds them into what is remembered."""
        self._maxima.fold(self._scratch.votes, self._last - self._first)
        images = self.images()
        self._focus.take(images)
        self._recorder.take(self._first, images)

    def images(self) -> Floats:
        """(V, P, H, W) votes of these planes: views of the scratch."""
        return self._scratch.images(self._last - self._first)

    def outcome(self) -> Outcome:
        """What all planes so far leave."""
        maxima = {method.name: self._maxima.of(m) for m, method in enumerate(self._task.swept)}
        return Outcome(maxima, self._focus.found(), self._recorder.values, self._votes)
