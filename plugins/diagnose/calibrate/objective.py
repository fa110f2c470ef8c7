"""Sharpness of all windows' DSIs as a function of calibration: what refinement maximises.

From a calibration that is far off, scans, coarse to fine, lead to the neighbourhood of the best.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.plugins.diagnose.parameters import Correction, Parameter
from eventsweep.plugins.diagnose.sharpness import Hypothesis, Level, Sharpness, WindowEvents

Floats = NDArray[np.float64]
FINE, MIDDLE, COARSE = Level(1, 64), Level(2, 40), Level(4, 24)
SCANS: tuple[tuple[Level, float, int], ...] = (
    (COARSE, 1.0, 9), (COARSE, 0.5, 7), (MIDDLE, 0.25, 7), (MIDDLE, 0.12, 5),
)  # fmt: skip
"""Level, share of each parameter's reach that is scanned to either side, and points of a scan."""
_DROP = 0.02  # by which the log of sharpness should fall a step away from the top
_STEP_SHARES = (0.02, 0.5)  # of the reach: no step is smaller or larger


class Objective:
    """Sharpness of several windows under a correction of the calibration.

    A coarse `level` also sees large errors.
    """

    def __init__(
        self, recording: Recording, windows: Sequence[WindowEvents],
        depth_range_m: tuple[float, float], level: Level = FINE,
    ) -> None:  # fmt: skip
        self.recording, self.windows, self.level = recording, tuple(windows), level
        self.depth_range_m = depth_range_m
        self._sharpness = Sharpness(depth_range_m, level)

    def at(self, level: Level) -> Objective:
        """The same windows at another level; a coarse one needs fewer events."""
        share = self.level.scale / level.scale
        windows = [window.thinned(share) for window in self.windows]
        return Objective(self.recording, windows, self.depth_range_m, level)

    def __call__(self, correction: Correction) -> Floats:
        """(W,) sharpness of every window."""
        return self.sharpness([self.hypothesis(correction)] * len(self.windows))

    def varied(self, best: Correction, values: Mapping[Parameter, float]) -> Floats:
        """(W,) log sharpness with some values changed, and the mean of the clocks kept."""
        return np.log(self(best.varied(values, len(self.recording.rig))))

    def hypothesis(self, correction: Correction) -> Hypothesis:
        """Calibration, poses and clocks after a correction."""
        rig, poses = self.recording.rig, self.recording.trajectory
        clock_us = correction.clock_us(len(rig))
        return Hypothesis(correction.rig(rig), correction.trajectory(poses), clock_us)

    def sharpness(self, hypotheses: Sequence[Hypothesis]) -> Floats:
        """(W,) sharpness of each window under a hypothesis of its own."""
        return self._sharpness(self.windows, hypotheses)


def approach(
    objective: Objective, parameters: Sequence[Parameter], best: Correction,
    on_scan: Callable[[], None],
) -> Correction:  # fmt: skip
    """Scans one parameter after the other, each around the best of those before, ever finer.

    The best determined parameters come first; `on_scan` is called after each scan.
    """
    for level, share, points in SCANS:
        function = objective.at(level)
        for parameter in parameters:
            offsets = np.linspace(-1, 1, points) * share * parameter.reach
            at = best.values.get(parameter, 0.0) + offsets
            scores = [function.varied(best, {parameter: float(x)}).mean() for x in at]
            best = best.with_values({parameter: peak_of(at, np.array(scores))})
            on_scan()
    return best


def peak_of(at: Floats, values: Floats) -> float:
    """The place of the maximum of (N,) values at equal steps: vertex of the parabola around it."""
    k = int(values.argmax())
    if not 0 < k < len(values) - 1:
        return float(at[k])
    left, top, right = values[k - 1 : k + 2]
    bend = (top - left) + (top - right)
    return float(at[k] + ((at[1] - at[0]) * 0.5 * (right - left) / bend if bend > 0 else 0.0))


def steps(objective: Objective, parameters: Sequence[Parameter], best: Correction) -> Floats:
    """(P,) how far to vary each parameter so that the sharpness falls by about 2 %.

    Longer than the ripples of the top, and short enough for it to be a parabola.
    """
    middle, chosen = float(np.log(objective(best)).mean()), []
    for parameter in parameters:
        low, high = (share * parameter.reach for share in _STEP_SHARES)
        tried, value = 0.25 * parameter.reach, best.values.get(parameter, 0.0)
        moved = [value + sign * tried for sign in (1, -1)]
        drop = middle - np.mean([objective.varied(best, {parameter: x}).mean() for x in moved])
        step = tried * np.sqrt(_DROP / drop) if drop > 0 else high
        chosen.append(float(np.clip(step, low, high)))
    return np.array(chosen)
