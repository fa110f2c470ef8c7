"""The sweep of all methods: one pass over the planes per split, and no volume is ever stored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs.backproject import Projected
from emvs.config import MapperConfig
from emvs.focus_fold import FocusFold, InFocus
from emvs.methods import single_cameras
from emvs.progress import Progress
from emvs.rays import Rays
from emvs.recipe import Method, Split
from emvs.result import Slices
from emvs.running import Maximum, RunningMaxima
from emvs.sweep import Scratch, VoteCounts, batch_planes, batches, cast_all
from emvs.threads import use_threads
from emvs.view import ReferenceView
from emvs.volume import SliceRecorder, volume_writer


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
) -> Swept:
    """Sweeps the planes once per group, casting, fusing and folding a few planes at a time.

    Memory holds the scratch planes of one batch: two per thread, camera, sub-interval and polarity.
    """
    row_px = view.camera.height_px // 2 if config.slice_row is None else config.slice_row
    maxima: dict[str, Maximum] = {}
    focus: dict[str, InFocus] = {}
    slices: dict[str, NDArray[np.float32]] = {}
    votes: list[VoteCounts] = []
    for k, group in enumerate(groups):
        cameras = len(projected.counts)
        one = _Pass(group, projected.rays[group.split], cameras, view, config, row_px)
        for last in one.run(dsi_dir if config.save_dsi else None):
            progress("sweep", k * config.planes + last, len(groups) * config.planes)
        maxima |= {method.name: one.maxima.of(m) for m, method in enumerate(group.swept)}
        focus |= one.focus.found()
        slices |= one.recorder.values
        votes = votes or _per_camera(one.votes, cameras, group.split)
    in_order = {method.name: slices[method.name] for group in groups for method in group.asked}
    return Swept(maxima, focus, Slices(row_px, view.rho, in_order), votes)


class _Pass:
    """One group's sweep."""

    def __init__(
        self, group: Group, rays: list[Rays], cameras: int, view: ReferenceView,
        config: MapperConfig, row_px: int,
    ) -> None:  # fmt: skip
        size = view.camera.width_px, view.camera.height_px
        self._rays, self._rho, self._config = rays, view.rho, config
        self._threads = use_threads(config.threads)
        self._load = (config.planes, self._threads, size[0] * size[1], len(rays))
        self._scratch = Scratch(
            len(rays), batch_planes(*self._load), *size, nearest=config.voting == "nearest"
        )
        self._shape = (config.planes, size[1], size[0])
        self._with_volume = tuple(method for method in group.asked if not method.late)
        self.maxima = RunningMaxima(
            group.swept, *size, planes=config.planes, polarities=config.polarities
        )
        self.focus = FocusFold(group.swept, cameras, *size, config)
        self.recorder = SliceRecorder(
            group.asked, config.planes, size[0], row_px, config.polarities
        )
        self.votes = [VoteCounts()] * len(rays)

    def run(self, dsi_dir: Path | None) -> Iterator[int]:
        """Sweeps; yields how many planes are done, batch by batch."""
        with volume_writer(
            dsi_dir, self._with_volume, self._shape, self._config.polarities
        ) as volumes:
            for first, last in batches(*self._load):
                cast = cast_all(self._scratch, self._rays, self._rho[first:last])
                self.maxima.fold(self._scratch.votes, last - first)
                images = self._scratch.images(last - first)
                self.focus.take(images)
                self.recorder.take(first, images)
                volumes.take(images)
                self.votes = [a + b for a, b in zip(self.votes, cast, strict=True)]
                yield last


def _per_camera(votes: Sequence[VoteCounts], n_cameras: int, split: Split) -> list[VoteCounts]:
    """Sums the votes of volumes in the order polarity, camera, sub-interval."""
    sums = [VoteCounts()] * n_cameras
    for k, count in enumerate(votes):
        camera = k // split.intervals % n_cameras
        sums[camera] = sums[camera] + count
    return sums
