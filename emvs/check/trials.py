"""Tries alternatives: how much more sharply rays meet under one than in the recording as given.

The sharpness is that of the harmonic mean of camera 0 and another, which also shows errors of the
poses far better than one camera does. An alternative about the poses must not make camera 0 alone
less sharp: errors between the cameras do not affect it. An alternative counts if its mean gain
exceeds a margin and every window gains; the margins come from unspoilt recordings (page `check`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from eventsweep.emvs.check.alternatives import MARGIN, Alter, Alternative, Amount
from eventsweep.emvs.check.findings import Verdict
from eventsweep.emvs.check.trial_windows import Gains, TrialWindows

# Gain on coarse volumes below which an alternative is not tried on fine ones; share of the best.
_PROMISING, _CLOSER = -0.05, 0.4
_REFINEMENTS = 3
_DOUBTFUL = 0.75  # of a margin
_ONE_CAMERA = 1.5  # times the margins: one camera separates alternatives less well
# What windows may gain on average with amounts of their own, as a share of the gain with a common
# one, or at all: right causes leave up to 0.03 of it, or 0.001; wrong ones 0.07 and more.
_UNEVEN_SHARE, _UNEVEN = 0.04, 0.002
_LOSS = -0.02  # what camera 0 alone may lose under other poses


@dataclass(frozen=True, eq=False)
class Trial:
    """The outcome of one alternative.

    Attributes:
        alternative: what was tried.
        gains: per window, logarithm of its sharpness over that of the recording as given.
        change: applies the alternative, with the best amount, to a recording.
        margin: the gain that counts; none does where only coarse volumes were looked at.
        amount: the best; None where the alternative has no amount.
        curve: amounts and mean gains that were tried.
        uneven: mean gain in log sharpness where each window may have another of these amounts.
    """

    alternative: Alternative | Amount
    gains: Gains
    change: Alter
    margin: float = np.inf
    amount: float | None = None
    curve: tuple[Gains, Gains] = (np.empty(0), np.empty(0))
    uneven: float = 0.0

    @property
    def gain(self) -> float:
        """Mean over the windows."""
        return float(self.gains.mean())

    @property
    def verdict(self) -> Verdict:
        """By the gain alone."""
        if self.gain <= _DOUBTFUL * self.margin or self.gains.min() <= 0:
            return "good"
        return "wrong" if self.gain > self.margin and self._hurts else "doubtful"

    @property
    def is_sharper(self) -> bool:
        """Whether every window gains on fine volumes, if not enough, by an amount that matters."""
        return bool(np.isfinite(self.margin) and self.gains.min() > 0 and self._hurts)

    @property
    def is_inside(self) -> bool:
        """Whether an amount is an optimum, and not at the end of its search."""
        if self.amount is None or isinstance(self.alternative, Alternative):
            return True
        grid = self.alternative.grid
        return min(grid) < self.amount < max(grid)

    @property
    def is_cause(self) -> bool:
        """Whether it may be named: an optimum, and the same one for all windows.

        A wrong amount that only makes up for another fault makes up for it differently over time.
        """
        return self.is_inside and self.uneven <= max(_UNEVEN, _UNEVEN_SHARE * self.gain)

    @property
    def _hurts(self) -> bool:
        if self.amount is None or isinstance(self.alternative, Alternative):
            return True
        return self.alternative.distance(self.amount) >= self.alternative.hurts


class CameraTrials:
    """Tries alternatives with a pair of cameras, or with one camera.

    Args:
        windows: where, fine and coarse.
        cameras: which.
        cured: trials whose cures are applied before, in their order.
    """

    def __init__(
        self, windows: tuple[TrialWindows, TrialWindows], cameras: tuple[int, ...],
        cured: tuple[Trial, ...] = (),
    ) -> None:  # fmt: skip
        self._windows, (self._fine, self._coarse) = windows, windows
        self._cameras, self._cured = cameras, cured
        self._cure = _chain(trial.change for trial in cured)
        self._cure_alone = _chain(t.change for t in cured if not t.alternative.of_pair)
        self._base = self._fine.log_sharpness(self._cure, cameras)
        self._coarse_base = self._coarse.log_sharpness(self._cure, cameras)

    def after(self, trial: Trial) -> CameraTrials:
        """The same, with one more cure applied before."""
        return CameraTrials(self._windows, self._cameras, (*self._cured, trial))

    def free_turn_gain(self) -> float:
        """Mean over the windows of what is gained where the camera may turn freely."""
        return float(self._coarse.free_turn_gains(self._cure, self._cameras).mean())

    def free_squint_gain(self) -> float:
        """Likewise where the second camera may be turned on the rig; 0 of a single camera."""
        if len(self._cameras) == 1:
            return 0.0
        first, second = self._cameras
        return float(self._coarse.free_squint_gains(self._cure, (first, second)).mean())

    def gain_alone(self, alternatives: Iterable[Alternative]) -> float:
        """The largest mean gain of camera 0 alone under one of these mistakes about its poses.

        What is wrong between the cameras cannot hide it.
        """
        base = self._coarse.log_sharpness(self._cure_alone, (0,))
        changes = [self._after_cure_alone(one.change) for one in alternatives]
        gains = [(self._coarse.log_sharpness(c, (0,)) - base).mean() for c in changes]
        return float(max(gains, default=0.0))

    def trials(
        self, alternatives: Iterable[Alternative | Amount], most: int | None = None
    ) -> list[Trial]:
        """The outcomes: of all on coarse volumes, and of those that may matter on fine ones.

        Args:
            alternatives: what to try.
            most: how many to try on fine volumes, those that gain most; None for no such limit.
        """
        coarse = [self._coarse_trial(alternative) for alternative in alternatives]
        gains = sorted((trial.gain for trial in coarse), reverse=True)[:most]
        least = max(_PROMISING, _CLOSER * gains[0], gains[-1])
        return [self._closer(trial) if trial.gain >= least else trial for trial in coarse]

    def trial(self, alternative: Alternative | Amount) -> Trial:
        """The outcome of one alternative."""
        return self._closer(self._coarse_trial(alternative))

    def best(self, trials: Sequence[Trial]) -> Trial:
        """The trial with the largest gain among those that do not contradict camera 0 alone."""
        in_order = sorted(trials, key=lambda t: (t.verdict == "wrong", t.gain), reverse=True)
        return next(trial for trial in in_order if self.agrees(trial))

    def agrees(self, trial: Trial) -> bool:
        """Whether camera 0 alone is no less sharp under other poses."""
        if trial.verdict == "good" or trial.alternative.of_pair or len(self._cameras) == 1:
            return True
        alone = self._fine.log_sharpness(self._after_cure_alone(trial.change), (0,))
        return bool((alone - self._fine.log_sharpness(self._cure_alone, (0,))).mean() >= _LOSS)

    def margin(self, margin: float) -> float:
        """That of a pair, or more of a single camera."""
        return margin * (1.0 if len(self._cameras) > 1 else _ONE_CAMERA)

    def _coarse_trial(self, alternative: Alternative | Amount) -> Trial:
        if isinstance(alternative, Alternative):
            gains = self._coarse_gains(alternative.change)
            return Trial(alternative, gains, alternative.change)
        others = [x for x in alternative.grid if x != alternative.neutral]
        tried = {x: self._coarse_gains(_with_amount(alternative, x)) for x in others}
        return _peak_trial(alternative, tried | self._nothing(alternative))

    def _closer(self, trial: Trial) -> Trial:
        """The same on fine volumes: an amount between the neighbours of the best on coarse ones."""
        alternative = trial.alternative
        if isinstance(alternative, Alternative):
            gains = self._gains(trial.change)
            return Trial(alternative, gains, trial.change, self.margin(MARGIN))
        if trial.amount is None or alternative.distance(trial.amount) < alternative.hurts / 6:
            return trial
        tried = self._nothing(alternative) | self._finely(alternative, _nearest(trial))
        peak = _peak(alternative, tried)
        # Only a peak away from the neutral amount is worth a finer look.
        if alternative.distance(peak) >= alternative.hurts / 3:
            for _ in range(_REFINEMENTS):
                tried |= self._finely(alternative, _between(alternative, tried))
        return _peak_trial(alternative, tried, self.margin(alternative.margin))

    def _nothing(self, amount: Amount) -> dict[float, Gains]:
        return {amount.neutral: np.zeros_like(self._base)}

    def _finely(self, amount: Amount, xs: Iterable[float]) -> dict[float, Gains]:
        return {x: self._gains(_with_amount(amount, x)) for x in xs if x != amount.neutral}

    def _gains(self, change: Alter) -> Gains:
        both = self._after_cure(change)
        return self._fine.log_sharpness(both, self._cameras) - self._base

    def _coarse_gains(self, change: Alter) -> Gains:
        both = self._after_cure(change)
        return self._coarse.log_sharpness(both, self._cameras) - self._coarse_base

    def _after_cure(self, change: Alter) -> Alter:
        return lambda recording: change(self._cure(recording))

    def _after_cure_alone(self, change: Alter) -> Alter:
        return lambda recording: change(self._cure_alone(recording))


def _chain(changes: Iterable[Alter]) -> Alter:
    """One change after the other."""
    in_order = tuple(changes)
    return lambda recording: reduce(lambda r, change: change(r), in_order, recording)


def _with_amount(amount: Amount, x: float) -> Alter:
    return lambda recording: amount.change(recording, x)


def _sorted(tried: dict[float, Gains]) -> tuple[Gains, Gains]:
    """(N,) amounts in order and (N, W) their gains."""
    xs = sorted(tried)
    return np.array(xs), np.array([tried[x] for x in xs])


def _peak_trial(amount: Amount, tried: dict[float, Gains], margin: float = np.inf) -> Trial:
    xs, gains = _sorted(tried)
    means, peak = gains.mean(axis=1), _peak(amount, tried)
    best = gains[int(means.argmax())]
    uneven = float((gains.max(axis=0) - best).mean())
    return Trial(amount, best, _with_amount(amount, peak), margin, peak, (xs, means), uneven)


def _nearest(trial: Trial) -> list[float]:
    """The best amount that was tried, and its neighbours."""
    xs, means = trial.curve
    best = int(means.argmax())
    return [float(x) for x in xs[max(0, best - 1) : best + 2]]


def _between(amount: Amount, tried: dict[float, Gains]) -> list[float]:
    """The middles between the best amount and its neighbours; of factors, geometric ones."""
    xs = sorted(tried)
    best = max(range(len(xs)), key=lambda k: tried[xs[k]].mean())
    near = [xs[k] for k in (best - 1, best + 1) if 0 <= k < len(xs)]
    return [float(np.sqrt(xs[best] * x)) if amount.is_factor else (xs[best] + x) / 2 for x in near]


def _peak(amount: Amount, tried: dict[float, Gains]) -> float:
    """Where the mean gain peaks, between amounts that were tried."""
    xs, gains = _sorted(tried)
    means = gains.mean(axis=1)
    best = int(means.argmax())
    if not 0 < best < len(xs) - 1:
        return float(xs[best])
    scale, near = np.log(xs) if amount.is_factor else xs, slice(best - 1, best + 2)
    peak = _vertex(scale[near], means[near])
    return float(np.exp(peak)) if amount.is_factor else peak


def _vertex(x: Gains, y: Gains) -> float:
    """Of the parabola through three points, within them; the highest point if it has no top."""
    a, b, _ = np.polyfit(x - x[1], y, 2)
    if a >= 0:
        return float(x[int(np.argmax(y))])
    return float(np.clip(x[1] - b / (2 * a), x[0], x[2]))
