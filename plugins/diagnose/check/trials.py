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

from eventsweep.plugins.diagnose.check.alternatives import MARGIN, Alter, Alternative, Chosen
from eventsweep.plugins.diagnose.check.amounts import Amount
from eventsweep.plugins.diagnose.check.findings import Verdict
from eventsweep.plugins.diagnose.check.trial_windows import Gains, TrialWindows

# Gain below which an alternative is not looked at more closely; share of the best that is: in all
# windows what gained in one, and on fine volumes what gained on coarse ones.
_PROMISING, _WORTH_ALL_WINDOWS, _WORTH_FINE = -0.05, 0.25, 0.4
_REFINEMENTS = 3
_DOUBTFUL = 0.75  # of a margin
_ONE_CAMERA = 1.5  # times the margins: one camera separates alternatives less well
# What windows may gain on average with amounts of their own, as a share of the gain with a common
# one, or at all: right causes leave up to 0.03 of it, or 0.001; wrong ones 0.07 and more.
_UNEVEN_SHARE, _UNEVEN = 0.04, 0.002
_LOSS = -0.02  # what camera 0 alone may lose under other poses
# An amount is traded for another that is so many times what hurts from its best, if that costs no
# more sharpness than this: right causes lost 0.0012 and more, those with another fault gained.
_FAR, _AS_SHARP, _WORTH_TRADING, _READINGS = 4, 0.001, 0.02, 8


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

    alternative: Alternative | Amount
    gains: Gains
    change: Alter
    margin: float = np.inf
    amount: float | None = None
    tried: dict[float, Gains] = field(default_factory=dict)

    @property
    def curve(self) -> tuple[Gains, Gains]:
        """(N,) amounts that were tried, in order, and their mean gains on coarse volumes."""
        xs, gains = _sorted(self.tried)
        return xs, gains.mean(axis=1)

    @property
    def uneven(self) -> float:
        """Mean gain in log sharpness where each window may have another of these amounts."""
        if not self.tried:
            return 0.0
        _, gains = _sorted(self.tried)
        return float((gains.max(axis=0) - gains[int(gains.mean(axis=1).argmax())]).mean())

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
    def is_common(self) -> bool:
        """Whether an amount is the same for all windows.

        What only makes up for another fault makes up for it differently over time.
        """
        return self.uneven <= max(_UNEVEN, _UNEVEN_SHARE * self.gain)

    @property
    def is_cause(self) -> bool:
        """Whether it may be named: an optimum, and the same one for all windows."""
        return self.is_inside and self.is_common

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
        changes, whose = [self._alone(one.change) for one in alternatives], self._cameras
        seen = [leading.log_sharpness(c, whose)[0] - self._base_alone[first] for c in changes]
        likely = [c for c, gain in zip(changes, seen, strict=True) if gain > MARGIN / 2]
        gains = [(self._coarse.log_sharpness(c, whose) - self._base_alone).mean() for c in likely]
        return float(max(gains, default=0.0))

    def trials(
        self, alternatives: Iterable[Alternative | Amount], most: int | None = None
    ) -> list[Trial]:
        """The outcomes: of all in one window, and of those that may matter in all, last finely.

        Args:
            alternatives: what to try.
            most: how many to try on fine volumes, those that gain most; None for no such limit.
        """
        glances = [self._glance(alternative) for alternative in alternatives]
        coarse = _again(self._in_all_windows, glances, _WORTH_ALL_WINDOWS, None)
        return _again(self._finely, coarse, _WORTH_FINE, most)

    def trial(self, alternative: Alternative | Amount) -> Trial:
        """The outcome of one alternative."""
        return self._finely(self._in_all_windows(self._glance(alternative)))

    def best(self, trials: Sequence[Trial]) -> Trial:
        """The trial with the largest gain among those that do not contradict camera 0 alone."""
        in_order = sorted(trials, key=lambda t: (t.verdict == "wrong", t.gain), reverse=True)
        return next(trial for trial in in_order if self.agrees(trial))

    def agrees(self, trial: Trial) -> bool:
        """Whether camera 0 alone is no less sharp under other poses."""
        if trial.verdict == "good" or trial.alternative.of_pair or len(self._cameras) == 1:
            return True
        alone = self._coarse.log_sharpness(self._alone(trial.change), self._cameras)
        return bool((alone - self._base_alone).mean() >= _LOSS)

    def is_traded(self, trial: Trial, other: Amount) -> bool:
        """Whether windows stay as sharp with another amount far off, and this one found anew.

        Then both may be wrong: a camera that moves steadily along the baseline sees no difference
        between a longer baseline and a late camera.
        """
        far = _FAR * other.hurts
        return any(self._lost_beside(trial, other, by) < _AS_SHARP for by in (-far, far))

    def _lost_beside(self, trial: Trial, other: Amount, by: float) -> float:
        """The sharpness that is lost if `other` is off `by` and the trial's amount follows."""
        amount, best = trial.alternative, trial.amount
        assert isinstance(amount, Amount)
        assert best is not None
        beside = _with_amount(other, other.moved(other.neutral, by))

        def change(by: float) -> Alter:
            return _chain((_with_amount(amount, amount.moved(best, by)), beside))

        far = _FAR * amount.hurts
        found = minimize_scalar(
            lambda by: -self._leading_gains(change(by)).mean(), bounds=(-far, far),
            method="bounded", options={"maxiter": _READINGS},
        )  # fmt: skip
        lost = float(self._leading_gains(trial.change).mean() + found.fun)
        if lost > _WORTH_TRADING:
            return lost
        gains = self._coarse_gains(trial.change) - self._coarse_gains(change(found.x))
        return float(gains.mean())

    def margin(self, margin: float) -> float:
        """That of a pair, or more of a single camera."""
        return margin * (1.0 if len(self._cameras) > 1 else _ONE_CAMERA)

    def _glance(self, alternative: Alternative | Amount) -> Trial:
        """In the leading window alone: what does not help there is not tried in the others."""
        if isinstance(alternative, Alternative):
            return Trial(alternative, self._leading_gains(alternative.change), alternative.change)
        tried = {x: self._leading_gains(_with_amount(alternative, x)) for x in alternative.grid
                 if x != alternative.neutral}  # fmt: skip
        return _peak_trial(alternative, tried | {alternative.neutral: np.zeros(1)})

    def _in_all_windows(self, trial: Trial) -> Trial:
        """The same in all windows: of an amount the best, and its neighbours."""
        alternative = trial.alternative
        if isinstance(alternative, Alternative):
            return Trial(alternative, self._coarse_gains(trial.change), trial.change)
        if trial.amount is None or alternative.distance(trial.amount) < alternative.hurts / 6:
            return trial
        nothing = {alternative.neutral: np.zeros_like(self._base)}
        return _peak_trial(alternative, nothing | self._of_amounts(alternative, _nearest(trial)))

    def _finely(self, trial: Trial) -> Trial:
        """The same on fine volumes: an amount after its line search on coarse ones."""
        alternative = trial.alternative
        if isinstance(alternative, Alternative):
            gains = self._fine_gains(trial.change)
            return Trial(alternative, gains, trial.change, self.margin(MARGIN))
        if trial.amount is None or trial.gains.shape != self._base.shape:
            return trial
        trial = self._refined(alternative, trial)
        gains = self._fine_gains(trial.change)
        return replace(trial, gains=gains, margin=self.margin(alternative.margin))

    def _refined(self, amount: Amount, trial: Trial) -> Trial:
        for _ in range(_REFINEMENTS):
            # Only a peak away from the neutral amount is worth a finer look.
            if trial.amount is None or amount.distance(trial.amount) < amount.hurts / 3:
                break
            between = self._of_amounts(amount, _between(amount, trial.tried))
            trial = _peak_trial(amount, trial.tried | between)
        return trial

    def _of_amounts(self, amount: Amount, xs: Iterable[float]) -> dict[float, Gains]:
        others = (x for x in xs if x != amount.neutral)
        return {x: self._coarse_gains(_with_amount(amount, x)) for x in others}

    def _leading_gains(self, change: Alter) -> Gains:
        leading, at = self._coarse.leading, self._coarse.leading_at
        sharp = leading.log_sharpness(self._after_cure(change), self._cameras)
        return sharp - self._coarse_base[at : at + 1]

    def _coarse_gains(self, change: Alter) -> Gains:
        both = self._after_cure(change)
        return self._coarse.log_sharpness(both, self._cameras) - self._coarse_base

    def _fine_gains(self, change: Alter) -> Gains:
        return self._fine.log_sharpness(self._after_cure(change), self._cameras) - self._base

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
    least = max(_PROMISING, share * gains[0], gains[-1])
    return [look(t) if t.gain >= least and len(t.gains) == windows else t for t in trials]


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


def _peak_trial(amount: Amount, tried: dict[float, Gains]) -> Trial:
    peak, best = _peak(amount, tried), max(tried.values(), key=np.mean)
    return Trial(amount, best, _with_amount(amount, peak), amount=peak, tried=tried)


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
