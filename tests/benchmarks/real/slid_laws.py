"""A recording under another law of motion: the same events, stamped with other times.

What a camera sees on a line past a scene at rest depends on where it is, not on when. So events and
poses restamped alike are those of a body that goes the same way faster, in waves, with stops, or
there and back: real events, of motions that nobody recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from slid_pair import SlidPair

_STEPS, _POSE_US = 40_001, 1000
_WAVE, _STOPPED, _STOP_WIDTH = 0.8, 0.01, 0.02  # of the speed; of the mean speed; of the way


@dataclass(frozen=True)
class Law:
    """How the way is gone, in the time that it took, divided by `faster`.

    Attributes:
        faster: by which factor.
        waves: periods of a speed that swings by 80 %.
        stops: how often the body nearly comes to rest.
        back: whether it then turns at once, and goes all of the way back.
    """

    faster: float = 1.0
    waves: int = 0
    stops: int = 0
    back: bool = False

    def __str__(self) -> str:
        said = [f"×{self.faster:g}"]
        said += [f"{self.waves} waves"] * bool(self.waves) + [f"{self.stops} stops"] * (
            self.stops > 0
        )
        return ", ".join([*said, *["there and back"] * self.back])

    def times_us(self, t_us: NDArray[np.int64], span_us: tuple[int, int]) -> NDArray[np.int64]:
        """When the body is where it was at these times of its recording, on the way there."""
        first_us, last_us = span_us
        share = np.linspace(0, 1, _STEPS)
        speed = 1 + _WAVE * np.sin(2 * np.pi * self.waves * share)
        if self.stops:
            beside = (self.stops * share) % 1 - 0.5
            speed = np.maximum(1 - np.exp(-0.5 * (beside / _STOP_WIDTH) ** 2), _STOPPED)
        passed = np.concatenate([[0.0], np.cumsum(1 / speed[1:] + 1 / speed[:-1])])
        there = np.interp((t_us - first_us) / (last_us - first_us), share, passed / passed[-1])
        times_us: NDArray[np.int64] = np.rint(
            first_us + there * (last_us - first_us) / self.faster
        ).astype(np.int64)
        return times_us


class Restamped(DerivedRecording):
    """A recording under a law of motion; backwards, what became brighter becomes darker."""

    def __init__(self, recording: Recording, law: Law) -> None:
        super().__init__(recording)
        span_us, path = recording.event_span_us(0), recording.trajectory
        self._law, self._ends_us = law, span_us
        ends_us = max(span_us[0], path.t_us[0]), min(span_us[1], path.t_us[-1])
        given_us = np.arange(
            ends_us[0], ends_us[1] + 1, _POSE_US
        )  # between poses speed is constant
        t_us, T_world_body = self._times(given_us), self._both(path.at(given_us))
        rises = np.concatenate([[True], np.diff(t_us) > 0])
        self._path = Trajectory.from_matrices(t_us[rises], T_world_body[rises])
        self._streams = [
            self._restamped(recording.events(k, *span_us)) for k in range(len(recording.rig))
        ]

    def _times(self, t_us: NDArray[np.int64]) -> NDArray[np.int64]:
        there_us = self._law.times_us(t_us, self._ends_us)
        turns_us = self._law.times_us(np.array([self._ends_us[1]]), self._ends_us)[0]
        return np.concatenate([there_us, 2 * turns_us - there_us[::-1]][: 1 + self._law.back])

    def _both(self, values: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([values, values[::-1]][: 1 + self._law.back])

    def _restamped(self, events: Events) -> Events:
        polarity = [events.p, 1 - events.p[::-1]][: 1 + self._law.back]
        return Events(
            self._both(events.x), self._both(events.y), self._times(events.t_us),
            np.concatenate(polarity).astype(events.p.dtype),
        )  # fmt: skip

    @property
    def trajectory(self) -> Trajectory:
        """The poses, under the law."""
        return self._path

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """From the first pose to where the first camera's events end, µs."""
        self.rig.check_camera(camera)
        return int(self._path.t_us[0]), int(min(stream.t_us[-1] for stream in self._streams))

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        return self._streams[camera].between(t0_us, t1_us)


class SlidTriple(SlidPair):
    """The recording as camera 0, and the same camera one and two baselines to the right of it."""

    def __init__(self, recording: Recording, baseline_m: float) -> None:
        super().__init__(recording, baseline_m)
        farther = SlidPair(recording, 2 * baseline_m)
        camera, places = farther.rig.cameras[0], [*self._rig.T_body_cam, farther.rig.T_body_cam[1]]
        self._rig = Rig(f"slid 2 × {baseline_m:g} m", (camera,) * 3, tuple(places))
        self._events = *self._events, farther._events[1]  # type: ignore[assignment]
        self._span_us = farther.event_span_us(0)
