"""Every metric of a trajectory: its name, unit, direction and formula, and how it is computed.

e is the error of a pose or of a step, see `errors`. The page `scores` discusses each.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import ByName
from eventsweep.eval.config import TrajectoryConfig
from eventsweep.eval.results.direction import Direction
from eventsweep.eval.scoring.method_scores import ALL_METRICS, Score
from eventsweep.eval.scoring.metrics import GEOMETRY_METRICS, NAN, Quantity
from eventsweep.eval.scoring.trajectories.errors import PoseErrors, Step, StepErrors

Floats = NDArray[np.float64]
PRIMARY_OF_TRAJECTORIES = ("ate_rmse", "ate_rotation_rmse", "drift", "time_covered")
"""Metrics that decide which trajectory is better: how far off, how fast it drifts, how long."""
_SHARES_PERCENT = (10.0, 20.0, 30.0, 40.0, 50.0)
_STEP = re.compile(r"rpe_(translation|rotation)_([\d.e+-]+)(pct|m|s|deg)")
_APART = {"pct": "{:g} % of the way", "m": "{:g} m", "s": "{:g} s", "deg": "{:g}°"}


@dataclass(frozen=True, eq=False)
class TrajectoryErrors:
    """All errors of one estimate, and what puts them into proportion.

    Attributes:
        poses: absolute errors.
        steps: relative errors, by how far apart the two poses of a step are.
        way_m: how long the true way over all paired poses is, m.
        truth_s: how long the truth lasts, s.
        covered_s: for how much of it there are estimates, s.
        scale: what a Sim(3) alignment multiplies the estimate by; NaN where it does not move.
    """

    poses: PoseErrors
    steps: Mapping[Step, StepErrors]
    way_m: float
    truth_s: float
    covered_s: float
    scale: float

    def over_distances(self) -> tuple[Floats, Floats, Floats]:
        """Way in m, translation in m and rotation in ° of all steps that are measured by way."""
        chosen = [found for step, found in self.steps.items() if step.unit in ("pct", "m")]
        columns = ("way_m", "translation_m", "rotation_deg")
        way_m, translation_m, rotation_deg = (
            np.concatenate([np.empty(0), *(getattr(found, name) for found in chosen)])
            for name in columns
        )
        return way_m, translation_m, rotation_deg


@dataclass(frozen=True, slots=True, repr=False)
class TrajectoryMetric(Quantity):
    """One number about a trajectory.

    Attributes:
        compute: makes it of the errors.
        support: of how many poses, or steps, it is made; None where that says nothing.
    """

    compute: Callable[[TrajectoryErrors], float]
    support: Callable[[TrajectoryErrors], int | None]

    def score(self, errors: TrajectoryErrors) -> Score:
        """The number as a row of a table has it."""
        value, support = float(self.compute(errors)), self.support(errors)
        return Score(self.name, value, self.unit, self.direction, support=support)


def steps_of_config(config: TrajectoryConfig) -> tuple[Step, ...]:
    """Which steps relative errors are asked for."""
    lengths = (
        [Step(value, "m") for value in config.rpe_distances_m]
        if config.rpe_distances_m
        else [Step(value, "pct") for value in _SHARES_PERCENT]
    )
    times = [Step(value, "s") for value in config.rpe_times_s]
    angles = [Step(value, "deg") for value in config.rpe_angles_deg]
    return tuple(dict.fromkeys([*lengths, *times, *angles]))


def metrics_of(steps: Iterable[Step]) -> tuple[TrajectoryMetric, ...]:
    """Every metric, in order, of an estimate whose relative errors are over these steps."""
    return (*_ABSOLUTE, *_DRIFT, *(one for step in steps for one in _relative(step)), *_CONTEXT)


def metric_named(name: str) -> Quantity:
    """A metric of depth maps, trajectories or geometries; relative errors may be over any step.

    Raises:
        InputError: there is none of this name.
    """
    found = None if name in KNOWN_METRICS else _STEP.fullmatch(name)
    if found is None:
        return KNOWN_METRICS[name]
    kind, value, unit = found.groups()
    step = Step(float(value), unit)  # type: ignore[arg-type]
    return next(one for one in _relative(step) if one.name.startswith(f"rpe_{kind}"))


def _mean(values: Floats) -> float:
    return float(np.mean(values)) if values.size else NAN


def _rmse(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else NAN


_STATISTICS: dict[str, tuple[Callable[[Floats], float], str]] = {
    "rmse": (_rmse, "sqrt(mean e²)"),
    "mean": (_mean, "mean e"),
    "median": (lambda values: float(np.median(values)), "median e"),
    "max": (lambda values: float(np.max(values)), "max e"),
}


def _of_poses(errors: TrajectoryErrors) -> int:
    return len(errors.poses.translation_m)


def _of_steps(errors: TrajectoryErrors) -> int:
    return len(errors.over_distances()[0])


def _nothing(_: TrajectoryErrors) -> None:
    return None


class _Kind(NamedTuple):
    """Absolute errors of translation, or of rotation."""

    stem: str
    title: str
    column: str
    unit: str
    error: str


_KINDS = (
    _Kind("ate", "ATE", "translation_m", "m", "distance from the truth"),
    _Kind("ate_rotation", "ATE rotation", "rotation_deg", "deg", "angle to the truth"),
)


def _absolute(kind: _Kind, name: str) -> TrajectoryMetric:
    statistic, formula = _STATISTICS[name]

    def compute(errors: TrajectoryErrors) -> float:
        return statistic(getattr(errors.poses, kind.column))

    title = kind.title if name == "rmse" else f"{kind.title}, {name}"
    about = f"{formula}, e the {kind.error} of each pose after alignment"
    named = f"{kind.stem}_{name}"
    return TrajectoryMetric(named, title, kind.unit, "lower", about, compute, _of_poses)


def _relative(step: Step) -> Iterator[TrajectoryMetric]:
    apart = _APART[step.unit].format(step.value)
    kinds = (("translation", "translation_m", "m"), ("rotation", "rotation_deg", "deg"))
    for kind, column, unit in kinds:

        def compute(errors: TrajectoryErrors, column: str = column) -> float:
            return _rmse(getattr(errors.steps[step], column))

        title = f"RPE {kind}, {apart}"
        about = f"sqrt(mean e²), e the {kind} between true and estimated step over {apart}"
        name = f"rpe_{kind}_{step}"
        yield TrajectoryMetric(
            name, title, unit, "lower", about, compute, lambda errors: len(errors.steps[step])
        )


def _drift(errors: TrajectoryErrors) -> float:
    way_m, translation_m, _ = errors.over_distances()
    return 100 * _mean(translation_m / way_m)


def _rotation_drift(errors: TrajectoryErrors) -> float:
    way_m, _, rotation_deg = errors.over_distances()
    return _mean(rotation_deg / way_m)


def _ate_share(errors: TrajectoryErrors) -> float:
    return 100 * _rmse(errors.poses.translation_m) / errors.way_m if errors.way_m else NAN


def _context(
    name: str, title: str, unit: str, direction: Direction, formula: str,
    compute: Callable[[TrajectoryErrors], float],
) -> TrajectoryMetric:  # fmt: skip
    return TrajectoryMetric(name, title, unit, direction, formula, compute, _nothing)


_ABSOLUTE = tuple(_absolute(kind, name) for kind in _KINDS for name in _STATISTICS)
_DRIFT = (
    TrajectoryMetric("ate_share", "ATE of path", "%", "lower", "ATE / true way",
                     _ate_share, _of_poses),
    TrajectoryMetric("drift", "drift", "%", "lower",
                     "mean e / way, over all steps that are measured by way", _drift, _of_steps),
    TrajectoryMetric("drift_rotation", "drift of rotation", "deg/m", "lower",
                     "mean angle / way, over the same steps", _rotation_drift, _of_steps),
)  # fmt: skip
_CONTEXT = (
    _context("time_covered", "time covered", "%", "higher",
             "time with estimates, without gaps / time of the truth",
             lambda errors: 100 * errors.covered_s / errors.truth_s if errors.truth_s else NAN),
    _context("scale_error", "scale error", "%", "lower",
             "|s - 1|, s the scale of a Sim(3) alignment, whatever alignment is used",
             lambda errors: 100 * abs(errors.scale - 1)),
    _context("scale", "scale", "x", "none",
             "what a Sim(3) alignment multiplies the estimate by", lambda errors: errors.scale),
    _context("way", "way", "m", "none", "length of the true way over all paired poses",
             lambda errors: errors.way_m),
    _context("duration", "duration", "s", "none", "time of the truth",
             lambda errors: errors.truth_s),
    _context("paired_poses", "paired poses", "poses", "none", "number of pairs of poses",
             lambda errors: float(_of_poses(errors))),
)  # fmt: skip
TRAJECTORY_METRICS: dict[str, TrajectoryMetric] = {
    one.name: one for one in metrics_of(steps_of_config(TrajectoryConfig()))
}
KNOWN_METRICS: dict[str, Quantity] = ByName(
    "metric", {**ALL_METRICS, **TRAJECTORY_METRICS, **GEOMETRY_METRICS}
)
"""Every metric of depth maps, of trajectories and of geometries, by name."""
