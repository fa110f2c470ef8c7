"""Refines a calibration from events and poses: what is well determined first, then the rest.

1. Windows with parallax, spread over the recording, are read and thinned (`windows`).
2. Stereo rotation, camera clocks, baseline and focal length: scans on coarse DSIs (`search`), then
   a paraboloid through the top of the fine objective, in all of them jointly (`quadratic`).
3. Pose clock and hand-eye: angular velocities of events and poses, matched over all windows
   (`angular_velocity`), then the same paraboloid.
4. Where both were asked for, the first once more.
5. What the recording leaves too unsure is refused: it keeps the value that was given, and the
   others are estimated for that value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import t as student_t

from emvs.calibrate.angular_velocity import PoseTurns, align, camera_turn_rates, turn_rates
from emvs.calibrate.objective import Objective
from emvs.calibrate.parameters import AXES, Correction, Parameter, parameters_of
from emvs.calibrate.quadratic import Paraboloid, climb, evaluations
from emvs.calibrate.search import approach, scans, steps
from emvs.calibrate.windows import WindowEvents, WindowPlan, read_windows
from emvs.config import DEFAULT_DEPTH_RANGE_M
from emvs.data.altered import AlteredRecording
from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.utils.runtime import Progress, check_openmp, silent, use_threads

Floats = NDArray[np.float64]
_SURE = 0.975  # quantile of the two-sided 95 % that uncertainties state
_POSE_KINDS = ("pose clock", "hand-eye", "lever")
_CLIMBS, _ALIGNMENTS = 3, 3
_CURVE_POINTS = 9
_TURN_STEP_RAD_S = np.radians(4.0)


@dataclass(frozen=True)
class RefineConfig:
    """How calibration is refined.

    Attributes:
        refine: keys of `emvs.calibrate.parameters.NAMES`.
        windows: how many at most.
        window_s: length of each, s.
        events: kept per camera and window, at most.
        min_depth_m, max_depth_m: depth range; by default the recording's, else 0.2 and 5 m.
        threads: of the CPU; 0 for all. They do not change the result.
    """

    refine: tuple[str, ...] = ("stereo", "delay")
    windows: int = 10
    window_s: float = 0.2
    events: int = 30_000
    min_depth_m: float | None = None
    max_depth_m: float | None = None
    threads: int = 0

    def __post_init__(self) -> None:
        if not (self.windows >= 2 and self.window_s > 0 and self.events >= 1000):
            raise InputError(
                f"windows {self.windows}, window_s {self.window_s:g}, events {self.events}: needs "
                "at least 2 windows longer than 0 s and 1000 events"
            )


@dataclass(frozen=True)
class Estimate:
    """One parameter after refinement.

    Attributes:
        parameter: which.
        value: the correction, in the parameter's unit; 0 where it was refused.
        uncertainty: 95 %, plus or minus; infinite where the objective is flat.
        refused: why it was left as given; empty where it was refined.
    """

    parameter: Parameter
    value: float
    uncertainty: float
    refused: str = ""


@dataclass(frozen=True, eq=False)
class Refinement:
    """What refinement found.

    Attributes:
        estimates: one per parameter that was asked for.
        sharpness: (W, 2) of every window, as given and as refined, in votes.
        windows: begin and end of each, µs.
        curves: parameter -> (N,) corrections around the result and (N,) mean sharpness relative to
            the best, for people to look at.
        config: what was asked for.
    """

    estimates: tuple[Estimate, ...]
    sharpness: Floats
    windows: tuple[tuple[int, int], ...]
    config: RefineConfig
    curves: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)

    @property
    def correction(self) -> Correction:
        """What to add to the calibration."""
        refined = [one for one in self.estimates if not one.refused]
        return Correction({one.parameter: one.value for one in refined})

    def applied(self, recording: Recording) -> AlteredRecording:
        """A recording, the one that was refined, under the refined calibration."""
        return self.correction.applied(recording)


def refine(
    recording: Recording, config: RefineConfig | None = None, progress: Progress = silent
) -> Refinement:
    """Refines the calibration of a recording from its events and poses; writes nothing.

    Args:
        recording: events, poses, the calibration as given.
        config: what to refine; by default stereo rotation and camera clock.
        progress: told the stage, what is done and how much there is.

    Raises:
        InputError: no poses, an unknown name, a rig of one camera where two are needed, or events
            and poses that share too little time.
    """
    config = RefineConfig() if config is None else config
    check_openmp()
    use_threads(config.threads)
    parameters = parameters_of(config.refine, len(recording.rig))
    plan = WindowPlan(config.windows, config.window_s, config.events)
    windows = read_windows(recording, plan, progress)
    return _Refiner(recording, windows, parameters, config, progress).run()


def _depth_range_m(recording: Recording, config: RefineConfig) -> tuple[float, float]:
    near_m, far_m = recording.depth_range_m or DEFAULT_DEPTH_RANGE_M
    near_m = near_m if config.min_depth_m is None else config.min_depth_m
    far_m = far_m if config.max_depth_m is None else config.max_depth_m
    if not 0 < near_m < far_m:
        raise InputError(
            f"depth range {near_m:g}..{far_m:g} m: needs 0 < min_depth_m < max_depth_m; set both"
        )
    return near_m, far_m


class _Refiner:
    """One run: the objective, and the correction as it grows."""

    def __init__(
        self, recording: Recording, windows: Sequence[WindowEvents],
        parameters: Sequence[Parameter], config: RefineConfig, progress: Progress,
    ) -> None:  # fmt: skip
        self._recording, self._config, self._progress = recording, config, progress
        self._parameters = tuple(parameters)
        self._objective = Objective(recording, windows, _depth_range_m(recording, config))
        self._best = Correction()
        self._refused: dict[Parameter, tuple[float, str]] = {}
        length_us = windows[0].t1_us - windows[0].t0_us
        span_us = windows[-1].t1_us - windows[0].t0_us
        self._independent = min(len(windows), span_us / length_us)

    def run(self) -> Refinement:
        shape = [one for one in self._parameters if one.kind not in _POSE_KINDS]
        pose = [one for one in self._parameters if one.kind in _POSE_KINDS]
        before = self._objective(Correction())
        sure: dict[Parameter, float] = {}
        if shape:
            self._scan(shape)
            sure |= self._top("stereo", shape)
        if pose:
            self._match_turns(pose)
            sure |= self._top("poses", pose)
        if shape and pose:
            sure |= self._top("stereo again", self._kept(shape))
        after = self._objective(self._best)
        return Refinement(
            tuple(self._estimate(one, sure) for one in self._parameters),
            np.stack([before, after], axis=1),
            tuple((one.t0_us, one.t1_us) for one in self._objective.windows),
            self._config,
            self._curves(sure),
        )

    def _kept(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        return [one for one in parameters if one not in self._refused]

    def _scan(self, parameters: Sequence[Parameter]) -> None:
        done, total = 0, scans(len(parameters))

        def heard(_name: str) -> None:
            nonlocal done
            done += 1
            self._progress("scan", done, total)

        self._best = approach(self._objective, parameters, self._best, heard)

    def _match_turns(self, pose: Sequence[Parameter]) -> None:
        """Pose clock and hand-eye rotation by angular velocities, a few times over."""
        clock = next((one for one in pose if one.kind == "pose clock"), None)
        turns = [one for one in pose if one.kind == "hand-eye"]
        for done in range(_ALIGNMENTS):
            rates = turn_rates(self._objective, self._best, float(_TURN_STEP_RAD_S), 2 - (done > 0))
            self._progress("turn rates", done + 1, _ALIGNMENTS)
            told = PoseTurns(self._objective.windows, self._objective.told(self._best))
            reach_s = 0.0 if clock is None else 1e-3 * clock.reach
            found = align(rates, told, reach_s, lag=clock is not None, turn=bool(turns))
            if clock is not None:
                later_ms = self._best.values.get(clock, 0.0) + 1e3 * found.lag_s
                self._best = self._best.with_values({clock: _within(later_ms, clock.reach)})
            if turns:
                self._best = self._best.with_values(_turned(self._best, turns, found.rotvec))

    def _top(self, stage: str, parameters: Sequence[Parameter]) -> dict[Parameter, float]:
        """Climbs jointly, refuses what stays unsure, and gives the 95 % of the rest."""
        model, at = self._climbed(stage, parameters)
        kept, dropped = self._without_unsure(model, list(parameters), at)
        if dropped and kept:
            again, _ = self._climbed(f"{stage}, {len(kept)} left", kept)
            return self._accepted(again, kept)
        return self._accepted(model, kept) if kept else {}

    def _climbed(self, stage: str, parameters: Sequence[Parameter]) -> tuple[Paraboloid, Floats]:
        around = steps(self._objective, parameters, self._best)
        done, total = 0, _CLIMBS * evaluations(len(parameters))

        def function(point: Floats) -> Floats:
            nonlocal done
            done += 1
            self._progress(stage, done, total)
            values = dict(zip(parameters, map(float, point), strict=True))
            return np.log(self._objective(self._best.with_values(values)))

        model = climb(function, self._best.vector(parameters), around, 2 * around, _CLIMBS)
        self._progress(stage, total, total)
        return model.moved(model.summit(2 * around)), around

    def _uncertainties(self, model: Paraboloid) -> Floats:
        """(P,) 95 % of each parameter."""
        variance = np.diag(model.covariance(self._independent))
        factor = student_t.ppf(_SURE, max(1.0, self._independent - 1))
        return np.asarray(factor * np.sqrt(variance))

    def _without_unsure(
        self, model: Paraboloid, kept: list[Parameter], around: Floats
    ) -> tuple[list[Parameter], int]:
        """Fixes one parameter after the other, the least sure first, until all others are sure."""
        dropped = 0
        while kept:
            each = [self._alone(model, k) for k in range(len(kept))]
            joint = self._uncertainties(model)
            unsure = np.where(np.isfinite(joint), joint, each) / [one.needed for one in kept]
            over = np.abs(model.point) > [1.5 * one.reach for one in kept]
            worst = int(np.where(over, np.inf, unsure).argmax())
            if unsure[worst] <= 1 and not over[worst] and np.isfinite(joint).all():
                break
            one = kept[worst]
            why = self._reason(one, float(joint[worst]), beyond=bool(over[worst]))
            self._refused[one] = (float(joint[worst]), why)
            self._best = self._best.with_values({one: 0.0})
            model, around = model.without(worst, 0.0), np.delete(around, worst)
            kept, dropped = [*kept[:worst], *kept[worst + 1 :]], dropped + 1
            if kept:
                model = model.moved(model.summit(2 * around))
        return kept, dropped

    def _alone(self, model: Paraboloid, k: int) -> float:
        """95 % of one parameter if all others were known."""
        others = [j for j in range(len(model.point)) if j != k]
        for j in reversed(others):
            model = model.without(j, float(model.point[j]))
        return float(self._uncertainties(model)[0])

    def _accepted(self, model: Paraboloid, kept: Sequence[Parameter]) -> dict[Parameter, float]:
        self._best = self._best.with_values(dict(zip(kept, map(float, model.point), strict=True)))
        return dict(zip(kept, map(float, self._uncertainties(model)), strict=True))

    def _estimate(self, one: Parameter, sure: dict[Parameter, float]) -> Estimate:
        if one in self._refused:
            uncertainty, why = self._refused[one]
            return Estimate(one, 0.0, uncertainty, why)
        return Estimate(one, self._best.values.get(one, 0.0), sure[one])

    def _reason(self, one: Parameter, uncertainty: float, *, beyond: bool) -> str:
        """Why a parameter is refused: how unsure it is, and what it would take."""
        if beyond:
            return f"the best lies beyond {one.reach:g} {one.unit}, farther than it is searched"
        known = f"known to {uncertainty:.2g} {one.unit}" if np.isfinite(uncertainty) else "flat"
        return f"{known}, needs {one.needed:g}: {self._lack(one)}"

    def _lack(self, one: Parameter) -> str:
        told = self._objective.told(self._best)
        rates = np.degrees(camera_turn_rates(self._objective.windows, told))
        each = ", ".join(f"{rate:.2g}" for rate in np.sqrt((rates**2).mean(axis=0)))
        if one.kind == "pose clock":
            change = float(np.sqrt(rates.var(axis=0).sum()))
            return f"the motion is too even or too short; rates of turn vary by {change:.2g} deg/s"
        if one.kind == "hand-eye":
            return f"the camera turns too little, by {each} deg/s about x, y, z"
        if one.kind == "lever":
            return f"it shows only where the camera turns, here by {each} deg/s about x, y, z"
        return "too little texture, parallax or motion in these windows"

    def _curves(self, sure: dict[Parameter, float]) -> dict[str, tuple[Floats, Floats]]:
        """Sharpness over each refined parameter, around the result and as far as what was given."""
        curves = {}
        for done, one in enumerate(sure, 1):
            best = self._best.values.get(one, 0.0)
            far = max(1.3 * abs(best), 4 * sure[one], 0.2 * one.reach)
            at = best + np.linspace(-far, far, _CURVE_POINTS)
            values = [self._objective(self._best.with_values({one: float(x)})) for x in at]
            mean = np.exp(np.log(values).mean(axis=1))
            curves[one.name] = (at, np.asarray(mean / mean.max()))
            self._progress("curves", done, len(sure))
        return curves


def _within(value: float, most: float) -> float:
    return float(np.clip(value, -most, most))


def _turned(best: Correction, turns: Sequence[Parameter], rotvec: Floats) -> dict[Parameter, float]:
    """The hand-eye's values after a further rotation of the camera."""
    before = Rotation.from_matrix(best.hand_eye()[:3, :3])
    after = (before * Rotation.from_rotvec(rotvec)).as_rotvec(degrees=True)
    return {one: _within(after[AXES.index(one.axis)], one.reach) for one in turns}
