"""Checks by mapping: do rays meet more sharply under an alternative? Then something is wrong.

Three windows are mapped as given, and again under every alternative; the sharpness of their volumes
is compared (`emvs.sharpness`): of the harmonic mean of camera 0 and each other, which also shows
errors of the poses far better than one camera does. An alternative about the poses must not make
camera 0 alone less sharp: errors between the cameras do not affect it. Windows keep the same events
under all alternatives, so that more votes never look like sharper ones. An alternative counts if
its mean gain exceeds a margin and every window gains; the margins come from unspoilt recordings
(page `check`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.check.alternatives import (
    MARGIN,
    Alter,
    Alternative,
    Amount,
    Chosen,
    amounts_of_one,
    amounts_of_pair,
    of_pair,
    of_poses,
)
from eventsweep.emvs.check.findings import Finding, Series, Verdict
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.sharpness import Hypothesis, Level, Sharpness, WindowEvents
from eventsweep.emvs.utils.runtime import Progress, silent, use_threads

Gains = NDArray[np.float64]
WINDOWS, WINDOW_US, EVENTS, LEVEL = 3, 200_000, 25_000, Level(1, 80)
_COARSE, _COARSE_SHARE = Level(2, 40), 0.4  # to see which alternatives are worth a finer look
_CANDIDATES = 24
_PROMISING = -0.05  # gain on coarse volumes: below it an alternative is not tried on fine ones
_REFINEMENTS = 3
_DOUBTFUL = 0.75  # of a margin
_ONE_CAMERA = 1.5  # times the margins: one camera separates alternatives less well
_LOSS = -0.02  # what camera 0 alone may lose under other poses
_BARS = 12  # alternatives in the page, the best ones
_NOTHING = 1e-3  # the sharpness, in votes, of an empty volume


class WindowRecording(DerivedRecording):
    """A recording whose events are those of one window, thinned evenly and kept in memory."""

    def __init__(self, recording: Recording, t0_us: int, t1_us: int, most: int) -> None:
        super().__init__(recording)
        cameras = range(len(recording.rig))
        self._streams = [recording.events(k, t0_us, t1_us).thinned(most) for k in cameras]

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """The kept events of a camera with `t0_us <= t < t1_us`."""
        return self._streams[camera].between(t0_us, t1_us)

    def thinned(self, share: float) -> WindowRecording:
        """The same window with a share of its events, evenly through the streams."""
        fewer = copy(self)
        fewer._streams = [s.thinned(max(1, int(share * len(s)))) for s in self._streams]
        return fewer


@dataclass(frozen=True, eq=False)
class TrialWindows:
    """The windows on which alternatives are compared.

    Attributes:
        windows: each with its events in memory.
        middles_us: the times of their reference views.
        sharpness: of windows under hypotheses.
    """

    windows: tuple[WindowRecording, ...]
    middles_us: tuple[int, ...]
    sharpness: Sharpness

    @classmethod
    def of(cls, recording: Recording, config: MapperConfig) -> tuple[TrialWindows, TrialWindows]:
        """The windows with the longest ways among those that poses and events cover.

        Fine ones, and the same with fewer events in coarse volumes.

        Raises:
            InputError: poses and events cover no window together.
        """
        use_threads(config.threads)
        begins, range_m = _begins(recording), depth_range_m(recording, config)
        windows = tuple(WindowRecording(recording, t, t + WINDOW_US, EVENTS) for t in begins)
        middles_us = tuple(t + WINDOW_US // 2 for t in begins)
        fewer = tuple(window.thinned(_COARSE_SHARE) for window in windows)
        return (
            cls(windows, middles_us, Sharpness(range_m, LEVEL)),
            cls(fewer, middles_us, Sharpness(range_m, _COARSE)),
        )

    def log_sharpness(self, change: Alter, cameras: tuple[int, ...]) -> Gains:
        """(W,) logarithm of the windows' sharpness under an alternative.

        Args:
            change: applies the alternative to a recording of the chosen cameras.
            cameras: one, or a pair that is fused.
        """
        recordings = [change(Chosen(window, cameras)) for window in self.windows]
        windows = list(map(_all_events, recordings, self.middles_us))
        try:
            votes = self.sharpness(windows, [Hypothesis(r.rig, r.trajectory) for r in recordings])
        except InputError:  # poses elsewhere, events off the sensor: nothing is sharp
            votes = np.zeros(len(windows))
        return np.log(np.maximum(votes, _NOTHING))


def _all_events(window: Recording, t_ref_us: int) -> WindowEvents:
    """All kept events, in a stretch around the reference view that just holds them."""
    far_us = 10 * WINDOW_US  # beyond any clock
    cameras = range(len(window.rig))
    events = [window.events(k, t_ref_us - far_us, t_ref_us + far_us) for k in cameras]
    ends_us = [int(e.t_us[k]) for e in events if len(e) for k in (0, -1)]
    half_us = 1 + max((abs(t_us - t_ref_us) for t_us in ends_us), default=0)
    return WindowEvents(t_ref_us - half_us, t_ref_us + half_us, tuple(events))


def _begins(recording: Recording) -> list[int]:
    spans = [recording.event_span_us(camera) for camera in range(len(recording.rig))]
    poses = recording.trajectory.span_us
    first_us = max(poses[0], max(a for a, _ in spans))
    last_us = min(poses[1], min(b for _, b in spans)) - WINDOW_US
    if last_us < first_us:
        raise InputError(
            f"poses and all cameras' events cover {max(last_us + WINDOW_US - first_us, 0) / 1e6:g} "
            f"s together: needs {WINDOW_US / 1e6:g} s"
        )
    candidates = np.unique(np.linspace(first_us, last_us, _CANDIDATES).astype(np.int64))
    ways = [_way_m(recording, int(t_us)) for t_us in candidates]
    chosen: list[int] = []
    for at in np.argsort(ways, kind="stable")[::-1]:
        gap_us = min((abs(int(candidates[at]) - other) for other in chosen), default=WINDOW_US)
        # Windows may overlap by half where a recording is short: their edges differ nevertheless.
        if gap_us >= WINDOW_US // 2 and len(chosen) < WINDOWS:
            chosen.append(int(candidates[at]))
    return sorted(chosen)


def _way_m(recording: Recording, t_us: int) -> float:
    t = np.linspace(t_us, t_us + WINDOW_US, 9).astype(np.int64)
    positions_m = (recording.trajectory.at(t) @ recording.rig.T_body_cam[0])[:, :3, 3]
    return float(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).sum())


@dataclass(frozen=True, eq=False)
class Trial:
    """The outcome of one alternative.

    Attributes:
        alternative: what was tried.
        gains: per window, logarithm of its sharpness over that of the recording as given.
        change: applies the alternative, with the best amount, to a recording.
        margin: the gain that counts.
        amount: the best; None where the alternative has no amount.
        curve: amounts and mean gains that were tried.
    """

    alternative: Alternative | Amount
    gains: Gains
    change: Alter
    margin: float
    amount: float | None = None
    curve: tuple[Gains, Gains] = (np.empty(0), np.empty(0))

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
    def explains(self) -> bool:
        """Whether it may be named: an amount at the end of its search is no optimum."""
        if self.amount is None or isinstance(self.alternative, Alternative):
            return True
        grid = self.alternative.grid
        return min(grid) < self.amount < max(grid)

    @property
    def _hurts(self) -> bool:
        if self.amount is None or isinstance(self.alternative, Alternative):
            return True
        return self.alternative.distance(self.amount) >= self.alternative.hurts


def check_by_mapping(
    recording: Recording, config: MapperConfig, progress: Progress = silent
) -> list[Finding]:
    """Tries every alternative with each pair of camera 0 and another, or with a single camera.

    Args:
        recording: with poses.
        config: depth range and threads.
        progress: called with the stage, `alternatives` or `after the best cure`, how many are
            tried, and their number.

    Returns:
        A finding per pair; only that of the first if poses or lens are wrong, since nothing else is
        sharp under wrong poses.

    Raises:
        InputError: poses and events cover no window together, or an impossible depth range.
    """
    windows, names = TrialWindows.of(recording, config), recording.rig.camera_names
    groups: list[tuple[int, ...]] = [(0, k) for k in range(1, len(names))] or [(0,)]
    findings: list[Finding] = []
    for at, cameras in enumerate(groups):
        alternatives = _alternatives(recording, first=at == 0, paired=len(cameras) > 1)
        trials = CameraTrials(windows, cameras)
        shown = _shown(alternatives, progress, "alternatives", at, len(groups))
        tried = [trials.trial(alternative) for alternative in shown]
        best, second = trials.best(tried), None
        if best.verdict == "wrong" and best.explains:
            second = _second(CameraTrials(windows, cameras, best), best, alternatives, progress)
        names_text = " and ".join(names[k] for k in cameras)
        findings.append(_finding(f"mapping-{cameras[-1]}", names_text, best, second, tried))
        if best.verdict == "wrong" and not best.alternative.of_pair:
            break
    return findings


def _second(
    cured: CameraTrials, best: Trial, alternatives: Sequence[Alternative | Amount],
    progress: Progress,
) -> Trial | None:  # fmt: skip
    """What is still wrong after the best cure; None where nothing is: then it explains all."""
    others = [other for other in alternatives if _kind(other) != _kind(best.alternative)]
    shown = _shown(others, progress, "after the best cure")
    second = cured.best([cured.trial(other) for other in shown])
    return second if second.verdict == "wrong" else None


def _shown(
    alternatives: Sequence[Alternative | Amount], progress: Progress, stage: str,
    group: int = 0, groups: int = 1,
) -> Iterator[Alternative | Amount]:  # fmt: skip
    """Each alternative, and before it a step of the progress."""
    count = len(alternatives)
    for done, alternative in enumerate(alternatives, group * count):
        progress(stage, done, groups * count)
        yield alternative


def _kind(alternative: Alternative | Amount) -> str:
    """What an alternative corrects; of a rotation whatever its axis."""
    return alternative.name.partition(" about ")[0]


def _alternatives(recording: Recording, *, first: bool, paired: bool) -> list[Alternative | Amount]:
    """All that is tried with some cameras; what concerns camera 0 only with the first of them."""
    alternatives: list[Alternative | Amount] = []
    if first:
        alternatives += [*of_poses(recording), *amounts_of_one(paired=paired)]
    if paired:
        alternatives += [*of_pair(), *amounts_of_pair()]
    return alternatives


class CameraTrials:
    """Tries alternatives with a pair of cameras, or with one camera.

    Args:
        windows: where, fine and coarse.
        cameras: which.
        cured: the trial whose cure is applied before.
    """

    def __init__(
        self, windows: tuple[TrialWindows, TrialWindows], cameras: tuple[int, ...],
        cured: Trial | None = None,
    ) -> None:  # fmt: skip
        self._fine, self._coarse = windows
        self._cameras = cameras
        self._cure = cured.change if cured else _as_given
        self._cure_alone = _as_given if cured and cured.alternative.of_pair else self._cure
        self._base = self._fine.log_sharpness(self._cure, cameras)
        self._coarse_base = self._coarse.log_sharpness(self._cure, cameras)

    def trial(self, alternative: Alternative | Amount) -> Trial:
        """The outcome of one alternative."""
        if isinstance(alternative, Amount):
            return self._amount(alternative)
        gains = self._coarse_gains(alternative.change)
        if gains.mean() >= _PROMISING:
            gains = self._gains(alternative.change)
        return Trial(alternative, gains, alternative.change, self._margin(MARGIN))

    def best(self, trials: Sequence[Trial]) -> Trial:
        """The trial with the largest gain among those that do not contradict camera 0 alone."""
        in_order = sorted(trials, key=lambda t: (t.verdict == "wrong", t.gain), reverse=True)
        return next(trial for trial in in_order if self._agrees(trial))

    def _agrees(self, trial: Trial) -> bool:
        """Whether camera 0 alone is no less sharp under other poses."""
        if trial.verdict == "good" or trial.alternative.of_pair or len(self._cameras) == 1:
            return True
        cure = self._cure_alone
        alone = self._fine.log_sharpness(lambda r: trial.change(cure(r)), (0,))
        return bool((alone - self._fine.log_sharpness(cure, (0,))).mean() >= _LOSS)

    def _margin(self, margin: float) -> float:
        return margin * (1.0 if len(self._cameras) > 1 else _ONE_CAMERA)

    def _amount(self, amount: Amount) -> Trial:
        """The best amount: on the grid by coarse volumes, then between its neighbours by fine."""

        def gains_of(x: float) -> Gains:
            return self._gains(_with_amount(amount, x))

        coarse = [self._coarse_gains(_with_amount(amount, x)).mean() for x in amount.grid]
        at = int(np.argmax(coarse))
        near = {amount.grid[k] for k in (at - 1, at, at + 1) if 0 <= k < len(amount.grid)}
        tried = {x: gains_of(x) for x in sorted(near | {amount.neutral})}
        # Only a peak away from the neutral amount is worth a finer look.
        is_off = amount.distance(_peak(amount, tried)) >= amount.hurts / 3
        for _ in range(_REFINEMENTS if is_off else 0):
            tried |= {x: gains_of(x) for x in _between(amount, tried)}
        xs, gains = _sorted(tried)
        means = gains.mean(axis=1)
        peak = _peak(amount, tried)
        change, margin = _with_amount(amount, peak), self._margin(amount.margin)
        return Trial(amount, gains[int(means.argmax())], change, margin, peak, (xs, means))

    def _gains(self, change: Alter) -> Gains:
        both = self._after_cure(change)
        return self._fine.log_sharpness(both, self._cameras) - self._base

    def _coarse_gains(self, change: Alter) -> Gains:
        both = self._after_cure(change)
        return self._coarse.log_sharpness(both, self._cameras) - self._coarse_base

    def _after_cure(self, change: Alter) -> Alter:
        return lambda recording: change(self._cure(recording))


def _as_given(recording: Recording) -> Recording:
    return recording


def _with_amount(amount: Amount, x: float) -> Alter:
    return lambda recording: amount.change(recording, x)


def _sorted(tried: dict[float, Gains]) -> tuple[Gains, Gains]:
    """(N,) amounts in order and (N, W) their gains."""
    xs = sorted(tried)
    return np.array(xs), np.array([tried[x] for x in xs])


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


def _finding(
    name: str, cameras: str, best: Trial, second: Trial | None, trials: Sequence[Trial]
) -> Finding:
    gain = float(np.expm1(best.gain))
    if best.verdict == "good":
        words = f"{cameras}: none of {len(trials)} alternatives makes the map sharper"
        return Finding(name, "good", gain, "", words, series=_series(trials))
    windows = f"windows {', '.join(f'{np.expm1(g):+.1%}' for g in best.gains)}"
    meaning = "depth is where rays meet, and they meet less sharply than they could"
    if not best.explains:
        who = "the cameras do not fit each other" if best.alternative.of_pair else (
            "poses do not fit these events"
        )  # fmt: skip
        return Finding(
            name, best.verdict, gain, "",
            f"{cameras}: {who}, and no single cause was found: sharper at "
            f"the end of what was tried of the {best.alternative.name}; {windows}", meaning,
            "check by hand how the poses are stored (handedness, degrees or radians, order of "
            "Euler angles, direction) and that clocks and calibration belong to this recording",
            "no single cause found", _series(trials),
        )  # fmt: skip
    cures = [best] if second is None else [best, second]
    then = "" if second is None else f", and {np.expm1(second.gain):.1%} more with {_named(second)}"
    return Finding(
        name, best.verdict, gain, "",
        f"{cameras}: correcting this makes the map {gain:.1%} sharper: {_named(best)}{then}; "
        f"{windows}", meaning,
        "; and ".join(map(_cure, cures)) + ("" if second is None else "; then check again"),
        " and ".join(trial.alternative.name for trial in cures),
        _series(trials) if best.amount is None else _curve(best),
    )  # fmt: skip


def _unit(trial: Trial) -> str:
    return (trial.alternative.unit if isinstance(trial.alternative, Amount) else "") or "times"


def _named(trial: Trial) -> str:
    by = "" if trial.amount is None else f" by {trial.amount:.3g} {_unit(trial)}"
    return f"{trial.alternative.name}{by}"


def _cure(trial: Trial) -> str:
    if trial.amount is None:
        return trial.alternative.cure
    return f"{trial.alternative.cure.format(amount=trial.amount)}; `calibrate` refines it"


def _curve(best: Trial) -> Series:
    x, y = best.curve
    x_label = f"{best.alternative.name}, {_unit(best)}"
    return Series(100 * np.expm1(y), x, x_label, "sharper by, %", (0.0,))


def _series(trials: Sequence[Trial]) -> Series:
    """The best alternatives, by name."""
    best = sorted(trials, key=lambda trial: trial.gain, reverse=True)[:_BARS]
    gains = np.array([100 * np.expm1(trial.gain) for trial in best])
    names = tuple(trial.alternative.name for trial in best)
    return Series(gains, x_label="sharper by, %", limits=(0.0,), names=names)
