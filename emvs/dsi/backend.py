"""Where a sweep is computed: what the loop over the planes asks of it, and the CPU's answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from emvs.config import MapperConfig
from emvs.dsi.fusion import fuse_by
from emvs.dsi.maxima import FocusPeak, Maximum, RunningMaxima
from emvs.dsi.method import Method
from emvs.dsi.rays import Rays
from emvs.dsi.slices import SliceRecorder
from emvs.dsi.voting import Scratch, VoteCounts, batch_planes, cast_all
from emvs.utils.runtime import use_threads

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class InFocus:
    """Where one method's rays are most in focus.

    Attributes:
        maximum: of the focus measure of its fused volume.
        witnesses: the same of each camera's own volume, where their agreement is asked for.
    """

    maximum: Maximum
    witnesses: tuple[Maximum, ...]


def measure_of(method: Method, config: MapperConfig) -> str:
    """What a method's depth maximises along a ray: `votes`, or a focus measure by its name."""
    return config.focus_measure if method.focus else config.extraction


def needs_focus(methods: Sequence[Method], config: MapperConfig) -> list[Method]:
    """Those of the methods that need a focus measure."""
    return [method for method in methods if measure_of(method, config) != "votes"]


class FocusFold:
    """Peaks of the focus measure of every method that needs one, and of each camera's votes.

    Args:
        methods: the methods of one sweep; those without a focus measure are left alone.
        cameras: number of cameras.
        width_px: columns.
        height_px: rows.
        config: measure, scale and number of planes.
    """

    def __init__(
        self, methods: Sequence[Method], cameras: int, width_px: int, height_px: int,
        config: MapperConfig,
    ) -> None:  # fmt: skip
        self._polarities, self._cameras = config.polarities, cameras
        measured = needs_focus(methods, config)
        asked = any(m.focus and m.camera() is None for m in measured)

        def peak(measure: str) -> FocusPeak:
            return FocusPeak(width_px, height_px, measure, config.focus_sigma_px, config.planes)

        self._peaks = {method: peak(measure_of(method, config)) for method in measured}
        self._witnesses = [peak(config.focus_measure) for _ in range(cameras if asked else 0)]

    def take(self, images: Floats) -> None:
        """Takes in the next planes of (V, P, H, W) votes, in order."""
        for method, peak in self._peaks.items():
            for plane in self._fused(method, images):
                peak.take(plane)
        for camera, peak in enumerate(self._witnesses):
            for plane in self._of_camera(images, camera):
                peak.take(plane)

    def found(self) -> dict[str, InFocus]:
        """What was found, by the methods' names."""
        cameras = tuple(peak.maximum() for peak in self._witnesses)
        return {
            method.name: InFocus(
                peak.maximum(), cameras if method.focus and method.camera() is None else ()
            )
            for method, peak in self._peaks.items()
        }

    def _fused(self, method: Method, images: Floats) -> Floats:
        camera = method.camera()
        if camera is not None:
            return self._of_camera(images, camera)
        return fuse_by(method, images, self._polarities)

    def _of_camera(self, images: Floats, camera: int) -> Floats:
        """(P, H, W) votes of one camera: of all polarities and sub-intervals together."""
        parts = images.reshape(self._polarities, self._cameras, -1, *images.shape[1:])[:, camera]
        whole = parts.reshape(-1, *images.shape[1:])
        return np.asarray(whole[0] if len(whole) == 1 else whole.sum(axis=0), np.float32)


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
