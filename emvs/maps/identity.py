"""What a recording holds, as a hash: work that was stopped goes on only with the same one.

Spans and counts are not enough: who corrects a recording keeps both.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from eventsweep.emvs.data.occupied import occupied_spans, steps
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry.trajectory import Trajectory

_STEP_US = 1_000_000


def content_hash(
    recording: Recording, t0_us: int, t1_us: int, *, poses: bool, imu: bool = False
) -> str:
    """A hash of all that work on `t0_us <= t < t1_us` reads: one pass over its events.

    Args:
        recording: any.
        t0_us: begin of the stretch, µs.
        t1_us: its end, excluded.
        poses: whether the work looks at poses.
        imu: whether it looks at inertial samples, which are there.
    """
    facts = [recording.name, recording.rig.to_json(), recording.depth_range_m, t0_us, t1_us]
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode())
    if poses:
        path: Trajectory = recording.trajectory
        _add(digest.update, path.t_us, path.positions_m, path.quats_xyzw)
    if imu:
        samples: Any = recording
        samples = samples.imu()
        _add(digest.update, *(np.asarray(column) for column in vars(samples).values()))
    parts = list(steps(occupied_spans(recording, t0_us, t1_us), _STEP_US))
    for camera in range(len(recording.rig)):
        columns = [hashlib.sha256() for _ in range(4)]  # each by itself: alike however it is cut
        for part in parts:
            events = recording.events(camera, *part)
            for column, values in zip(columns, events.columns, strict=True):
                _add(column.update, values)
        for column in columns:
            digest.update(column.digest())
    return digest.hexdigest()


def _add(update: Callable[[Any], None], *arrays: Any) -> None:
    for array in arrays:
        update(np.ascontiguousarray(array).data)
