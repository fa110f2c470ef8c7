"""Two faults at once, and faults that `check` has no name for: their first outcome was looked at.

They are planted in the held-out sequences only. Where nothing that `check` tries mends a fault, the
right answer is that no single cause was found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from check_cases import (
    EULER,
    FAULTS,
    EditedRecording,
    Fault,
    Planter,
    Rng,
    both,
    reread,
    turned_by,
    two,
    with_poses,
)
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording

UNKNOWN = ("no single cause found",)
_PLANTERS: dict[str, Planter] = {fault.kind: fault.plant for fault in FAULTS}


def pair(kind: str, first: str, second: str, names: tuple[str, str]) -> Fault:
    """Two faults at once, by their kinds, and what `check` calls them."""
    return Fault(kind, both(_PLANTERS[first], _PLANTERS[second]), two(*names))


def _overstated(r: Recording, rng: Rng) -> Recording:
    """A tracker that reports 1.4 to 2 times the turns."""
    turns = Rotation.from_quat(r.trajectory.quats_xyzw)
    since = (turns[0].inv() * turns).as_rotvec() * rng.uniform(1.4, 2.0)
    return turned_by(r, turns[0] * Rotation.from_rotvec(since))


def _unequal_clocks(r: Recording, rng: Rng) -> Recording:
    """Rotations that come from 80 to 150 ms later than the positions beside them."""
    poses = r.trajectory
    later_us = np.clip(poses.t_us + round(rng.uniform(80e3, 150e3)), None, poses.t_us[-1])
    turns = Slerp(poses.t_us, Rotation.from_quat(poses.quats_xyzw))(later_us)
    return turned_by(r, turns)


def _swaying(r: Recording, rng: Rng) -> Recording:
    """Rotations of a tracker that swings about the right ones by some degrees."""
    t_s, phases = r.trajectory.t_us[:, None] / 1e6, rng.uniform(0, 2 * np.pi, 3)
    swing = np.radians(rng.uniform(3, 6)) * np.sin(rng.uniform(8, 14, 3) * t_s + phases)
    return turned_by(r, Rotation.from_quat(r.trajectory.quats_xyzw) * Rotation.from_rotvec(swing))


def _fast_clock(r: Recording, rng: Rng) -> Recording:
    """Poses stamped by a clock that runs 10 to 25 % fast."""
    t_us = r.trajectory.t_us
    return with_poses(r, t_us=t_us[0] + ((t_us - t_us[0]) * rng.uniform(1.1, 1.25)).astype(int))


def _second_upside_down(r: Recording, rng: Rng) -> Recording:
    """The second camera's events, turned by half a turn on its sensor."""
    del rng
    sensor = r.rig.cameras[1]

    def edit(camera: int, e: Events) -> Events:
        if camera != 1:
            return e
        x, y = sensor.width_px - 1 - e.x, sensor.height_px - 1 - e.y
        return replace(e, x=x.astype(np.uint16), y=y.astype(np.uint16))

    return EditedRecording(r, edit)


OPENED = (
    pair("camera late, poses late", "camera late", "poses late", ("camera clock", "pose clock")),
    pair(
        "left-handed poses, cameras swapped", "left-handed poses", "cameras swapped",
        ("left-handed poses, axes right up ahead", "cameras swapped"),
    ),
    pair(
        "quaternions w first, stereo yaw", "quaternions w first", "stereo yaw",
        ("quaternions w first", "stereo yaw"),
    ),
    pair(
        "OpenGL axes, camera late", "OpenGL axes", "camera late", ("OpenGL axes", "camera clock")
    ),
    pair(
        "poses inverted, stereo pitch", "poses inverted", "stereo pitch",
        ("poses inverted", "stereo pitch"),
    ),
    pair("baseline off, poses late", "baseline off", "poses late", ("baseline", "pose clock")),
    Fault(
        "Euler angles yxz read as xzy", reread("YXZ"[::-1], "XZY"[::-1]),
        tuple(f"Euler angles {a} read as {b}" for a in EULER for b in EULER),
    ),
    Fault(
        "radians read as degrees, order yzx", reread("YZX", "YZX", degrees=True),
        tuple(f"Euler angles {order} in radians read as degrees" for order in EULER),
    ),
    Fault("turns overstated", _overstated, UNKNOWN, cases=3),
    Fault("rotations late, positions not", _unequal_clocks, UNKNOWN, cases=3),
    Fault("rotations swing", _swaying, UNKNOWN, cases=4),
    Fault("clock of the poses fast", _fast_clock, UNKNOWN, cases=2),
    Fault("second camera upside down", _second_upside_down, UNKNOWN),
)  # fmt: skip
