"""A stereo pair made of one real camera that slides along a straight line past a scene at rest.

What a second camera, a baseline farther on, sees at some time is what the one camera sees when it
has come there. So the events of the second are those of the first, stamped with the time at which
the first was a baseline before the place where it saw them: real events of a real sensor, twice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig

_MOST_ASIDE_M, _MOST_TURN = 1e-4, 1e-4  # of a straight motion along the camera's x axis


def straight_way(recording: Recording) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times, µs, and how far along its x axis a camera has come, m, without where it rests.

    Raises:
        InputError: it turns, or leaves the line.
    """
    path = recording.trajectory
    aside_m = float(np.abs(path.positions_m[:, 1:] - path.positions_m[0, 1:]).max())
    turn = float(np.abs(path.quats_xyzw[:, :3]).max())
    if aside_m > _MOST_ASIDE_M or turn > _MOST_TURN or len(recording.rig) != 1:
        raise InputError(
            f"{recording.name}: {len(recording.rig)} camera(s), up to {aside_m:.4f} m aside, "
            f"turned by up to {2 * turn:.4f} rad: needs one camera that slides along its x axis, "
            "as in slider_depth"
        )
    x_m = path.positions_m[:, 0]
    moves = np.r_[True, x_m[1:] > np.maximum.accumulate(x_m)[:-1]]
    return path.t_us[moves], x_m[moves]


class SlidPair(DerivedRecording):
    """The recording as camera 0, and the same camera a baseline to the right of it as camera 1."""

    def __init__(self, recording: Recording, baseline_m: float) -> None:
        super().__init__(recording)
        t_us, x_m = straight_way(recording)
        T_body_cam = np.eye(4)
        T_body_cam[0, 3] = baseline_m
        camera = recording.rig.cameras[0]
        self._rig = Rig(f"slid {baseline_m:g} m", (camera, camera), (np.eye(4), T_body_cam))
        whole = recording.events(0, int(t_us[0]), int(t_us[-1]))
        self._events = whole, _seen_before(whole, t_us, x_m, baseline_m)
        self._span_us = int(t_us[0]), int(self._events[1].t_us[-1])

    @property
    def rig(self) -> Rig:
        """Two cameras."""
        return self._rig

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """From the first pose to where the second camera's events end, µs."""
        self.rig.check_camera(camera)
        return self._span_us

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        return self._events[camera].between(t0_us, t1_us)


def _seen_before(
    events: Events, t_us: NDArray[np.int64], x_m: NDArray[np.float64], baseline_m: float
) -> Events:
    """Events stamped with when the camera was a baseline before where it saw them."""
    before_m = np.interp(events.t_us, t_us, x_m) - baseline_m
    there = before_m > x_m[0]
    if not there.any():
        raise InputError(f"baseline {baseline_m:g} m: longer than the way; choose a shorter one")
    stamped_us = np.rint(np.interp(before_m[there], x_m, t_us)).astype(np.int64)
    return Events(events.x[there], events.y[there], stamped_us, events.p[there])
