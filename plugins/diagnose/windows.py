"""Windows of a recording in which its camera travels far, and the events that are kept of them.

On them `check` compares alternatives, and `calibrate` refines a calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.occupied import Span, length_of, occupied_spans, spread, steps
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.maps.first_pass import settled
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.diagnose.sharpness import WindowEvents

_IN_EACH_PART = 5  # candidates in each part of the recording; the best is taken
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
    """Begin and end of the windows of a plan, µs, in order: in every part that of most travel.

    Raises:
        InputError: poses and events that share less than a window.
    """
    spans = shared_spans(recording, plan.margin_us)
    plan = _shortened(recording, plan, spans)
    length_us = round(1e6 * plan.length_s)
    rooms_us = [end_us - first_us - length_us for first_us, end_us in spans]
    if max(rooms_us, default=-1) < 0:
        raise InputError(
            f"{recording.name}: events and poses overlap for {length_of(spans) / 1e6:.3f} s, "
            f"less the margin for clock offsets: needs at least {plan.length_s:g} s"
        )
    room_us = sum(max(room_us, 0) for room_us in rooms_us)
    count = max(1, min(plan.count, 1 + round(2 * room_us / length_us)))
    begins_us = spread(spans, length_us, count * _IN_EACH_PART)
    way_m = travel_m(recording, begins_us, length_us, 4).reshape(count, -1)
    best = begins_us.reshape(count, -1)[np.arange(count), way_m.argmax(axis=1)]
    return [(int(t_us), int(t_us) + length_us) for t_us in best]


def _shortened(recording: Recording, plan: WindowPlan, spans: Sequence[Span]) -> WindowPlan:
    """The plan, with more and shorter windows where the camera turns fast."""
    t_us = np.array([first_us for first_us, _ in steps(spans, _TURN_STEP_US)], np.int64)
    near = np.diff(t_us) == _TURN_STEP_US
    if not near.any():
        return plan
    R_world_body = Rotation.from_matrix(recording.trajectory.at(t_us)[:, :3, :3])
    turns_rad = (R_world_body[:-1].inv() * R_world_body[1:]).magnitude()[near]
    rate_rad_s = float(np.sqrt((turns_rad**2).mean())) / (1e-6 * _TURN_STEP_US)
    share = min(1.0, np.radians(plan.turn_deg) / max(plan.length_s * rate_rad_s, 1e-9))
    more = min(round(plan.count / share), max(plan.count, _MOST_OF_SHORT))
    return replace(plan, count=more, length_s=share * plan.length_s)


def farthest(recording: Recording, length_us: int, count: int, candidates: int) -> list[int]:
    """Begins, µs, in order, of the windows with most travel; they overlap by half at most.

    Raises:
        InputError: poses and events that share less than a window.
    """
    spans = shared_spans(recording)
    if max((end_us - first_us for first_us, end_us in spans), default=-1) < length_us:
        raise InputError(
            f"poses and the events of all cameras overlap for {length_of(spans) / 1e6:g} s: "
            f"needs {length_us / 1e6:g} s"
        )
    begins_us = np.unique(spread(spans, length_us, candidates))
    chosen: list[int] = []
    ways_m = travel_m(recording, begins_us, length_us, 8)
    for begin_us in begins_us[np.argsort(ways_m, kind="stable")[::-1]].tolist():
        gap_us = min((abs(begin_us - other_us) for other_us in chosen), default=length_us)
        # Windows may overlap by half where a recording is short: their edges differ nevertheless.
        if gap_us >= length_us // 2 and len(chosen) < count:
            chosen.append(begin_us)
    return sorted(chosen)


def with_range(recording: Recording, config: MapperConfig) -> MapperConfig:
    """The configuration with the depth range that a coarse pass sees, where nobody gave one.

    As it is where no window can be looked at: findings say more of what is wrong.
    """
    try:
        return settled(recording, config, doubt=lambda _line: None).config
    except InputError:
        return config


def shared_spans(recording: Recording, margin_us: int = 0) -> tuple[Span, ...]:
    """The time that all cameras' events and poses share, with a margin at the ends of the poses.

    Long silences are left out.
    """
    spans_us = [recording.event_span_us(camera) for camera in range(len(recording.rig))]
    first_us, last_us = recording.trajectory.span_us
    first_us = max(first_us + margin_us, *(first for first, _ in spans_us))
    last_us = min(last_us - margin_us, *(last for _, last in spans_us))
    return occupied_spans(recording, first_us, last_us)


def travel_m(
    recording: Recording, begins_us: NDArray[np.int64], length_us: int, steps: int
) -> NDArray[np.float64]:
    """(N,) how far the first camera travels in windows, m, summed over so many steps."""
    t_us = begins_us[:, None] + np.arange(steps + 1) * length_us // steps
    places_m = (recording.trajectory.at(t_us) @ recording.rig.T_body_cam[0])[..., :3, 3]
    return np.asarray(np.linalg.norm(np.diff(places_m, axis=1), axis=2).sum(axis=1))
