"""The windows on which a check compares alternatives, and how sharp they are under each.

Under right poses no other turn of the camera makes rays meet much more sharply: what is gained
where it may turn freely says how far poses and events are from each other, whatever the cause. Only
turns: under free translations rays can collapse onto a few voxels, which is sharp and wrong (event
collapse: Shiba et al., Sensors 2022).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.utils.runtime import use_threads
from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.alternatives import Alter, Chosen
from eventsweep.plugins.diagnose.check.limits import WINDOW_US
from eventsweep.plugins.diagnose.sharpness import Hypothesis, Sharpness, WindowEvents, around
from eventsweep.plugins.diagnose.windows import farthest, travel_m

Gains = NDArray[np.float64]
Turned = Callable[[Recording, int, Gains], Recording]


class WindowRecording(DerivedRecording):
    """A recording whose events are those of one window, thinned evenly and kept in memory."""

    def __init__(self, recording: Recording, t0_us: int, t1_us: int, most: int) -> None:
        super().__init__(recording)
        cameras = range(len(recording.rig))
        self._streams = [recording.events(k, t0_us, t1_us).thinned(most) for k in cameras]
        self._chosen: dict[tuple[int, ...], Chosen] = {}

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """The kept events of a camera with `t0_us <= t < t1_us`."""
        return self._streams[camera].between(t0_us, t1_us)

    def thinned(self, share: float) -> WindowRecording:
        """The same window with a share of its events, evenly through the streams."""
        fewer = copy(self)
        fewer._streams = [s.thinned(max(1, int(share * len(s)))) for s in self._streams]
        fewer._chosen = {}
        return fewer

    def chosen(self, cameras: tuple[int, ...]) -> Chosen:
        """Some of its cameras; the same object each time."""
        if cameras not in self._chosen:
            self._chosen[cameras] = Chosen(self, cameras)
        return self._chosen[cameras]


class Halves(DerivedRecording):
    """Every other event of a recording's first camera, and the others, as of two cameras."""

    def __init__(self, recording: Recording) -> None:
        super().__init__(Chosen(recording, (0, 0)))

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """One half of the events with `t0_us <= t < t1_us`."""
        events = self.recording.events(camera, t0_us, t1_us)
        return events.take(np.arange(camera, len(events), 2))


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

    @cached_property
    def leading_at(self) -> int:
        """Which window has the longest way."""
        begins = np.array(self.middles_us)[:, None] - WINDOW_US // 2
        ways = [travel_m(*each, WINDOW_US, 8) for each in zip(self.windows, begins, strict=True)]
        return int(np.argmax(ways))

    @cached_property
    def leading(self) -> TrialWindows:
        """The window with the longest way alone."""
        alone = slice(self.leading_at, self.leading_at + 1)
        return TrialWindows(self.windows[alone], self.middles_us[alone], self.sharpness)

    @classmethod
    def of(cls, recording: Recording, config: MapperConfig) -> tuple[TrialWindows, TrialWindows]:
        """The windows with the longest ways among those that poses and events cover.

        Fine ones, and the same with fewer events in coarse volumes. Pixels are joined until the
        view is no wider than those of the first sensors: windows keep as many events whatever the
        sensor, and on more pixels they would only lie thinner.

        Raises:
            InputError: poses and events cover no window together.
        """
        use_threads(config.threads)
        begins = farthest(recording, WINDOW_US, limits.WINDOWS, limits.CANDIDATES)
        range_m, most = depth_range_m(recording, config), limits.EVENTS
        windows = tuple(WindowRecording(recording, t, t + WINDOW_US, most) for t in begins)
        middles_us = tuple(t + WINDOW_US // 2 for t in begins)
        fewer = tuple(window.thinned(limits.COARSE_SHARE) for window in windows)
        joined = -(-recording.rig.cameras[0].width_px // limits.WIDEST_PX)
        fine, coarse = (
            Sharpness(range_m, replace(level, scale=level.scale * joined))
            for level in (limits.FINE, limits.COARSE)
        )
        return cls(windows, middles_us, fine), cls(fewer, middles_us, coarse)

    def log_sharpness(self, change: Alter, cameras: tuple[int, ...]) -> Gains:
        """(W,) logarithm of the windows' sharpness under an alternative.

        Args:
            change: applies the alternative to a recording of the chosen cameras.
            cameras: one, or a pair that is fused.
        """
        return self._of([change(window.chosen(cameras)) for window in self.windows])

    def agreement(self, change: Alter, cameras: tuple[int, int]) -> Gains:
        """(W,) how well two cameras agree, beside how well two halves of the first one's events do.

        Two that agree are fused as sharp as each is alone. How much random events take away shows
        in the halves, which share pose and calibration: log sharpness fused less that alone of the
        cameras, less the same of the halves. About 0 if all is right, negative if cameras disagree.
        """
        recordings = [change(window.chosen(cameras)) for window in self.windows]
        return self._lost(list(map(Halves, recordings))) - self._lost(recordings)

    def _lost(self, pairs: Sequence[Recording]) -> Gains:
        """(W,) log sharpness of each of two cameras alone, their harmonic mean, less that fused."""
        alone = [self._of([Chosen(pair, (k,)) for pair in pairs]) for k in range(2)]
        both = np.log(np.exp(-np.array(alone)).mean(axis=0))
        return np.asarray(-both - self._of(pairs))

    def free_turn_gains(self, change: Alter, cameras: tuple[int, ...]) -> Gains:
        """(W,) how much log sharpness grows where the rig may turn at another, constant rate."""
        return self._freely(change, cameras, limits.TURNS_RAD_S, _turning)

    def free_squint_gains(self, change: Alter, cameras: tuple[int, int]) -> Gains:
        """(W,) how much log sharpness grows where the second camera may be turned on the rig."""
        return self._freely(change, cameras, limits.SQUINTS_DEG, _squinting)

    def _freely(
        self, change: Alter, cameras: tuple[int, ...], steps: tuple[float, ...], turned: Turned
    ) -> Gains:
        """(W,) gains of a search along three axes, with steps that become smaller.

        Each window has amounts of its own.
        """
        recordings = [change(window.chosen(cameras)) for window in self.windows]
        amounts = np.zeros((len(recordings), 3))
        first = best = self._of(recordings)
        for step, axis, sign in product(steps, np.eye(3), (1, -1)):
            other = amounts + sign * step * axis
            gains = self._of(list(map(turned, recordings, self.middles_us, other)))
            amounts = np.where((gains > best)[:, None], other, amounts)
            best = np.maximum(gains, best)
        return best - first

    def _of(self, recordings: Sequence[Recording]) -> Gains:
        windows = list(map(_all_events, recordings, self.middles_us))
        try:
            votes = self.sharpness(windows, [Hypothesis(r.rig, r.trajectory) for r in recordings])
        except InputError:  # poses elsewhere, events off the sensor: nothing is sharp
            votes = np.zeros(len(windows))
        return np.log(np.maximum(votes, limits.NOTHING))


def _all_events(window: Recording, t_ref_us: int) -> WindowEvents:
    """All kept events, in a stretch around the reference view that just holds them."""
    far_us = 10 * WINDOW_US  # beyond any clock
    cameras = range(len(window.rig))
    events = [window.events(k, t_ref_us - far_us, t_ref_us + far_us) for k in cameras]
    ends_us = [int(e.t_us[k]) for e in events if len(e) for k in (0, -1)]
    half_us = 1 + max((abs(t_us - t_ref_us) for t_us in ends_us), default=0)
    return WindowEvents(t_ref_us - half_us, t_ref_us + half_us, tuple(events))


def _turning(recording: Recording, t_us: int, rate_rad_s: Gains) -> Recording:
    """The recording with poses that turn in addition, about the first camera's axes."""
    poses, T_body_cam = recording.trajectory, recording.rig.T_body_cam[0]
    times_us = poses.t_us[around(poses, t_us - 3 * WINDOW_US, t_us + 3 * WINDOW_US)]
    turns = Rotation.from_rotvec((times_us - t_us)[:, None] * (rate_rad_s / 1e6))
    T_cam_turned = se3.from_rotation(turns, np.zeros((len(times_us), 3)))
    T_body_turned = T_body_cam @ T_cam_turned @ se3.inverse(T_body_cam)
    turned = Trajectory.from_matrices(times_us, poses.at(times_us) @ T_body_turned)
    return AlteredRecording(recording, trajectory=turned)


def _squinting(recording: Recording, _t_us: int, angles_deg: Gains) -> Recording:
    """The recording with the second camera turned about its own axes."""
    turn = se3.from_rotation(Rotation.from_rotvec(angles_deg, degrees=True), np.zeros(3))
    T_body_0, T_body_1 = recording.rig.T_body_cam
    places = T_body_0, T_body_1 @ turn
    return AlteredRecording(recording, rig=replace(recording.rig, T_body_cam=places))
