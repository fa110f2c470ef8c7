"""Sharpness of all windows' DSIs as a function of calibration: what refinement maximises."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.plugins.diagnose.calibrate.parameters import Correction
from eventsweep.plugins.diagnose.sharpness import Hypothesis, Level, Sharpness, WindowEvents

Floats = NDArray[np.float64]
FINE, MIDDLE, COARSE = Level(1, 64), Level(2, 40), Level(4, 24)


class Objective:
    """Sharpness of several windows under a correction of the calibration.

    A coarse `level` also sees large errors.
    """

    def __init__(
        self,
        recording: Recording,
        windows: Sequence[WindowEvents],
        depth_range_m: tuple[float, float],
        level: Level = FINE,
    ) -> None:
        self.recording, self.windows, self.level = recording, tuple(windows), level
        self._depth_range_m = depth_range_m
        self._sharpness = Sharpness(depth_range_m, level)

    def at(self, level: Level) -> Objective:
        """The same windows at another level; a coarse one needs fewer events."""
        share = self.level.scale / level.scale
        windows = [window.thinned(share) for window in self.windows]
        return Objective(self.recording, windows, self._depth_range_m, level)

    def with_windows(self, windows: Sequence[WindowEvents]) -> Objective:
        """The same for other windows of the recording."""
        return Objective(self.recording, windows, self._depth_range_m, self.level)

    def __call__(self, correction: Correction) -> Floats:
        """(W,) sharpness of every window."""
        return self.sharpness([self.hypothesis(correction)] * len(self.windows))

    def hypothesis(self, correction: Correction) -> Hypothesis:
        """Calibration, poses and clocks after a correction."""
        rig, poses = self.recording.rig, self.recording.trajectory
        clock_us = correction.clock_us(len(rig))
        return Hypothesis(correction.rig(rig), correction.trajectory(poses), clock_us)

    def sharpness(self, hypotheses: Sequence[Hypothesis]) -> Floats:
        """(W,) sharpness of each window under a hypothesis of its own."""
        return self._sharpness(self.windows, hypotheses)
