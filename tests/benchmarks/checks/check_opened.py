"""Two faults at once, and faults that `check` has no name for, on which rules were tried.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from check_cases import (
    EULER,
    FAULTS,
    EditedRecording,
    Fault,
    Matrix,
    Planter,
    Rng,
    both,
    reread,
    turned_by,
    two,
    with_poses,
)
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig

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


_FIRST = (
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
    Fault("turns overstated", _overstated, UNKNOWN),
    Fault("rotations late, positions not", _unequal_clocks, UNKNOWN),
    Fault("rotations swing", _swaying, UNKNOWN),
    Fault("clock of the poses fast", _fast_clock, UNKNOWN),
    Fault("second camera upside down", _second_upside_down, UNKNOWN),
)  # fmt: skip


def _left_handed(r: Recording, rng: Rng) -> Recording:
    """A left-handed world, and a body with x ahead, y right, z up, as in Unreal."""
    del rng
    mirror = np.diag([1.0, 1.0, -1.0])
    R_cam_body = np.array([[0.0, 1, 0], [0, 0, -1], [1, 0, 0]])
    R = mirror @ Rotation.from_quat(r.trajectory.quats_xyzw).as_matrix() @ R_cam_body
    turned = turned_by(r, Rotation.from_matrix(R))
    return with_poses(turned, positions_m=r.trajectory.positions_m @ mirror)


def _very_late(r: Recording, rng: Rng) -> Recording:
    late_us = round(float(rng.uniform(180e3, 260e3)) * rng.choice([-1, 1]))
    return with_poses(r, t_us=r.trajectory.t_us + late_us)


def _understated(r: Recording, rng: Rng) -> Recording:
    """A tracker that reports 0.3 to 0.6 times the turns."""
    turns = Rotation.from_quat(r.trajectory.quats_xyzw)
    since = (turns[0].inv() * turns).as_rotvec() * rng.uniform(0.3, 0.6)
    return turned_by(r, turns[0] * Rotation.from_rotvec(since))


def _positions_late(r: Recording, rng: Rng) -> Recording:
    """Positions that come from 80 to 150 ms earlier than the rotations beside them."""
    p, earlier_us = r.trajectory, round(rng.uniform(80e3, 150e3))
    at_us = np.clip(p.t_us - earlier_us, p.t_us[0], None)
    moved = [np.interp(at_us, p.t_us, p.positions_m[:, k]) for k in range(3)]
    return with_poses(r, positions_m=np.stack(moved, axis=1))


def _drifting(r: Recording, rng: Rng) -> Recording:
    """A gyroscope's bias: turns of 8 to 20 deg/s are added about some axis."""
    axis = rng.normal(size=3)
    rate = np.radians(rng.uniform(8, 20)) * axis / np.linalg.norm(axis)
    since_s = (r.trajectory.t_us - r.trajectory.t_us[0])[:, None] / 1e6
    turns = Rotation.from_quat(r.trajectory.quats_xyzw)
    return turned_by(r, turns * Rotation.from_rotvec(since_s * rate))


def _stretched(r: Recording, rng: Rng) -> Recording:
    """One axis of the positions is 1.6 to 2.5 times as long as the others."""
    times = np.where(np.arange(3) == rng.integers(3), rng.uniform(1.6, 2.5), 1.0)
    return with_poses(r, positions_m=r.trajectory.positions_m * times)


def _smoothed(r: Recording, rng: Rng) -> Recording:
    """Poses that a tracker smoothed over 0.25 to 0.4 s."""
    p = r.trajectory
    width = round(rng.uniform(250e3, 400e3) / float(np.median(np.diff(p.t_us))))
    turns = Rotation.from_quat(p.quats_xyzw)
    since = uniform_filter1d((turns[0].inv() * turns).as_rotvec(), width, axis=0, mode="nearest")
    smooth = uniform_filter1d(p.positions_m, width, axis=0, mode="nearest")
    return with_poses(turned_by(r, turns[0] * Rotation.from_rotvec(since)), positions_m=smooth)


def _turns_wander(r: Recording, rng: Rng) -> Recording:
    """Rotations of which every second tenth of a second is another one's, 3 to 6 deg away."""
    p, axis = r.trajectory, rng.normal(size=3)
    far = np.radians(rng.uniform(3, 6)) * axis / np.linalg.norm(axis)
    knots_us = np.arange(p.t_us[0], p.t_us[-1] + 200_000, 100_000)
    off = Rotation.from_rotvec((np.arange(len(knots_us)) % 2)[:, None] * far)
    return turned_by(r, Rotation.from_quat(p.quats_xyzw) * Slerp(knots_us, off)(p.t_us))


def _second(change: Callable[[Camera], Camera], r: Recording) -> Recording:
    """The second camera told otherwise."""
    cameras = tuple(change(c) if k == 1 else c for k, c in enumerate(r.rig.cameras))
    return AlteredRecording(r, rig=replace(r.rig, cameras=cameras))


def _second_focal(r: Recording, rng: Rng) -> Recording:
    times = float(rng.choice([rng.uniform(0.6, 0.8), rng.uniform(1.25, 1.6)]))
    return _second(lambda c: replace(c, fx_px=c.fx_px * times, fy_px=c.fy_px * times), r)


def _second_mirrored(r: Recording, rng: Rng) -> Recording:
    del rng
    last = r.rig.cameras[1].width_px - 1

    def edit(camera: int, e: Events) -> Events:
        return e if camera != 1 else replace(e, x=(last - e.x).astype(np.uint16))

    return EditedRecording(r, edit)


def _bent(r: Recording, rng: Rng) -> Recording:
    """Distortion that the lenses do not have."""
    k1 = float(rng.uniform(0.4, 0.8))
    told = tuple(replace(c, model="radtan", distortion=(k1, 0.0, 0.0, 0.0)) for c in r.rig.cameras)
    return AlteredRecording(r, rig=replace(r.rig, cameras=told))


def _baseline_astray(r: Recording, rng: Rng) -> Recording:
    """The second camera stands 25 to 50 deg beside where it is told to, as far away."""
    angle, rig = rng.uniform(25, 50) * rng.choice([-1, 1]), r.rig
    T_0_1: Matrix = se3.inverse(rig.T_body_cam[0]) @ rig.T_body_cam[1]
    T_0_1[:3, 3] = Rotation.from_rotvec([0, 0, angle], degrees=True).apply(T_0_1[:3, 3])
    T = (rig.T_body_cam[0], rig.T_body_cam[0] @ T_0_1, *rig.T_body_cam[2:])
    return AlteredRecording(r, rig=Rig(rig.name, rig.cameras, T, rig.camera_names))


def _unknown(kind: str, plant: Planter) -> Fault:
    return Fault(kind, plant, UNKNOWN)


_LATER = (
    pair("cameras swapped, poses late", "cameras swapped", "poses late",
         ("cameras swapped", "pose clock")),
    pair("NED axes, stereo roll", "NED axes", "stereo roll", ("NED axes", "stereo roll")),
    pair("stereo yaw, stereo pitch", "stereo yaw", "stereo pitch",
         ("stereo yaw", "stereo pitch")),
    pair("baseline off, stereo pitch", "baseline off", "stereo pitch",
         ("baseline", "stereo pitch")),
    pair("focal length off, poses late", "focal length off", "poses late",
         ("focal length", "pose clock")),
    pair("columns mirrored, camera late", "columns mirrored", "camera late",
         ("columns mirrored", "camera clock")),
    pair("rotations inverted, cameras swapped", "rotations inverted", "cameras swapped",
         ("rotations inverted", "cameras swapped")),
    pair("hand-eye inverted, camera late", "hand-eye inverted", "camera late",
         ("hand-eye inverted", "camera clock")),
    Fault("left-handed poses, x ahead", _left_handed,
          ("left-handed poses, axes ahead right up",)),
    Fault("Euler angles zxy read as yzx", reread("ZXY"[::-1], "YZX"[::-1]),
          tuple(f"Euler angles {a} read as {b}" for a in EULER for b in EULER)),
    Fault("poses late by 180 to 260 ms", _very_late, ("pose clock",)),
    _unknown("turns understated", _understated),
    _unknown("positions late, rotations not", _positions_late),
    _unknown("turns drift", _drifting),
    _unknown("an axis of the positions stretched", _stretched),
    _unknown("poses smoothed", _smoothed),
    _unknown("rotations come and go", _turns_wander),
    _unknown("second camera's focal length off", _second_focal),
    _unknown("second camera's columns mirrored", _second_mirrored),
    _unknown("distortion that is not there", _bent),
    _unknown("baseline astray", _baseline_astray),
)  # fmt: skip
OPENED = (*_FIRST, *_LATER)
