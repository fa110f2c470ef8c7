"""Whether what the tracker finds can be believed: two tests of its own signals.

Agreement: the mean closeness of residuals falls where the motion does not explain the events, if
bodies move by themselves, or the map is not of what is seen. Scale: what the cameras see at once
measures the scale of the map, whatever the motion was. Where it is off, or hardly measured, because
all is far for the baseline or few edges are seen, no path is sure.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from eventsweep.plugins.track.odometry.checkpoint import State
from eventsweep.plugins.track.odometry.registration.fit import Fit

_OVER = 10  # poses: one alone says little
_DOUBTFUL, _SURE = 0.65, 0.67  # closeness, on average
_MOST_OFF = 0.03
"""Of the scale, and of its standard deviation."""


class Trust:
    """The signals of the last poses.

    Args:
        stereo: whether the scale can be measured: more than one camera.
    """

    def __init__(self, *, stereo: bool) -> None:
        self._stereo, self.reason = stereo, ""
        self._signals: deque[tuple[float, float, float]] = deque(maxlen=_OVER)

    def judge(self, fit: Fit, scale: tuple[float, float]) -> str:
        """Takes a pose's signals; returns why it is not to be believed, or nothing.

        Args:
            fit: how events and map agree.
            scale: share by which the map seems too small, and its standard deviation.
        """
        self._signals.append((fit.closeness, *scale))
        closeness, off, sigma = np.mean(self._signals, axis=0)
        enough = _SURE if self.reason else _DOUBTFUL
        if closeness < enough:
            self.reason = (
                f"events and map agree to {closeness:.2f} (0.36 is chance, {enough:.2f} needed): "
                "something moves by itself, or the map is wrong"
            )
        elif self._stereo and sigma > _MOST_OFF:
            self.reason = (
                f"the cameras measure the scale to {100 * sigma:.1f} % only "
                f"({100 * _MOST_OFF:.0f} % needed): too far for the baseline, or too few edges"
            )
        elif self._stereo and abs(off) > _MOST_OFF:
            self.reason = f"the scale is off by {100 * abs(off):.1f} %, the cameras say"
        else:
            self.reason = ""
        return self.reason

    def state(self) -> State:
        """All that decides what it says from now on."""
        return {"reason": self.reason, "signals": [list(each) for each in self._signals]}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        self.reason = state["reason"]
        self._signals.extend((a, b, c) for a, b, c in state["signals"])
