"""Refines a calibration from events and poses: well determined parameters first, then the rest.

1. Windows with parallax, spread over the recording, are read and thinned (`windows`).
2. Stereo rotation, camera clocks, baseline and focal length: scans on coarse DSIs, then
   a paraboloid through the top of the fine objective, in all of them jointly (`quadratic`).
3. Pose clock and hand-eye: angular velocities of events and poses, matched over all windows
   (`angular_velocity`), then the same paraboloid.
4. Where both are refined, the first once more.
5. A parameter that stays too uncertain is refused: it keeps the given value, and its uncertainty is
   part of that of the parameters that it trades off with.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import t as student_t

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.utils.runtime import Progress, check_openmp, silent, use_threads
from eventsweep.plugins.diagnose.calibrate.angular_velocity import (
    PoseTurns,
    align,
    camera_turn_rates,
    turn_rates,
)
from eventsweep.plugins.diagnose.calibrate.objective import (
    COARSE,
    FINE,
    MIDDLE,
    SCANS,
    Objective,
    approach,
    steps,
)
from eventsweep.plugins.diagnose.calibrate.quadratic import Function, climb, evaluations, higher
from eventsweep.plugins.diagnose.parameters import (
    AXES,
    Correction,
    Parameter,
    parameters_of,
)
from eventsweep.plugins.diagnose.windows import (
    WindowPlan,
    read_windows,
    window_spans,
    with_range,
)

Floats = NDArray[np.float64]
_SURE = 0.975  # quantile of the two-sided 95 % that uncertainties state
_POSE_KINDS = ("pose clock", "hand-eye", "lever")
_CLIMBS, _ALIGNMENTS = 6, (COARSE, MIDDLE, FINE)
# How much a sensor's events may lag behind the light: poses then seem as late, and nothing in a
# recording separates the two. Twins of a DAVIS346 lag by 0.4 to 1.8.
_LAG_MS = 2.0
_TRIALS = 4  # evaluations between two fits, at most
_CURVE_POINTS = 9
_FAR = 1.2  # times its reach: beyond it an estimate is refused
_MATCHED_TURN_DEG = 5.0  # of a window whose turn rate counts as constant
_TURN_STEP_RAD_S = np.radians(4.0)


@dataclass(frozen=True)
class RefineConfig:
    """How calibration is refined.

    Attributes:
        refine: keys of `plugins.diagnose.parameters.ROWS`.
        windows: how many at most; more of shorter ones.
        window_s: length of each, s; shorter where the camera turns fast.
        events: kept per camera and window, at most.
        min_depth_m, max_depth_m: depth range; by default the recording's, else what is seen.
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
                f"windows {self.windows}, window_s {self.window_s:g}, events {self.events}: "
                "needs at least 2 windows, longer than 0 s, with at least 1000 events"
            )


@dataclass(frozen=True)
class Estimate:
    """One parameter after refinement.

    Attributes:
        parameter: which.
        value: the correction, in the parameter's unit; 0 where it was refused.
        uncertainty: 95 %, plus or minus; of an undetermined parameter that of the prior.
        refused: why it keeps the given value; empty where it was refined.
    """

    parameter: Parameter
    value: float
    uncertainty: float
    refused: str = ""

    def facts(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        known = math.isfinite(self.uncertainty)
        return {
            "parameter": self.parameter.name, "unit": self.parameter.unit,
            "correction": self.value, "uncertainty_95": self.uncertainty if known else None,
            "refused": self.refused or None,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Refinement:
    """The result of a refinement.

    Attributes:
        estimates: one per parameter, in their order.
        sharpness: (W, 2) of every window, as given and as refined, in votes.
        windows: begin and end of each, µs.
        config: what to refine.
        curves: parameter -> (N,) corrections around the result and (N,) mean sharpness relative to
            the best, for plots.
    """

    estimates: tuple[Estimate, ...]
    sharpness: Floats
    windows: tuple[tuple[int, int], ...]
    config: RefineConfig
    curves: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)

    @property
    def correction(self) -> Correction:
        """What to add to the calibration."""
        return Correction({e.parameter: e.value for e in self.estimates if not e.refused})

    def applied(self, recording: Recording) -> AlteredRecording:
        """The refined recording with its refined calibration."""
        return self.correction.applied(recording)


def refine(
    recording: Recording, config: RefineConfig | None = None, progress: Progress = silent
) -> Refinement:
    """Refines the calibration of a recording from its events and poses; writes nothing.

    `progress` is called with the stage, the steps done and their number.

    Raises:
        InputError: no poses, an unknown name, a rig of one camera where two are needed, or events
            and poses that share too little time.
    """
    config = RefineConfig() if config is None else config
    check_openmp()
    use_threads(config.threads)
    parameters = parameters_of(config.refine, len(recording.rig))
    limits = MapperConfig(min_depth_m=config.min_depth_m, max_depth_m=config.max_depth_m)
    limits = with_range(recording, limits)
    config = replace(config, min_depth_m=limits.min_depth_m, max_depth_m=limits.max_depth_m)
    range_m = depth_range_m(recording, limits)
    plan = WindowPlan(config.windows, config.window_s, config.events)
    windows = read_windows(recording, plan, progress)
    objective = Objective(recording, windows, range_m)
    short = objective
    if any(parameter.kind in _POSE_KINDS for parameter in parameters):
        calm = replace(plan, turn_deg=_MATCHED_TURN_DEG)
        # Of a calm camera they are the same.
        if window_spans(recording, calm) != [(w.t0_us, w.t1_us) for w in windows]:
            short = Objective(recording, read_windows(recording, calm), range_m)
    return _Refiner(objective, short, parameters, config, progress).run()


class _Refiner:
    """One run: the objective, and the correction as it grows."""

    def __init__(
        self, objective: Objective, short: Objective, parameters: tuple[Parameter, ...],
        config: RefineConfig, progress: Progress,
    ) -> None:  # fmt: skip
        self._objective, self._short, self._parameters = objective, short, parameters
        self._config, self._progress, windows = config, progress, objective.windows
        self._best = Correction()
        self._uncertainty: dict[Parameter, float] = {}
        length_us = windows[0].t1_us - windows[0].t0_us
        span_us = windows[-1].t1_us - windows[0].t0_us
        self._independent = min(len(windows), span_us / length_us)

    def run(self) -> Refinement:
        shape = [p for p in self._parameters if p.kind not in _POSE_KINDS]
        pose = [p for p in self._parameters if p.kind in _POSE_KINDS]
        before = self._objective(Correction())
        if shape:
            on_scan = self._counted("scan", len(shape) * len(SCANS))
            self._best = approach(self._objective, shape, self._best, on_scan)
            self._top("stereo", shape)
        if pose:
            self._match_turns(pose)
            self._top("poses", pose)
        if shape and pose:
            self._top("stereo again", shape)
        estimates = tuple(map(self._estimate, self._parameters))
        refined = [estimate for estimate in estimates if not estimate.refused]
        self._best = Correction({estimate.parameter: estimate.value for estimate in refined})
        after = self._objective(self._best)
        spans_us = tuple((window.t0_us, window.t1_us) for window in self._objective.windows)
        sharpness = np.stack([before, after], axis=1)
        return Refinement(estimates, sharpness, spans_us, self._config, self._curves(refined))

    def _counted(self, stage: str, total: int) -> Callable[[], None]:
        """A function that shows one more step of a stage each time it is called."""
        done = count(1)
        return lambda: self._progress(stage, next(done), total)

    def _match_turns(self, pose: Sequence[Parameter]) -> None:
        """Pose clock and hand-eye rotation by angular velocities, coarse to fine."""
        clock = [p for p in pose if p.kind == "pose clock"]
        turns = [p for p in pose if p.kind == "hand-eye"]
        spread = np.zeros(4)
        spread[:1] = [p.reach / 2 for p in clock] or 0
        spread[1:] = np.radians([p.reach / 2 for p in turns] or 0)
        for done, level in enumerate(_ALIGNMENTS, 1):
            objective = self._short.at(level)
            rates = turn_rates(objective, self._best, level.scale * float(_TURN_STEP_RAD_S))
            self._progress("turn rates", done, len(_ALIGNMENTS))
            pose_turns = PoseTurns(objective.windows, objective.hypothesis(self._best))
            so_far = np.r_[
                self._best.vector(clock) if clock else 0.0,
                Rotation.from_matrix(self._best.hand_eye()[:3, :3]).as_rotvec(),
            ]
            more = align(rates, pose_turns, so_far, spread)
            later = {p: _within(so_far[0] + more[0], p.reach) for p in clock}
            matched = self._best.with_values(later | _turned(self._best, turns, more[1:]))
            step = matched.vector(pose) - self._best.vector(pose)
            function = self._function(objective, pose)
            self._moved(pose, higher(function, self._best.vector(pose), step))

    def _top(self, stage: str, parameters: Sequence[Parameter]) -> None:
        """Climbs in all of them jointly, and keeps their uncertainties."""
        around = steps(self._objective, parameters, self._best)
        total = _CLIMBS * (evaluations(len(parameters)) + _TRIALS)
        function = self._function(self._objective, parameters, self._counted(stage, total))
        spread = np.array([parameter.reach / 2 for parameter in parameters])
        start = self._best.vector(parameters)
        top = climb(function, start, around, spread, self._independent, _CLIMBS)
        self._progress(stage, total, total)
        factor = student_t.ppf(_SURE, max(1.0, self._independent - 1))
        each = factor * np.sqrt(np.diag(top.covariance))
        self._moved(parameters, top.point)
        self._uncertainty |= dict(zip(parameters, map(float, each), strict=True))

    def _function(
        self, objective: Objective, parameters: Sequence[Parameter],
        on_step: Callable[[], None] = lambda: None,
    ) -> Function:  # fmt: skip
        """Logarithm of every window's sharpness over some parameters, the others fixed."""

        def function(point: Floats) -> Floats:
            on_step()
            values = dict(zip(parameters, map(float, point), strict=True))
            return objective.varied(self._best, values)

        return function

    def _moved(self, parameters: Sequence[Parameter], point: Floats) -> None:
        values = dict(zip(parameters, map(float, point), strict=True))
        self._best = self._best.with_values(values)

    def _estimate(self, parameter: Parameter) -> Estimate:
        value, uncertainty = self._best.values[parameter], self._uncertainty[parameter]
        reach, unit, needed = parameter.reach, parameter.unit, parameter.needed
        if parameter.kind == "pose clock":
            uncertainty = math.hypot(uncertainty, _LAG_MS)
        if abs(value) > _FAR * reach:
            why = f"the best value lies outside the search range of {reach:g} {unit}"
            return Estimate(parameter, 0.0, uncertainty, why)
        if uncertainty <= needed:
            return Estimate(parameter, value, uncertainty)
        known = f"known to {uncertainty:.2g} {unit}, needs {needed:g}"
        return Estimate(parameter, 0.0, uncertainty, f"{known}: {self._lack(parameter)}")

    def _lack(self, parameter: Parameter) -> str:
        hypothesis = self._objective.hypothesis(self._best)
        rates = np.degrees(camera_turn_rates(self._objective.windows, hypothesis))
        each = ", ".join(f"{rate:.2g}" for rate in np.sqrt((rates**2).mean(axis=0)))
        change = float(np.sqrt(rates.var(axis=0).sum()))
        lacks: dict[str, str] = {
            "pose clock": "the motion is too uniform or too short; turn rates vary by only "
            f"{change:.2g} deg/s",
            "hand-eye": "the recording is too short, or the camera turns too little, by "
            f"{each} deg/s about x, y, z",
            "lever": "it can be determined only where the camera turns, here by "
            f"{each} deg/s about x, y, z",
        }
        return lacks.get(parameter.kind, "too little texture, parallax or motion in these windows")

    def _curves(self, refined: Sequence[Estimate]) -> dict[str, tuple[Floats, Floats]]:
        """Sharpness over each refined parameter, around the result and the given value."""
        curves = {}
        for done, estimate in enumerate(refined, 1):
            parameter, value = estimate.parameter, estimate.value
            far = max(1.3 * abs(value), 4 * estimate.uncertainty, 0.2 * parameter.reach)
            at = value + np.linspace(-far, far, _CURVE_POINTS)
            each = [self._objective.varied(self._best, {parameter: float(x)}) for x in at]
            mean = np.exp([log_sharpness.mean() for log_sharpness in each])
            curves[parameter.name] = (at, np.asarray(mean / mean.max()))
            self._progress("curves", done, len(refined))
        return curves


def _within(value: float, most: float) -> float:
    return float(np.clip(value, -most, most))


def _turned(best: Correction, turns: Sequence[Parameter], rotvec: Floats) -> dict[Parameter, float]:
    """The hand-eye's values after a further rotation of the camera."""
    before = Rotation.from_matrix(best.hand_eye()[:3, :3])
    after = (before * Rotation.from_rotvec(rotvec)).as_rotvec(degrees=True)
    return {p: _within(after[AXES.index(p.axis)], p.reach) for p in turns}
