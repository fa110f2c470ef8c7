"""Whether what the tracker finds can be believed: tests of its own signals.

Agreement: the mean closeness of residuals falls where the motion does not explain the events, or
the map is not of what is seen. Regions: where bodies move by themselves, some parts of the images
disagree. Scale: what the cameras see at once measures the scale of the map, whatever the motion
was. Every map has other events, so what is known of the scale adds up over maps, but for what each
adds of its own: a Kalman filter. Where the scale is off, or hardly known, because all is far for
the baseline or few edges are seen, no path is sure. Spread: the covariance says how far off the
path may be. After an interruption nothing is believed before some poses agree. The beginning is not
believed before it is confirmed: a first map and the motion that it was made on agree with each
other even if both are wrong, so poses must agree with a map of what came later, too. And a path is
not believed before it is long enough for its poses to be known to a small share of it.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.windows import Window
from eventsweep.plugins.track.odometry.checkpoint import State
from eventsweep.plugins.track.odometry.drift import MOST_SHARE, Drift, Way
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.registration.fit import Evidence, Fit, Registration

FOLLOWS = Status.TRACKING, Status.UNCERTAIN
"""What a tracker says while events and map lead from pose to pose."""
_OVER, LEAST = 10, 5  # poses: one alone says little
_DOUBTFUL, _SURE = 0.65, 0.67  # closeness, on average
_MOST_OFF = 0.03
"""Of the scale, and of its standard deviation."""
_WALK = 0.3
"""Standard deviation of the scale of a map beside the last one's, over what its stereo leaves open.
Against true depth, 182 maps of twins differ by 0.09 of that and err by 0.20, but alike: their
correlation of 0.8 is no noise that adds up."""
_MOST_REGIONS = 0.25
_MOST_SPREAD, _LEAST_SPREAD_PX = 0.1, 2.0  # of the way; what is less in the images is no doubt

_PLAIN = "reason", "_has_next", "_confirming", "_known"
UNCONFIRMED = "no second map has confirmed the beginning yet"
SHORT = f"the way is too short yet to know its poses to {100 * MOST_SHARE:.0f} % of it"
WAITS = UNCONFIRMED, SHORT
"""Reasons to wait: once there is none, poses since were right all the time."""
_UNMEASURED = "the scale is known to"
_INTERRUPTED, _SPREADS = "the track was interrupted", "the position is known to"
ASTRAY = f"maps were made of doubted poses: over {100 * MOST_SHARE:.0f} % of the way may be wrong"
"""Poses agree with such maps, which are as far off as the poses that they were made on."""


def speaks_against(reason: str) -> bool:
    """Whether a reason says that poses are wrong, and not only that they are not known yet."""
    return reason not in ("", *WAITS) and not reason.startswith(_UNMEASURED)


def disagrees(reason: str) -> bool:
    """Whether a reason is that what is seen contradicts the map."""
    is_other = reason == ASTRAY or reason.startswith((_INTERRUPTED, _SPREADS))
    return speaks_against(reason) and not is_other


class Trust:
    """The signals of the last poses.

    Args:
        stereo: whether the scale can be measured: more than one camera.
    """

    def __init__(self, *, stereo: bool) -> None:
        self._stereo, self.reason = stereo, ""
        self._has_next, self._confirming = False, LEAST  # poses that must agree yet
        self._known = 0.0  # of the scale by earlier maps: information
        self._signals: deque[tuple[float, float, float, float]] = deque(maxlen=_OVER)

    @property
    def is_sound(self) -> bool:
        """Whether the last pose is as good as it can be: at most, more is to be waited for."""
        return self.reason in ("", *WAITS, ASTRAY)

    @property
    def is_confirmed(self) -> bool:
        """Whether poses have agreed with a map of what came after the beginning."""
        return not self._confirming

    @property
    def scale_sigma(self) -> float:
        """How well the scale is known by this map and those before it, as a share."""
        return float(max(self._known + self._measured, 1e-9) ** -0.5)

    @property
    def _measured(self) -> float:
        """What stereo says of the scale of late: information, alike in poses of one map."""
        return float(np.mean([each[2] for each in self._signals])) if self._signals else 0.0

    def restart(self) -> None:
        """Says that the track was interrupted: what was seen before says nothing any more."""
        self._signals.clear()
        self.reason, self._known = _INTERRUPTED, 0.0

    def judge(
        self, fit: Fit, evidence: Evidence, spread: float = 0.0, px: float = 0.0, *,
        is_short: bool = False, is_astray: bool = False,
    ) -> str:  # fmt: skip
        """Takes a pose's signals; returns why it is not to be believed, or nothing.

        Args:
            fit: how events and map agree.
            evidence: what the cameras see of it at once.
            spread: standard deviation of the position, as a share of the way.
            px: the same in the images.
            is_short: whether the way is too short for what poses leave open.
            is_astray: whether maps on doubted poses may have led the path astray.
        """
        information = evidence.scale_sigma**-2
        self._signals.append(
            (fit.closeness, evidence.regions_off, information, information * evidence.scale_off)
        )
        self.reason = self._doubt(spread if px > _LEAST_SPREAD_PX else 0.0) or ASTRAY * is_astray
        if self._confirming:
            self._confirming -= self._has_next and not self.reason
            self.reason = self.reason or UNCONFIRMED * bool(self._confirming)
        self.reason = self.reason or SHORT * is_short
        return self.reason

    def next_map(self) -> None:
        """Says that a map of what came after the beginning is tracked from here on."""
        self._has_next = True
        added = _WALK**2 / max(self._measured, 1e-9)
        self._known = 1 / (self.scale_sigma**2 + added)

    def _doubt(self, spread: float) -> str:
        closeness, regions_off, information, weighted = np.mean(self._signals, axis=0)
        doubted = not self.is_sound
        enough = _SURE if doubted else _DOUBTFUL
        off, sigma = weighted / max(information, 1e-9), self.scale_sigma
        if closeness < enough:
            return (
                f"events and map agree to {closeness:.2f} (0.36 is chance, {enough:.2f} needed): "
                "something moves by itself, or the map is wrong"
            )
        if regions_off > _MOST_REGIONS:
            return (
                f"events and map disagree in {100 * regions_off:.0f} % of the image's regions "
                f"({100 * _MOST_REGIONS:.0f} % allowed): something moves by itself"
            )
        if self._stereo and sigma > _MOST_OFF:
            return (
                f"{_UNMEASURED} {100 * min(sigma, 1):.1f} % only "
                f"({100 * _MOST_OFF:.0f} % needed): too far for the baseline, or too few edges"
            )
        if self._stereo and abs(off) > _MOST_OFF:
            return f"the scale is off by {100 * abs(off):.1f} %, the cameras say"
        if spread > _MOST_SPREAD:
            return (
                f"{_SPREADS} {100 * spread:.0f} % of the way only "
                f"({100 * _MOST_SPREAD:.0f} % needed)"
            )
        if doubted and len(self._signals) < LEAST:
            return f"{_INTERRUPTED}: {LEAST} poses in turn must agree"
        return ""

    def state(self) -> State:
        """All that decides what it says from now on."""
        plain = {name: getattr(self, name) for name in _PLAIN}
        return {**plain, "signals": [list(each) for each in self._signals]}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        for name in _PLAIN:
            setattr(self, name, state[name])
        self._signals.extend((a, b, c, d) for a, b, c, d in state["signals"])


class Confidence:
    """How far the poses that were found so far can be believed.

    Args:
        rig: the cameras.
        registration: what registers; it shows the last batch on the map.
    """

    def __init__(self, rig: Rig, registration: Registration) -> None:
        stereo = len(rig) > 1
        self._registration = registration
        self.trust, self._way = Trust(stereo=stereo), Way()
        self._drift = Drift(rig.baseline_m() if stereo else 0.0)

    def of(self, motion: Motion, fit: Fit) -> Status:
        """Whether the motion that was just registered can be believed."""
        spread_m = float(np.trace(self.covariance(motion)[:3, :3]) ** 0.5)
        doubt = self.trust.judge(
            fit, self._registration.evidence(motion), spread_m / max(self._drift.way_m, 1e-9),
            self._registration.in_px(spread_m), is_short=not self._way.is_known,
            is_astray=self._drift.is_astray,
        )  # fmt: skip
        return Status.UNCERTAIN if doubt else Status.TRACKING

    def again(self, motion: Motion, fit: Fit) -> Status:
        """The same of an earlier motion, on a new map; nothing is known better by it."""
        evidence, is_short = self._registration.evidence(motion), not self._way.is_known
        doubt = self.trust.judge(fit, evidence, is_short=is_short)
        return Status.UNCERTAIN if doubt else Status.TRACKING

    def covariance(self, motion: Motion) -> NDArray[np.float64]:
        """The (6, 6) covariance of a pose, see `drift`; the next ones follow from there."""
        return self._drift.at(motion, self._registration.rho)

    def found(self, motion: Motion, status: Status) -> None:
        """Says what was found next."""
        is_followed, reason = status in FOLLOWS, self.trust.reason
        self._drift.note(motion.t_us, is_doubted=not is_followed or disagrees(reason))
        if is_followed and self.trust.is_sound:
            self._way.add(motion)
        elif not is_followed or speaks_against(reason):
            self._way.interrupt()

    def found_again(self) -> None:
        """Says that the last pose was found on maps from before track was lost."""
        self._drift.found_again()

    def next_map(self, window: Window) -> None:
        """Says that the map of a window is tracked from here on."""
        self._drift.next_map(self.trust.scale_sigma, (window.t0_us, window.t1_us))
        self.trust.next_map()

    def state(self) -> State:
        """All that decides what it says from now on."""
        return {name: part.state() for name, part in self._parts().items()}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        for name, part in self._parts().items():
            part.restore(state[name])

    def _parts(self) -> dict[str, Trust | Drift | Way]:
        return {"trust": self.trust, "drift": self._drift, "way": self._way}
