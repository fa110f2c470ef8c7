"""From a sequence to what a network learns from: candidates, the votes around them, true depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence as EventSequence
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
from eventsweep.eval.scoring.pairing import Truth
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.networks.inputs import (
    BATCH,
    Candidates,
    as_patches,
    candidates,
    channels,
)
from eventsweep.plugins.learned.networks.network import CHANNELS, DEPTH, SIDE_PX
from eventsweep.plugins.learned.training.sequences import TrainingWindow


@dataclass(frozen=True, eq=False)
class Shown:
    """One window as the network sees it: everything but the truth.

    Attributes:
        disparity_px: (N,) disparity of each plane, px.
        reliability: (M,) float32, that of the extraction by focus.
    """

    method: Method
    view: ReferenceView
    kept: KeptVotes
    chosen: Candidates
    disparity_px: NDArray[np.float64]
    reliability: NDArray[np.float32]


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
        return type(self)(**{one.name: getattr(self, one.name)[part] for one in fields(self)})

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Several in one, in their order."""
        names = [one.name for one in fields(cls)]
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
            np.savez(file, **{one.name: getattr(self, one.name) for one in fields(self)})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote."""
        with np.load(path, allow_pickle=False) as archive:
            return cls(**{one.name: archive[one.name] for one in fields(cls)})


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


def show(recording: Recording, config: MapperConfig, method: Method) -> Shown:
    """Sweeps one window and lists its candidates."""
    return shown_of(swept_window(recording, config, method), config, method)


def shown_of(swept: Swept, config: MapperConfig, method: Method) -> Shown:
    """Lists the candidates of a window after its sweep."""
    votes, focus = swept.result.maxima[method.name], swept.result.focus[method.name]
    estimate = estimate_in_focus(votes, focus, swept.disparity_px, config)
    chosen = candidates(votes, focus, estimate, swept.disparity_px, config.border_px)
    reliability = estimate.reliability[chosen.rows, chosen.columns]
    return Shown(method, swept.view, swept.kept, chosen, swept.disparity_px, reliability)


def window_config(window: TrainingWindow) -> MapperConfig:
    """The mapper's configuration for one window."""
    return MapperConfig(start_s=window.start_s, duration_s=window.duration_s, planes=window.planes)


def samples(sequence: EventSequence, window: TrainingWindow, most: int) -> Samples:
    """Draws at most so many candidates at random of a window whose true depth is known."""
    amount = Perturbation.model_validate(window.imperfection)
    recording = perturbed(sequence, amount, window.seed) if window.imperfection else sequence
    shown = show(recording, window_config(window), FOCUS.build(f"Focus/{window.fusion}"))
    true_px = true_disparity_px(shown, truth_of(sequence, shown.view.t_us, EvalConfig()))
    known = np.flatnonzero(np.isfinite(true_px))
    rng = np.random.default_rng([window.seed, 0x5A3])
    picked = np.sort(rng.permutation(known)[:most])
    return drawn(shown, picked, true_px)


def true_disparity_px(shown: Shown, truth: Truth) -> NDArray[np.float32]:
    """(M,) true disparity of each candidate, px; NaN where it is not known."""
    chosen = shown.chosen
    depth_m = np.where(truth.scored, truth.depth_m, np.nan)[chosen.rows, chosen.columns]
    per_rho = shown.disparity_px[0] / float(shown.view.rho[0])
    return np.asarray(per_rho / depth_m, np.float32)


def drawn(shown: Shown, picked: NDArray[np.int64], true_px: NDArray[np.float32]) -> Samples:
    """The samples of some candidates, by their numbers."""
    chosen = shown.chosen[picked]
    codes = [
        _in_255ths(as_patches(channels(shown.kept, shown.method.fusion, part), len(part)))
        for part in (chosen[first : first + BATCH] for first in range(0, len(chosen), BATCH))
    ]
    empty = np.empty((0, len(CHANNELS), DEPTH, SIDE_PX, SIDE_PX), np.uint8)
    return Samples(
        true_px=true_px[picked],
        codes=np.concatenate([empty, *codes]),
        cues=chosen.cues,
        sample_px=chosen.sample_px,
        centre_px=shown.disparity_px[chosen.centres].astype(np.float32),
        focus_px=chosen.focus_px,
        reliability=shown.reliability[picked],
    )


def _in_255ths(shares: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Shares as bytes of the same shape; what exceeds 4 is cut off there."""
    bits = np.ascontiguousarray(np.minimum(shares, 4) * 64 + 1).view(np.int32)
    codes: NDArray[np.uint8] = (((bits + (1 << 18)) >> 19) - (127 << 4)).clip(0, 255).astype("u1")
    return codes


def shares_of_codes() -> NDArray[np.float32]:
    """What the bytes of `Samples.codes` stand for: (256,) float32."""
    return votes_of_codes() / np.float32(64)
