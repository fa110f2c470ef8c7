"""From a sequence to what a network learns from: candidates, the votes around them, true depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import DerdParameters, MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import confidence_mask, without_border
from eventsweep.emvs.depth.focus import estimate_in_focus, parallax_baseline_m
from eventsweep.emvs.depth.kept_votes import KeptVotes, votes_of_codes
from eventsweep.emvs.dsi.backend import SweepResult
from eventsweep.emvs.dsi.backprojection import back_project
from eventsweep.emvs.dsi.device import CPU, projector_on
from eventsweep.emvs.dsi.fusion import WHOLE
from eventsweep.emvs.dsi.sweep import sweep
from eventsweep.emvs.methods.method import FOCUS, Method
from eventsweep.emvs.reference_view import ReferenceView, reference_view
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.windows import choose_window
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.perturbations import Perturbation, perturbed
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.methods.derd import DERD
from eventsweep.plugins.learned.networks import derd
from eventsweep.plugins.learned.networks.derd import DepthRange, columns_of, selecting
from eventsweep.plugins.learned.networks.inputs import (
    BATCH,
    as_patches,
    candidates,
    channels,
)
from eventsweep.plugins.learned.networks.network import CHANNELS, DEPTH, SIDE_PX
from eventsweep.plugins.learned.training.sequences import TrainingSequence, TrainingWindow, windows

Floats = NDArray[np.float32]
LEAST_C = MapperConfig().threshold_c
"""Pixels are those of Algorithm 1, so that the network knows those that it is compared on."""


@dataclass(frozen=True, eq=False)
class SampleSet:
    """What some network learns from: arrays with one row per pixel whose true depth is known.

    Attributes:
        true_px: (M,) float32 true disparity, px.
    """

    true_px: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.true_px)

    def __getitem__(self, part: slice | NDArray[np.int64]) -> Self:
        return type(self)(**{name: column[part] for name, column in vars(self).items()})

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Several in one, in their order."""
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})

    @property
    def compared_error_px(self) -> NDArray[np.float32]:
        """(M,) error of the extraction that the network is compared with, px of disparity."""
        raise NotImplementedError

    @property
    def compared_rank(self) -> NDArray[np.float32] | None:
        """(M,) how reliable that extraction holds each pixel; None where nobody asks."""
        return None

    def inputs(self) -> dict[str, NDArray[Any]]:
        """The arrays that the network's loss asks for, by name."""
        raise NotImplementedError

    def save(self, path: Path) -> None:
        """Writes a NumPy archive, whole or not at all."""
        with atomic_path(path) as part, part.open("wb") as file:
            np.savez(file, **vars(self))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote."""
        with np.load(path, allow_pickle=False) as archive:
            return cls(**{field.name: archive[field.name] for field in fields(cls)})


@dataclass(frozen=True, eq=False)
class Samples(SampleSet):
    """What the network of the learned extraction learns from.

    Attributes:
        codes: (M, 3, D, S, S) uint8, shares of the patch's largest fused value in 255ths of it.
        cues: (M, F) float32.
        sample_px: (M,) float32 disparity between two samples along the ray, px.
        centre_px: (M,) float32 disparity in the patch's middle, px.
        focus_px: (M,) float32 disparity that the extraction by focus reports, px.
        reliability: (M,) float32, that of the extraction by focus.
    """

    codes: NDArray[np.uint8]
    cues: NDArray[np.float32]
    sample_px: NDArray[np.float32]
    centre_px: NDArray[np.float32]
    focus_px: NDArray[np.float32]
    reliability: NDArray[np.float32]

    @property
    def target(self) -> NDArray[np.float32]:
        """(M,) where the true depth lies, samples from the patch's middle; farther is larger."""
        return np.asarray((self.centre_px - self.true_px) / self.sample_px, np.float32)

    @property
    def compared_error_px(self) -> NDArray[np.float32]:
        """(M,) error of the extraction by focus, px of disparity."""
        return np.asarray(np.abs(self.focus_px - self.true_px), np.float32)

    @property
    def compared_rank(self) -> NDArray[np.float32]:
        """(M,) reliability of the extraction by focus."""
        return self.reliability

    def inputs(self) -> dict[str, NDArray[Any]]:
        """Votes, cues, and what is true of them."""
        return {
            "codes": self.codes,
            "cues": self.cues,
            "sample_px": self.sample_px,
            "target": self.target,
            "focus_error_px": self.compared_error_px,
        }


@dataclass(frozen=True, eq=False)
class Swept:
    """A window after its sweep; `disparity_px` is (N,) that of each plane, px."""

    view: ReferenceView
    kept: KeptVotes
    disparity_px: NDArray[np.float64]
    result: SweepResult

    @property
    def per_rho_px(self) -> np.float64:
        """Disparity per inverse depth, px m."""
        return np.float64(self.disparity_px[0] / float(self.view.rho[0]))

    def true_px(self, sequence: EventSequence) -> Floats:
        """(H, W) true disparity, px; NaN where it is not known."""
        truth = truth_of(sequence, self.view.t_us, EvalConfig())
        true_px = np.where(truth.scored, self.per_rho_px / truth.depth_m, np.nan)
        return np.asarray(true_px, np.float32)


def swept_window(recording: Recording, config: MapperConfig, method: Method) -> Swept:
    """Sweeps one window for a method that looks at the votes again."""
    window = choose_window(recording, config)
    view = reference_view(recording, config, window.t_ref_us)
    projected = back_project(recording, window, view, [WHOLE], projector_on(CPU))
    size = view.camera.height_px, view.camera.width_px
    kept = KeptVotes(len(recording.rig), len(view.rho), *size)
    result = sweep(projected, view, [method.target(config)], config, keep=kept.take)
    baseline_m = parallax_baseline_m(recording, window)
    disparity_px = baseline_m * view.camera.fx_px * view.rho.astype(np.float64)
    return Swept(view, kept, disparity_px, result)


def window_config(window: TrainingWindow) -> MapperConfig:
    """The mapper's configuration for one window."""
    return MapperConfig(start_s=window.start_s, duration_s=window.duration_s, planes=window.planes)


def samples(sequence: EventSequence, window: TrainingWindow, most: int) -> Samples:
    """Draws at most so many candidates at random of a window whose true depth is known."""
    amount = Perturbation.model_validate(window.imperfection)
    recording = perturbed(sequence, amount, window.seed) if window.imperfection else sequence
    config, method = window_config(window), FOCUS.build(f"Focus/{window.fusion}")
    swept = swept_window(recording, config, method)
    votes, focus = swept.result.maxima[method.name], swept.result.focus[method.name]
    estimate = estimate_in_focus(votes, focus, swept.disparity_px, config)
    every = candidates(votes, focus, estimate, swept.disparity_px, config.border_px)
    true_px = swept.true_px(sequence)
    known = np.isfinite(true_px[every.rows, every.columns])
    chosen = every[_drawn(known, [window.seed, 0x5A3], most)]
    codes = [
        _logarithmic(as_patches(channels(swept.kept, method.fusion, part), len(part)))
        for part in (chosen[first : first + BATCH] for first in range(0, len(chosen), BATCH))
    ]
    empty = np.empty((0, len(CHANNELS), DEPTH, SIDE_PX, SIDE_PX), np.uint8)
    at = chosen.rows, chosen.columns
    return Samples(
        true_px=true_px[at],
        codes=np.concatenate([empty, *codes]),
        cues=chosen.cues,
        sample_px=chosen.sample_px,
        centre_px=swept.disparity_px[chosen.centres].astype(np.float32),
        focus_px=chosen.focus_px,
        reliability=estimate.reliability[at],
    )


def _drawn(known: NDArray[np.bool_], seed: Sequence[int], most: int) -> NDArray[np.int64]:
    """At most so many of those that are known, at random, in their order."""
    return np.sort(np.random.default_rng(seed).permutation(np.flatnonzero(known))[:most])


def _logarithmic(shares: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Shares as bytes of the same shape; what exceeds 4 is cut off there."""
    bits = np.ascontiguousarray(np.minimum(shares, 4) * 64 + 1).view(np.int32)
    codes: NDArray[np.uint8] = (((bits + (1 << 18)) >> 19) - (127 << 4)).clip(0, 255).astype("u1")
    return codes


def shares_of_codes() -> NDArray[np.float32]:
    """What the bytes of `Samples.codes` stand for: (256,) float32."""
    return votes_of_codes() / np.float32(64)


@dataclass(frozen=True, eq=False)
class DerdSamples(SampleSet):
    """Columns of votes.

    Attributes:
        columns: (M, PLANES, S, S) uint8, shares of the largest value in 255ths, near to far.
        near_px: (M,) float32 disparity at the near end of the depth range, px.
        far_px: (M,) float32 disparity at its far end, px.
        votes_px: (M,) float32 disparity that has most votes, px: what Algorithm 1 reports.
    """

    columns: NDArray[np.uint8]
    near_px: Floats
    far_px: Floats
    votes_px: Floats

    @property
    def compared_error_px(self) -> Floats:
        """(M,) error of Algorithm 1, px of disparity."""
        return np.asarray(np.abs(self.votes_px - self.true_px), np.float32)

    def inputs(self) -> dict[str, NDArray[Any]]:
        """Columns, what is true, and the range that both refer to."""
        return {
            "columns": self.columns,
            "true_px": self.true_px,
            "near_px": self.near_px,
            "far_px": self.far_px,
        }


def derd_windows(sequence: TrainingSequence) -> tuple[TrainingWindow, ...]:
    """The windows of a sequence that the network can read: all of it and a part, nothing wrong."""
    exact = (each for each in windows(sequence) if not each.imperfection and each.fusion == "H")
    return tuple(replace(each, planes=derd.PLANES) for each in exact)


def derd_samples(sequence: EventSequence, window: TrainingWindow, most: int) -> DerdSamples:
    """Draws at most so many pixels at random of a window whose true depth is known."""
    method = DERD.build("DERD/H")
    least = DerdParameters(threshold_c=LEAST_C)
    config = window_config(window).model_copy(update={"derd": least})
    swept = swept_window(sequence, config, method)
    true_px = swept.true_px(sequence)
    votes = swept.result.maxima[method.name]
    chosen = without_border(confidence_mask(votes.value, selecting(config)), derd.SIDE_PX // 2)
    picked = _drawn(chosen & np.isfinite(true_px), [window.seed, 0xDE2D], most)
    rows, columns = np.divmod(picked, true_px.shape[1])
    parts = columns_of(method.fusion, swept.kept, swept.view, rows, columns)
    shares = [_in_255ths(*part) for part in parts]
    span = DepthRange.of(swept.view.rho)
    voted_px = np.interp(votes.position().flat[picked], np.arange(derd.PLANES), swept.disparity_px)
    return DerdSamples(
        true_px=true_px.flat[picked],
        columns=np.concatenate(
            [np.empty((0, derd.PLANES, derd.SIDE_PX, derd.SIDE_PX), np.uint8), *shares]
        ),
        near_px=np.full(len(picked), swept.per_rho_px / span.near_m, np.float32),
        far_px=np.full(len(picked), swept.per_rho_px / span.far_m, np.float32),
        votes_px=voted_px.astype(np.float32),
    )


def _in_255ths(shares: Floats, count: int) -> NDArray[np.uint8]:
    """(B, D, S, S, L) shares of `count` pixels as (count, D, S, S) bytes."""
    pixels = np.moveaxis(shares, -1, 1).reshape(-1, *shares.shape[1:-1])[:count]
    return np.asarray(np.rint(pixels * np.float32(255)), np.uint8)
