"""Checks by mapping: are rays sharper where one thing is told otherwise? Then that is mistaken.

Three windows are mapped as the recording stands, and again under every alternative; the sharpness
of their volumes is compared (`emvs.sharpness`): of the harmonic mean of camera 0 and each other,
which tells far more about poses, too, than one camera does. What is said of the poses must make
camera 0 alone no less sharp: no error between the cameras touches that. Windows keep the same
events under all alternatives, so that more votes are never taken for sharper ones. An alternative
counts where the mean of its gains exceeds a margin and every window gains: the margins come from
unspoilt recordings (page `check`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from eventsweep.emvs.sharpness import Level, Sharpness, Told, WindowEvents
from eventsweep.emvs.utils.runtime import Progress, silent, use_threads

Gains = NDArray[np.float64]
WINDOWS, WINDOW_US, EVENTS, LEVEL = 3, 200_000, 25_000, Level(1, 80)
_CANDIDATES = 24
_PROMISING = -0.15  # in the first window: what is less sharp is not tried in the others
_REFINEMENTS = 3
_DOUBTFUL = 0.75  # of a margin
_ONE_CAMERA = 1.5  # times the margins: one camera tells alternatives less well apart
_LOSS = -0.02  # what camera 0 alone may lose under other poses
_NOTHING = 1e-3  # the sharpness, in votes, of a volume without any


class HeldRecording(DerivedRecording):
    """A recording whose events are those of one window, in memory, thinned evenly to a number."""

    def __init__(self, recording: Recording, t0_us: int, t1_us: int, most: int) -> None:
        super().__init__(recording)
        cameras = range(len(recording.rig))
        self._held = [recording.events(k, t0_us, t1_us).thinned(most) for k in cameras]

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """The held events of a camera with `t0_us <= t < t1_us`."""
        return self._held[camera].between(t0_us, t1_us)


@dataclass(frozen=True, eq=False)
class Bench:
    """The windows on which alternatives are compared.

    Attributes:
        windows: each with its events in memory.
        middles_us: the times of their reference views.
        sharpness: of windows that are told otherwise.
    """

    windows: tuple[Recording, ...]
    middles_us: tuple[int, ...]
    sharpness: Sharpness

    @classmethod
    def of(cls, recording: Recording, config: MapperConfig) -> Bench:
        """The windows with the longest ways among those that poses and events cover.

        Raises:
            InputError: poses and events cover no window together.
        """
        use_threads(config.threads)
        begins = _begins(recording)
        windows = [HeldRecording(recording, t, t + WINDOW_US, EVENTS) for t in begins]
        middles_us = tuple(t + WINDOW_US // 2 for t in begins)
        return cls(tuple(windows), middles_us, Sharpness(depth_range_m(recording, config), LEVEL))

    def logs(self, told: Alter, cameras: tuple[int, ...], most: int = WINDOWS) -> Gains:
        """Logarithm of the sharpness of the first `most` windows under an alternative.

        Args:
            told: the alternative, of a recording of the chosen cameras.
            cameras: one, or a pair that is fused.
            most: how many windows.
        """
        recordings = [told(Chosen(held, cameras)) for held in self.windows[:most]]
        middles_us = self.middles_us[:most]
        windows = [_all_of(*pair) for pair in zip(recordings, middles_us, strict=True)]
        try:
            votes = self.sharpness(windows, [Told(one.rig, one.trajectory) for one in recordings])
        except InputError:  # poses elsewhere, events off the sensor: nothing is sharp
            votes = np.zeros(len(windows))
        return np.log(np.maximum(votes, _NOTHING))


def _all_of(held: Recording, t_ref_us: int) -> WindowEvents:
    """All events that are held, in a window around the time of the reference view.

    Wide enough for any clock: there are no events beside those held.
    """
    far_us = 10 * WINDOW_US
    cameras = range(len(held.rig))
    events = tuple(held.events(k, t_ref_us - far_us, t_ref_us + far_us) for k in cameras)
    return WindowEvents(t_ref_us - far_us, t_ref_us + far_us, events)


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
        apart = min((abs(int(candidates[at]) - other) for other in chosen), default=WINDOW_US)
        # Windows may overlap by half where a recording is short: their edges differ nevertheless.
        if apart >= WINDOW_US // 2 and len(chosen) < WINDOWS:
            chosen.append(int(candidates[at]))
    return sorted(chosen)


def _way_m(recording: Recording, t_us: int) -> float:
    t = np.linspace(t_us, t_us + WINDOW_US, 9).astype(np.int64)
    positions_m = (recording.trajectory.at(t) @ recording.rig.T_body_cam[0])[:, :3, 3]
    return float(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).sum())


@dataclass(frozen=True, eq=False)
class Trial:
    """What one alternative came to.

    Attributes:
        name: what is mistaken if it is sharper.
        gains: per window, logarithm of its sharpness over that of the recording as it stands.
        cure: what to do then.
        told: the recording so told.
        amount: how much, where it is a number; else None.
        spread: standard error of the amount over windows.
        unit: of the amount.
        hurts: whether so large an amount spoils a map.
        margin: the gain that counts.
        of_one: whether it is said of poses and lens, not of what lies between cameras.
        curve: amounts and mean gains that were tried.
    """

    name: str
    gains: Gains
    cure: str
    told: Alter
    amount: float | None = None
    spread: float = 0.0
    unit: str = ""
    hurts: bool = True
    margin: float = MARGIN
    of_one: bool = False
    curve: tuple[Gains, Gains] = (np.empty(0), np.empty(0))

    @property
    def gain(self) -> float:
        """Mean over the windows."""
        return float(self.gains.mean())

    @property
    def verdict(self) -> Verdict:
        """What the gain alone says."""
        if self.gain <= _DOUBTFUL * self.margin or self.gains.min() <= 0:
            return "good"
        return "wrong" if self.gain > self.margin and self.hurts else "doubtful"


def check_by_mapping(
    recording: Recording, config: MapperConfig, progress: Progress = silent
) -> list[Finding]:
    """Tries every alternative with each pair of camera 0 and another, or with the one camera.

    Args:
        recording: with poses.
        config: depth range and threads.
        progress: told the stage `alternatives`, tried and all.

    Returns:
        A finding per pair; of the first only, if poses or lens are wrong: nothing else is sharp
        under wrong poses.

    Raises:
        InputError: poses and events cover no window together, or an impossible depth range.
    """
    bench, names = Bench.of(recording, config), recording.rig.camera_names
    found: list[Finding] = []
    for group in _groups(recording, bench, progress):
        trials = group.trials(recording)
        best = group.best(trials)
        words = " and ".join(names[k] for k in group.cameras)
        found.append(_finding(f"mapping-{group.cameras[-1]}", words, best, trials))
        if best.of_one and best.verdict == "wrong":
            break
    return found


def trial_of(
    recording: Recording, one: Alternative | Amount, config: MapperConfig, *, of_one: bool = False
) -> Trial:
    """What one alternative comes to by itself, with the first two cameras or with the only one.

    Args:
        recording: with poses.
        one: the alternative.
        config: depth range and threads.
        of_one: whether it is said of poses and lens, not of what lies between cameras.

    Raises:
        InputError: as `check_by_mapping`.
    """
    group = _groups(recording, Bench.of(recording, config), silent)[0]
    return group.trial(one, of_one)


def _groups(recording: Recording, bench: Bench, progress: Progress) -> list[_Group]:
    others = range(1, len(recording.rig))
    pairs: list[tuple[int, ...]] = [(0, k) for k in others]
    return [
        _Group(bench, pair, progress, k, max(len(pairs), 1))
        for k, pair in enumerate(pairs or [(0,)])
    ]


class _Group:
    """Trials of one pair of cameras, or of one camera; what concerns camera 0 belongs to the first.

    Attributes:
        cameras: which.
    """

    def __init__(
        self, bench: Bench, cameras: tuple[int, ...], progress: Progress, at: int, groups: int
    ) -> None:
        self.cameras = cameras
        self._bench, self._progress, self._at, self._groups = bench, progress, at, groups
        self._base = bench.logs(lambda r: r, cameras)

    def trials(self, recording: Recording) -> list[Trial]:
        """What every alternative comes to."""
        first, paired = self._at == 0, len(self.cameras) > 1
        every: list[tuple[Alternative | Amount, bool]] = []
        if first:
            every += [(one, True) for one in of_poses(recording)]
            every += [(one, True) for one in amounts_of_one(paired=paired)]
        if paired:
            every += [(one, False) for one in of_pair()]
            every += [(one, False) for one in amounts_of_pair()]
        return [self._told(k, len(every), *chosen) for k, chosen in enumerate(every)]

    def best(self, trials: Sequence[Trial]) -> Trial:
        """The one that gains most, among those that are no contradiction in themselves."""
        in_order = sorted(trials, key=lambda one: (one.verdict == "wrong", one.gain), reverse=True)
        return next(one for one in in_order if self._agrees(one))

    def _agrees(self, trial: Trial) -> bool:
        """Whether camera 0 alone is no less sharp under other poses."""
        if trial.verdict == "good" or not trial.of_one or len(self.cameras) == 1:
            return True
        alone = self._bench.logs(trial.told, (0,)) - self._bench.logs(lambda r: r, (0,))
        return bool(alone.mean() >= _LOSS)

    def _told(self, k: int, count: int, one: Alternative | Amount, of_one: bool) -> Trial:
        self._progress("alternatives", self._at * count + k, self._groups * count)
        return self.trial(one, of_one)

    def trial(self, one: Alternative | Amount, of_one: bool) -> Trial:
        """What one alternative comes to."""
        found = self._alternative(one) if isinstance(one, Alternative) else self._amount(one)
        strict = 1.0 if len(self.cameras) > 1 else _ONE_CAMERA
        return replace(found, of_one=of_one, margin=found.margin * strict)

    def _alternative(self, one: Alternative) -> Trial:
        """Its gains; in the first window alone, where that speaks against it."""
        first = self._gains(one.told, 1)
        gains = first if first[0] < _PROMISING else self._gains(one.told)
        return Trial(one.name, gains, one.cure, one.told)

    def _amount(self, one: Amount) -> Trial:
        """The best amount: on the grid by the first window, then between its neighbours by all."""
        coarse = {x: float(self._gains(_told(one, x), 1)[0]) for x in one.grid}
        at = one.grid.index(max(coarse, key=lambda x: coarse[x]))
        near = {one.grid[k] for k in (at - 1, at, at + 1) if 0 <= k < len(one.grid)}
        tried = {x: self._gains(_told(one, x)) for x in sorted(near | {one.neutral})}
        for _ in range(_REFINEMENTS if self._is_off(one, tried) else 0):
            for x in _between(one, tried):
                tried[x] = self._gains(_told(one, x))
        xs = np.array(sorted(tried))
        gains = np.array([tried[x] for x in xs])
        best = int(gains.mean(axis=1).argmax())
        amount, spread = _peak(one, xs, gains, best)
        return Trial(
            one.name, gains[best], one.cure.format(amount=amount), _told(one, amount), amount,
            spread, one.unit, _off(one, amount) >= one.hurts, one.margin,
            curve=(xs, gains.mean(axis=1)),
        )  # fmt: skip

    def _is_off(self, one: Amount, tried: dict[float, Gains]) -> bool:
        """Whether it is worth looking more finely: the peak is not where the recording stands."""
        xs = np.array(sorted(tried))
        gains = np.array([tried[x] for x in xs])
        amount, _ = _peak(one, xs, gains, int(gains.mean(axis=1).argmax()))
        return _off(one, amount) >= one.hurts / 3

    def _gains(self, told: Alter, most: int = WINDOWS) -> Gains:
        return self._bench.logs(told, self.cameras, most) - self._base[:most]


def _told(one: Amount, amount: float) -> Alter:
    return lambda recording: one.told(recording, amount)


def _off(one: Amount, amount: float) -> float:
    """How far an amount is from the one that changes nothing."""
    return float(abs(np.log(amount)) if one.is_factor else abs(amount))


def _between(one: Amount, tried: dict[float, Gains]) -> list[float]:
    """The middles between the best amount and its neighbours; of factors, geometric ones."""
    xs = sorted(tried)
    best = max(range(len(xs)), key=lambda k: tried[xs[k]].mean())
    near = [xs[k] for k in (best - 1, best + 1) if 0 <= k < len(xs)]
    return [float(np.sqrt(xs[best] * x)) if one.is_factor else (xs[best] + x) / 2 for x in near]


def _peak(one: Amount, xs: Gains, gains: Gains, best: int) -> tuple[float, float]:
    """Where the mean gain peaks, and the standard error of the windows' own peaks."""
    scale = np.log(xs) if one.is_factor else xs
    if not 0 < best < len(xs) - 1:
        return float(xs[best]), 0.0
    near = slice(best - 1, best + 2)
    peaks = [_vertex(scale[near], g) for g in (gains[near].mean(axis=1), *gains[near].T)]
    spread = float(np.std(peaks[1:], ddof=1) / np.sqrt(gains.shape[1])) if len(peaks) > 2 else 0.0
    return float(np.exp(peaks[0])) if one.is_factor else peaks[0], spread


def _vertex(x: Gains, y: Gains) -> float:
    """Of the parabola through three points, within them; the highest where there is none."""
    a, b, _ = np.polyfit(x - x[1], y, 2)
    if a >= 0:
        return float(x[int(np.argmax(y))])
    return float(np.clip(x[1] - b / (2 * a), x[0], x[2]))


def _finding(name: str, who: str, best: Trial, trials: Sequence[Trial]) -> Finding:
    """What the best of the trials says."""
    sharper = float(np.expm1(best.gain))
    series = _series(trials) if best.amount is None else _curve(best)
    if best.verdict == "good":
        words = f"{who}: rays meet most sharply as the recording stands, of {len(trials)} ways"
        return Finding(name, "good", sharper, "", words, series=_series(trials))
    how_much = "" if best.amount is None else _amount_words(best)
    return Finding(
        name, best.verdict, sharper, "",
        f"{who}: rays meet {sharper:.1%} more sharply if this is mended: {best.name}{how_much}; "
        f"windows {', '.join(f'{np.expm1(g):+.1%}' for g in best.gains)}",
        "depth is taken from where rays meet: now they meet less well than they could",
        best.cure, best.name, series,
    )  # fmt: skip


def _amount_words(best: Trial) -> str:
    unit = f" {best.unit}" if best.unit else " times"
    return f" by {best.amount:.3g} ± {best.spread:.1g}{unit}"


def _curve(best: Trial) -> Series:
    x, y = best.curve
    return Series(100 * np.expm1(y), x, f"{best.name}, {best.unit or 'times'}", "sharper by, %",
                  (0.0,))  # fmt: skip


def _series(trials: Sequence[Trial]) -> Series:
    gains = np.array([100 * np.expm1(one.gain) for one in trials])
    return Series(gains, np.arange(len(gains), dtype=float), "alternative", "sharper by, %", (0.0,))
