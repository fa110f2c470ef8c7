"""Which windows of a recording calibration uses, and the events that it keeps of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.diagnose.sharpness import WindowEvents

_CANDIDATES = 5  # in each part of the recording; the best is taken
_FEWEST_EVENTS = 1000
_MOST_OF_SHORT = 24  # more of them cost time and gain little
_TURN_STEP_US = 10_000


@dataclass(frozen=True)
class WindowPlan:
    """How windows are chosen.

    Attributes:
        count: how many at most; up to 24 of shorter ones.
        length_s: of each at most.
        events: kept per camera and window, at most.
        margin_us: between windows and the first and last pose, so that clocks may move.
        turn_deg: by which the camera may turn in a window, root mean square. Faster turns make
            windows shorter: else few edges stay in view, and lags blur what is far off.
    """

    count: int = 10
    length_s: float = 0.15
    events: int = 30_000
    margin_us: int = 60_000
    turn_deg: float = 10.0


def read_windows(
    recording: Recording, plan: WindowPlan, progress: Progress = silent
) -> tuple[WindowEvents, ...]:
    """Reads the windows with most parallax, spread over the recording, and thins their events.

    `progress` is called with the stage `windows`, how many are read, and their number.

    Raises:
        InputError: poses and events that share less than a window, or windows without events.
    """
    spans = window_spans(recording, plan)
    windows = []
    for done, (t0_us, t1_us) in enumerate(spans, 1):
        events = [recording.events(k, t0_us, t1_us) for k in range(len(recording.rig))]
        if min(map(len, events)) >= _FEWEST_EVENTS:
            thinned = tuple(stream.thinned(plan.events) for stream in events)
            windows.append(WindowEvents(t0_us, t1_us, thinned))
        progress("windows", done, len(spans))
    if len(windows) < 2:
        raise InputError(
            f"{recording.name}: {len(windows)} of {len(spans)} windows of {plan.length_s:g} s "
            f"have {_FEWEST_EVENTS} events from every camera: needs 2; use a longer recording or "
            "one with more texture"
        )
    return tuple(windows)


def window_spans(recording: Recording, plan: WindowPlan) -> list[tuple[int, int]]:
    """Begin and end of the windows of a plan, µs, in order.

    Raises:
        InputError: poses and events that share less than a window.
    """
    return _chosen_spans(recording, _shortened(recording, plan))


def _shortened(recording: Recording, plan: WindowPlan) -> WindowPlan:
    """The plan, with more and shorter windows where the camera turns fast."""
    first_us, last_us = _covered(recording, plan)
    t_us = np.arange(first_us, last_us, _TURN_STEP_US)
    if len(t_us) < 2:
        return plan
    R_world_body = Rotation.from_matrix(recording.trajectory.at(t_us)[:, :3, :3])
    turns_rad = (R_world_body[:-1].inv() * R_world_body[1:]).magnitude()
    rate_rad_s = float(np.sqrt((turns_rad**2).mean())) / (1e-6 * _TURN_STEP_US)
    share = min(1.0, np.radians(plan.turn_deg) / max(plan.length_s * rate_rad_s, 1e-9))
    more = min(round(plan.count / share), max(plan.count, _MOST_OF_SHORT))
    return replace(plan, count=more, length_s=share * plan.length_s)


def _chosen_spans(recording: Recording, plan: WindowPlan) -> list[tuple[int, int]]:
    """In every part of the recording the window in which the camera travels farthest."""
    first_us, last_us = _covered(recording, plan)
    length_us = round(1e6 * plan.length_s)
    room_us = last_us - first_us - length_us
    if room_us < 0:
        raise InputError(
            f"{recording.name}: events and poses overlap for {(last_us - first_us) / 1e6:.3f} s, "
            f"less the margin for clock offsets: needs at least {plan.length_s:g} s"
        )
    count = max(1, min(plan.count, 1 + round(2 * room_us / length_us)))
    starts = first_us + np.linspace(0, room_us, count * _CANDIDATES).astype(np.int64)
    way_m = _ways_m(recording, starts, length_us).reshape(count, -1)
    best = starts.reshape(count, -1)[np.arange(count), way_m.argmax(axis=1)]
    return [(int(t_us), int(t_us) + length_us) for t_us in best]


def _covered(recording: Recording, plan: WindowPlan) -> tuple[int, int]:
    spans = [recording.event_span_us(k) for k in range(len(recording.rig))]
    pose_first_us, pose_last_us = recording.trajectory.span_us
    first_us = max(max(first for first, _ in spans), pose_first_us + plan.margin_us)
    last_us = min(min(last for _, last in spans), pose_last_us - plan.margin_us)
    return first_us, last_us


def _ways_m(
    recording: Recording, starts_us: NDArray[np.int64], length_us: int
) -> NDArray[np.float64]:
    """How far the first camera travels in windows that begin at given times, m."""
    T_body_cam = recording.rig.T_body_cam[0]
    places = [
        (recording.trajectory.at(starts_us + share * length_us // 4) @ T_body_cam)[:, :3, 3]
        for share in range(5)
    ]
    return np.asarray(np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0))
