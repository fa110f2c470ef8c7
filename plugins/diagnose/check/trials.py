"""Tries alternatives: how much more sharply rays meet under one than in the recording as given.

The sharpness is that of the harmonic mean of camera 0 and another, which also shows errors of the
poses far better than one camera does. An alternative about the poses must not make camera 0 alone
less sharp: errors between the cameras do not affect it. An alternative counts if its mean gain
exceeds a margin and every window gains; the margins come from unspoilt recordings (page `check`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce

import numpy as np
from scipy.optimize import minimize_scalar

from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.alternatives import Alter, Alternative, Amount, Chosen
from eventsweep.plugins.diagnose.check.limits import MARGIN, Verdict
from eventsweep.plugins.diagnose.check.trial_windows import Gains, TrialWindows


@dataclass(frozen=True, eq=False)
class Trial:
    """The outcome of one alternative.

    Attributes:
        alternative: what was tried.
        gains: per window, logarithm of its sharpness over that of the recording as given.
        change: applies the alternative, with the best amount, to a recording.
        margin: the gain that counts; none does where only coarse volumes were looked at.
        amount: the best; None where the alternative has no amount.
        tried: of the amounts that were tried on coarse volumes, the gains per window.
    """

    alternative: Alternative
    gains: Gains
    change: Alter
    margin: float = np.inf
    amount: float | None = None
    tried: dict[float, Gains] = field(default_factory=dict)

    @property
    def curve(self) -> tuple[Gains, Gains]:
        """(N,) amounts that were tried, in order, and their (N, W) gains on coarse volumes."""
        amounts = sorted(self.tried)
        return np.array(amounts), np.array([self.tried[amount] for amount in amounts])

    @property
    def uneven(self) -> float:
        """Mean gain in log sharpness where each window may have another of these amounts."""
        if not self.tried:
            return 0.0
        _, gains = self.curve
        return float((gains.max(axis=0) - gains[int(gains.mean(axis=1).argmax())]).mean())

    @property
    def gain(self) -> float:
        """Mean over the windows."""
        return float(self.gains.mean())

    @property
    def verdict(self) -> Verdict:
        """By the gain alone."""
        if self.gain <= limits.DOUBTFUL * self.margin or self.gains.min() <= 0:
            return "good"
        return "wrong" if self.gain > self.margin and self._hurts else "doubtful"

    @property
    def is_sharper(self) -> bool:
        """Whether every window gains on fine volumes, if not enough, by an amount that matters."""
        return bool(np.isfinite(self.margin) and self.gains.min() > 0 and self._hurts)

    @property
    def is_inside(self) -> bool:
        """Whether an amount is an optimum, and not at the end of its search."""
        if self.amount is None or not isinstance(self.alternative, Amount):
            return True
        grid = self.alternative.grid
        return min(grid) < self.amount < max(grid)

    @property
    def is_common(self) -> bool:
        """Whether an amount is the same for all windows.

        What only makes up for another fault makes up for it differently over time.
        """
        return self.uneven <= max(limits.UNEVEN, limits.UNEVEN_SHARE * self.gain)

    @property
    def is_cause(self) -> bool:
        """Whether it may be named: an optimum, and the same one for all windows."""
        return self.is_inside and self.is_common

    @property
    def _hurts(self) -> bool:
        if self.amount is None or not isinstance(self.alternative, Amount):
            return True
        return self.alternative.distance(self.amount) >= self.alternative.hurts

    @classmethod
    def at_peak(cls, amount: Amount, tried: dict[float, Gains]) -> Trial:
        """Where the mean gain of an amount peaks, between amounts that were tried."""
        best = max(tried.values(), key=np.mean)
        trial = cls(amount, best, amount.by(amount.neutral), tried=tried)
        at, gains = trial.curve
        scale, means = np.log(at) if amount.is_factor else at, gains.mean(axis=1)
        top, peak = int(means.argmax()), float(at[int(means.argmax())])
        if 0 < top < len(at) - 1:
            near = slice(top - 1, top + 2)
            vertex = _vertex(scale[near], means[near])
            peak = float(np.exp(vertex)) if amount.is_factor else vertex
        return replace(trial, amount=peak, change=amount.by(peak))


def _vertex(x: Gains, y: Gains) -> float:
    """Of the parabola through three points, within them; the highest point if it has no top."""
    a, b, _ = np.polyfit(x - x[1], y, 2)
    if a >= 0:
        return float(x[int(np.argmax(y))])
    return float(np.clip(x[1] - b / (2 * a), x[0], x[2]))


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
        self._after: dict[Trial, CameraTrials] = {}
        self._cure = _chain(trial.change for trial in cured)
        self._base, self._coarse_base = (w.log_sharpness(self._cure, cameras) for w in windows)
        self._base_alone = self._coarse.log_sharpness(self._alone(lambda r: r), cameras)

    def after(self, trial: Trial) -> CameraTrials:
        """The same, with one more cure applied before; the same object each time."""
        if trial not in self._after:
            cured = (*self._cured, trial)
            self._after[trial] = CameraTrials(self._windows, self._cameras, cured)
        return self._after[trial]

    @cached_property
    def free_turn_gains(self) -> Gains:
        """(W,) what is gained where the camera may turn freely."""
        return self._coarse.free_turn_gains(self._cure, self._cameras)

    @cached_property
    def free_squint_gains(self) -> Gains:
        """(W,) likewise where the second camera may be turned on the rig; 0 of a single camera."""
        if len(self._cameras) == 1:
            return np.zeros(1)
        first, second = self._cameras
        return self._coarse.free_squint_gains(self._cure, (first, second))

    @cached_property
    def agreement(self) -> float:
        """How well the cameras agree, on average (`TrialWindows.agreement`); 0 of a single one."""
        if len(self._cameras) == 1:
            return 0.0
        first, second = self._cameras
        return float(self._coarse.agreement(self._cure, (first, second)).mean())

    def gain_alone(self, alternatives: Iterable[Alternative]) -> float:
        """The largest mean gain of camera 0 alone under one of these mistakes about its poses.

        What is wrong between the cameras cannot hide it.
        """
        leading, first = self._coarse.leading, self._coarse.leading_at
        changes, cameras = [self._alone(a.change) for a in alternatives], self._cameras
        seen = [leading.log_sharpness(c, cameras)[0] - self._base_alone[first] for c in changes]
        likely = [c for c, gain in zip(changes, seen, strict=True) if gain > MARGIN / 2]
        gains = [(self._coarse.log_sharpness(c, cameras) - self._base_alone).mean() for c in likely]
        return float(max(gains, default=0.0))

    def trials(self, alternatives: Iterable[Alternative], most: int | None = None) -> list[Trial]:
        """The outcomes: of all in one window, and of those that may matter in all, last finely.

        Args:
            alternatives: what to try.
            most: how many to try on fine volumes, those that gain most; None for no such limit.
        """
        glances = [self._glance(alternative) for alternative in alternatives]
        coarse = _again(self._in_all_windows, glances, limits.WORTH_ALL_WINDOWS, None)
        return _again(self._finely, coarse, limits.WORTH_FINE, most)

    def best(self, trials: Sequence[Trial]) -> Trial:
        """The trial with the largest gain among those that do not contradict camera 0 alone."""
        in_order = sorted(trials, key=lambda t: (t.verdict == "wrong", t.gain), reverse=True)
        return next(trial for trial in in_order if self.agrees(trial))

    def agrees(self, trial: Trial) -> bool:
        """Whether camera 0 alone is no less sharp under other poses."""
        if trial.verdict == "good" or trial.alternative.of_pair or len(self._cameras) == 1:
            return True
        alone = self._coarse.log_sharpness(self._alone(trial.change), self._cameras)
        return bool((alone - self._base_alone).mean() >= limits.LOSS)

    def is_traded(self, trial: Trial, other: Amount) -> bool:
        """Whether windows stay as sharp with another amount far off, and this one found anew.

        Then both may be wrong: a camera that moves steadily along the baseline sees no difference
        between a longer baseline and a late camera.
        """
        far = limits.FAR * other.hurts
        return any(self._lost_beside(trial, other, by) < limits.AS_SHARP for by in (-far, far))

    def _lost_beside(self, trial: Trial, other: Amount, by: float) -> float:
        """The sharpness that is lost if `other` is off `by` and the trial's amount follows."""
        amount, best = trial.alternative, trial.amount
        assert isinstance(amount, Amount)
        assert best is not None
        beside, far = other.by(other.moved(other.neutral, by)), limits.FAR * amount.hurts

        def change(by: float) -> Alter:
            return _chain((amount.by(amount.moved(best, by)), beside))

        nearest = minimize_scalar(
            lambda by: -self._leading_gains(change(by)).mean(), bounds=(-far, far),
            method="bounded", options={"maxiter": limits.READINGS},
        )  # fmt: skip
        lost = float(self._leading_gains(trial.change).mean() + nearest.fun)
        if lost > limits.WORTH_TRADING:
            return lost
        gains = self._coarse_gains(trial.change) - self._coarse_gains(change(nearest.x))
        return float(gains.mean())

    def margin(self, margin: float) -> float:
        """That of a pair, or more of a single camera."""
        return margin * (1.0 if len(self._cameras) > 1 else limits.ONE_CAMERA)

    def _glance(self, alternative: Alternative) -> Trial:
        """In the leading window alone: what does not help there is not tried in the others."""
        if not isinstance(alternative, Amount):
            return Trial(alternative, self._leading_gains(alternative.change), alternative.change)
        neutral = alternative.neutral
        amounts = [amount for amount in alternative.grid if amount != neutral]
        tried = {amount: self._leading_gains(alternative.by(amount)) for amount in amounts}
        return Trial.at_peak(alternative, tried | {neutral: np.zeros(1)})

    def _in_all_windows(self, trial: Trial) -> Trial:
        """The same in all windows: of an amount the best, and its neighbours."""
        alternative = trial.alternative
        if not isinstance(alternative, Amount):
            return Trial(alternative, self._coarse_gains(trial.change), trial.change)
        if trial.amount is None or alternative.distance(trial.amount) < alternative.hurts / 6:
            return trial
        amounts, gains = trial.curve
        best = int(gains.mean(axis=1).argmax())
        near = self._of_amounts(alternative, amounts[max(0, best - 1) : best + 2].tolist())
        return Trial.at_peak(alternative, {alternative.neutral: np.zeros_like(self._base)} | near)

    def _finely(self, trial: Trial) -> Trial:
        """The same on fine volumes: an amount after its line search on coarse ones."""
        alternative = trial.alternative
        if isinstance(alternative, Amount):
            if trial.amount is None or trial.gains.shape != self._base.shape:
                return trial
            trial = self._refined(alternative, trial)
        gains = self._fine.log_sharpness(self._after_cure(trial.change), self._cameras)
        return replace(trial, gains=gains - self._base, margin=self.margin(alternative.margin))

    def _refined(self, amount: Amount, trial: Trial) -> Trial:
        """Bisects thrice between the best amount and its neighbours; of factors, geometrically."""
        for _ in range(limits.REFINEMENTS):
            # Only a peak away from the neutral amount is worth a finer look.
            if trial.amount is None or amount.distance(trial.amount) < amount.hurts / 3:
                break
            at, gains = trial.curve
            best = int(gains.mean(axis=1).argmax())
            near = [at[k] for k in (best - 1, best + 1) if 0 <= k < len(at)]
            middles = [
                float(np.sqrt(at[best] * x) if amount.is_factor else (at[best] + x) / 2)
                for x in near
            ]
            tried = trial.tried | self._of_amounts(amount, middles)
            trial = Trial.at_peak(amount, tried)
        return trial

    def _of_amounts(self, amount: Amount, values: Iterable[float]) -> dict[float, Gains]:
        tried = (value for value in values if value != amount.neutral)
        return {value: self._coarse_gains(amount.by(value)) for value in tried}

    def _leading_gains(self, change: Alter) -> Gains:
        leading, at = self._coarse.leading, self._coarse.leading_at
        sharp = leading.log_sharpness(self._after_cure(change), self._cameras)
        return sharp - self._coarse_base[at : at + 1]

    def _coarse_gains(self, change: Alter) -> Gains:
        both = self._after_cure(change)
        return self._coarse.log_sharpness(both, self._cameras) - self._coarse_base

    def _after_cure(self, change: Alter) -> Alter:
        return lambda recording: change(self._cure(recording))

    def _alone(self, change: Alter) -> Alter:
        return lambda recording: Chosen(change(self._cure(recording)), (0,))


def _again(
    look: Callable[[Trial], Trial], trials: Sequence[Trial], share: float, most: int | None
) -> list[Trial]:
    """Trials of which those that may matter are looked at more closely.

    Args:
        look: does so.
        trials: only those in as many windows as any are compared.
        share: of the best gain that is enough.
        most: how many at most; None for no such limit.
    """
    windows = max(len(trial.gains) for trial in trials)
    gains = sorted((t.gain for t in trials if len(t.gains) == windows), reverse=True)[:most]
    least = max(limits.PROMISING, share * gains[0], gains[-1])
    return [look(t) if t.gain >= least and len(t.gains) == windows else t for t in trials]


def _chain(changes: Iterable[Alter]) -> Alter:
    """One change after the other."""
    in_order = tuple(changes)
    return lambda recording: reduce(lambda r, change: change(r), in_order, recording)
