"""Kinds of faults that were new when earlier tables were written, and on which rules were tried.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

import planting as pl
from check_cases import pair
from check_tried import principal_point_off
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from planting import Fault, Matrix, Planter, Rng, unknown, with_poses


def _overstated(r: Recording, rng: Rng) -> Recording:
    """A tracker that reports 1.4 to 2 times the turns."""
    return pl.since_start(r, pl.rotvec(r) * rng.uniform(1.4, 2.0))


def _unequal_clocks(r: Recording, rng: Rng) -> Recording:
    """Rotations that come from 80 to 150 ms later than the positions beside them."""
    poses = r.trajectory
    later_us = np.clip(poses.t_us + round(rng.uniform(80e3, 150e3)), None, poses.t_us[-1])
    return pl.turned_by(r, Slerp(poses.t_us, pl.turns_of(r))(later_us))


def _swaying(r: Recording, rng: Rng) -> Recording:
    """Rotations of a tracker that swings about the right ones by some degrees."""
    t_s, phases = r.trajectory.t_us[:, None] / 1e6, rng.uniform(0, 2 * np.pi, 3)
    swing = np.radians(rng.uniform(3, 6)) * np.sin(rng.uniform(8, 14, 3) * t_s + phases)
    return pl.turned_by(r, pl.turns_of(r) * Rotation.from_rotvec(swing))


def _fast_clock(r: Recording, rng: Rng) -> Recording:
    """Poses stamped by a clock that runs 10 to 25 % fast."""
    t_us = r.trajectory.t_us
    return with_poses(r, t_us=t_us[0] + ((t_us - t_us[0]) * rng.uniform(1.1, 1.25)).astype(int))


def _second_upside_down(r: Recording, rng: Rng) -> Recording:
    """The second camera's events, turned by half a turn on its sensor."""
    del rng
    return pl.edited(r, pl.mirrored, 1)


def _left_handed(r: Recording, rng: Rng) -> Recording:
    """A left-handed world, and a body with x ahead, y right, z up, as in Unreal."""
    del rng
    mirror = np.diag([1.0, 1.0, -1.0])
    R_cam_body = np.array([[0.0, 1, 0], [0, 0, -1], [1, 0, 0]])
    turned = pl.turned_by(r, Rotation.from_matrix(mirror @ pl.turns_of(r).as_matrix() @ R_cam_body))
    return with_poses(turned, positions_m=r.trajectory.positions_m @ mirror)


def _very_late(r: Recording, rng: Rng) -> Recording:
    late_us = round(float(rng.uniform(180e3, 260e3)) * pl.sign(rng))
    return with_poses(r, t_us=r.trajectory.t_us + late_us)


def _understated(r: Recording, rng: Rng) -> Recording:
    """A tracker that reports 0.3 to 0.6 times the turns."""
    return pl.since_start(r, pl.rotvec(r) * rng.uniform(0.3, 0.6))


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
    return pl.turned_by(r, pl.turns_of(r) * Rotation.from_rotvec(pl.since_us(r) / 1e6 * rate))


def _stretched(r: Recording, rng: Rng) -> Recording:
    """One axis of the positions is 1.6 to 2.5 times as long as the others."""
    times = np.where(np.arange(3) == rng.integers(3), rng.uniform(1.6, 2.5), 1.0)
    return with_poses(r, positions_m=r.trajectory.positions_m * times)


def _smoothed(r: Recording, rng: Rng) -> Recording:
    """Poses that a tracker smoothed over 0.25 to 0.4 s."""
    width = round(rng.uniform(250e3, 400e3) / pl.period_us(r))
    since = uniform_filter1d(pl.rotvec(r), width, axis=0, mode="nearest")
    smooth = uniform_filter1d(r.trajectory.positions_m, width, axis=0, mode="nearest")
    return with_poses(pl.since_start(r, since), positions_m=smooth)


def _turns_wander(r: Recording, rng: Rng) -> Recording:
    """Rotations of which every second tenth of a second is another one's, 3 to 6 deg away."""
    p, axis = r.trajectory, rng.normal(size=3)
    far = np.radians(rng.uniform(3, 6)) * axis / np.linalg.norm(axis)
    knots_us = np.arange(p.t_us[0], p.t_us[-1] + 200_000, 100_000)
    off = Rotation.from_rotvec((np.arange(len(knots_us)) % 2)[:, None] * far)
    return pl.turned_by(r, pl.turns_of(r) * Slerp(knots_us, off)(p.t_us))


def _second_focal(r: Recording, rng: Rng) -> Recording:
    return pl.focal(r, pl.one_of(rng, (0.6, 0.8), (1.25, 1.6)), 1)


def _second_mirrored(r: Recording, rng: Rng) -> Recording:
    del rng
    return pl.edited(r, lambda e, sensor: pl.mirrored(e, sensor, rows=False), 1)


def _bent(r: Recording, rng: Rng) -> Recording:
    return pl.radtan(r, (float(rng.uniform(0.4, 0.8)), 0.0, 0.0, 0.0))


def _baseline_astray(r: Recording, rng: Rng) -> Recording:
    """The second camera stands 25 to 50 deg beside where it is told to, as far away."""
    angle, T_0 = rng.uniform(25, 50) * pl.sign(rng), r.rig.T_body_cam[0]
    T_0_1: Matrix = se3.inverse(T_0) @ r.rig.T_body_cam[1]
    T_0_1[:3, 3] = Rotation.from_rotvec([0, 0, angle], degrees=True).apply(T_0_1[:3, 3])
    return pl.placed(r, T_0, T_0 @ T_0_1)


def scaled(low: float, high: float) -> Planter:
    """Positions of a tracker whose scale is wrong."""

    def plant(r: Recording, rng: Rng) -> Recording:
        return with_poses(r, positions_m=r.trajectory.positions_m * rng.uniform(low, high))

    return plant


def _no_roll(r: Recording, rng: Rng) -> Recording:
    """A gimbal that reports no roll."""
    del rng
    return pl.since_start(r, pl.rotvec(r) * (1, 1, 0))


def _turns_off(r: Recording, rng: Rng) -> Recording:
    """A gyroscope whose scale is 10 to 20 % wrong."""
    return pl.since_start(r, pl.rotvec(r) * (1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.2)))


def _first_focal(r: Recording, rng: Rng) -> Recording:
    return pl.focal(r, pl.one_of(rng, (0.65, 0.8), (1.25, 1.5)), 0)


def _cropped(r: Recording, rng: Rng) -> Recording:
    """The calibration is of the whole sensor, the events of a part of it."""
    by = rng.uniform(20, 40) * pl.sign(rng)
    return pl.lenses(r, cx_px=lambda c: c + by, cy_px=lambda c: c + by / 2)


def _pincushion(r: Recording, rng: Rng) -> Recording:
    return pl.radtan(r, (float(rng.uniform(-0.25, -0.15)), 0.0, 0.0, 0.0))


def _held(r: Recording, rng: Rng) -> Recording:
    """A slow tracker whose last pose is repeated for 60 to 100 ms."""
    step = max(2, round(rng.uniform(60e3, 100e3) / pl.period_us(r)))
    return pl.repeated(r, np.arange(len(r.trajectory)) // step * step)


def _smooth_positions(r: Recording, rng: Rng) -> Recording:
    """Positions alone that a filter smoothed over 0.3 to 0.4 s."""
    width = round(rng.uniform(300e3, 400e3) / pl.period_us(r))
    return with_poses(r, positions_m=uniform_filter1d(r.trajectory.positions_m, width, axis=0))


def _strays(r: Recording, rng: Rng) -> Recording:
    """Every twentieth pose lies 3 to 10 cm beside."""
    positions_m = r.trajectory.positions_m.copy()
    off_m = rng.normal(size=positions_m[::20].shape)
    off_m *= rng.uniform(0.03, 0.1) / np.linalg.norm(off_m, axis=1, keepdims=True)
    positions_m[::20] += off_m
    return with_poses(r, positions_m=positions_m)


def _noisy_turns(r: Recording, rng: Rng) -> Recording:
    noise = np.radians(rng.uniform(0.5, 1.0)) * rng.normal(size=(len(r.trajectory), 3))
    return pl.turned_by(r, pl.turns_of(r) * Rotation.from_rotvec(noise))


def _clock_jumps(r: Recording, rng: Rng) -> Recording:
    """The tracker's clock jumps by 60 to 120 ms in the middle."""
    t_us = r.trajectory.t_us
    later = t_us > (t_us[0] + t_us[-1]) // 2
    return with_poses(r, t_us=t_us + later * round(rng.uniform(60e3, 120e3)))


def _w_negated(r: Recording, rng: Rng) -> Recording:
    """Quaternions of which w has the other sign: those of the inverse rotations."""
    del rng
    return with_poses(r, quats_xyzw=r.trajectory.quats_xyzw * (1, 1, 1, -1))


def _other_camera(r: Recording, rng: Rng) -> Recording:
    """Poses of the second camera, taken for those of the first."""
    del rng
    T_body_0, T_body_1 = r.rig.T_body_cam[:2]
    T_0_1 = se3.inverse(T_body_0) @ T_body_1
    return pl.posed_from(r, T_body_0 @ T_0_1 @ se3.inverse(T_body_0))


def _far_late(r: Recording, rng: Rng) -> Recording:
    late_us = round(1e3 * float(rng.uniform(300, 400)) * pl.sign(rng))
    return with_poses(r, t_us=r.trajectory.t_us + late_us)


def _camera_late(r: Recording, rng: Rng) -> Recording:
    return pl.second_late(r, round(float(rng.uniform(300e3, 380e3)) * pl.sign(rng)))


def _baseline_negated(r: Recording, rng: Rng) -> Recording:
    """The rotation of one direction beside the translation of the other."""
    del rng
    return pl.second_moved(r, pl.with_translation(lambda t: -t))


def _baseline_upright(r: Recording, rng: Rng) -> Recording:
    """x and y of the translation exchanged."""
    del rng
    return pl.second_moved(r, pl.with_translation(lambda t: t[[1, 0, 2]]))


def _second_rows_mirrored(r: Recording, rng: Rng) -> Recording:
    del rng
    return pl.edited(r, lambda e, sensor: pl.mirrored(e, sensor, columns=False), 1)


def _second_read_late(r: Recording, rng: Rng) -> Recording:
    """The second camera's columns are stamped as they are read, in 15 to 30 ms."""
    whole_us = rng.uniform(15e3, 30e3)

    def edit(e: Events, sensor: Camera) -> Events:
        t_us = e.t_us + (e.x * (whole_us / sensor.width_px)).astype(np.int64)
        return replace(e, t_us=t_us)

    return pl.edited(r, edit, 1)


def _second_clock_fast(r: Recording, rng: Rng) -> Recording:
    """The second camera's clock gains 30 to 60 ms in a second."""
    rate, first_us = rng.uniform(0.03, 0.06), r.event_span_us(1)[0]

    def edit(e: Events, _sensor: Camera) -> Events:
        return replace(e, t_us=e.t_us + ((e.t_us - first_us) * rate).astype(np.int64))

    return pl.edited(r, edit, 1)


def _second_gaps(r: Recording, rng: Rng) -> Recording:
    """Every second tenth of a second of the second camera is lost."""
    del rng
    return pl.edited(r, lambda e, _: e.take(e.t_us // 100_000 % 2 == 0), 1)


_STEREO = ("stereo yaw", "stereo pitch", *pl.two("stereo yaw", "stereo pitch"))
OPENED = (
    pair("camera late", "poses late"),
    pair("left-handed poses", "cameras swapped"),
    pair("quaternions w first", "stereo yaw"),
    pair("OpenGL axes", "camera late"),
    pair("poses inverted", "stereo pitch"),
    pair("baseline off", "poses late"),
    pl.misread("yxz", "xzy"),
    Fault(
        "radians read as degrees, order yzx", pl.reread("YZX", "YZX", degrees=True),
        tuple(f"Euler angles {order} in radians read as degrees" for order in pl.EULER),
    ),
    unknown("turns overstated", _overstated),
    unknown("rotations late, positions not", _unequal_clocks),
    unknown("rotations swing", _swaying),
    unknown("clock of the poses fast", _fast_clock),
    unknown("second camera upside down", _second_upside_down),
    pair("cameras swapped", "poses late"),
    pair("NED axes", "stereo roll"),
    pair("stereo yaw", "stereo pitch"),
    pair("baseline off", "stereo pitch"),
    pair("focal length off", "poses late"),
    pair("columns mirrored", "camera late"),
    pair("rotations inverted", "cameras swapped"),
    pair("hand-eye inverted", "camera late"),
    Fault("left-handed poses, x ahead", _left_handed, ("left-handed poses, axes ahead right up",)),
    pl.misread("zxy", "yzx"),
    Fault("poses late by 180 to 260 ms", _very_late, ("pose clock",)),
    unknown("turns understated", _understated),
    unknown("positions late, rotations not", _positions_late),
    unknown("turns drift", _drifting),
    unknown("an axis of the positions stretched", _stretched),
    unknown("poses smoothed", _smoothed),
    unknown("rotations come and go", _turns_wander),
    unknown("second camera's focal length off", _second_focal),
    unknown("second camera's columns mirrored", _second_mirrored),
    unknown("distortion that is not there", _bent),
    unknown("baseline astray", _baseline_astray),
    pair("rotations inverted", "camera late"),
    pair("columns mirrored", "stereo pitch"),
    pair("NED axes", "cameras swapped"),
    pair("quaternions w first", "camera late"),
    pair("OpenGL axes", "baseline off"),
    pair("poses inverted", "stereo roll"),
    pair("hand-eye inverted", "cameras swapped"),
    pair("stereo pitch", "stereo roll"),
    pair("left-handed poses", "stereo yaw"),
    # Too long positions are too short a baseline: `check` says so in the cure of the baseline.
    unknown("positions in feet", scaled(1 / 0.3048, 1 / 0.3047), "impossible motion", "baseline"),
    unknown("positions 40 to 80 % too long", scaled(1.4, 1.8), "baseline"),
    unknown("no roll in the poses", _no_roll),
    unknown("turns off by 10 to 20 %", _turns_off),
    unknown("first camera's principal point off", principal_point_off(0), *_STEREO),
    unknown("first camera's focal length off", _first_focal),
    unknown("calibration of the sensor before a crop", _cropped, "principal point off"),
    unknown("barrel distortion that is not there", _pincushion, "distortion folds"),
    unknown("poses repeated for 60 to 100 ms", _held, "poses frozen", "poses too rare",
            "poses jump"),
    unknown("positions smoothed, rotations not", _smooth_positions),
    unknown("every twentieth pose astray", _strays, "poses jump", "noisy poses"),
    unknown("noisy rotations", _noisy_turns, "noisy poses"),
    unknown("clock of the poses jumps", _clock_jumps, "poses too rare"),
    Fault("w of the quaternions negated", _w_negated, ("rotations inverted",)),
    unknown("poses of the second camera", _other_camera),
    unknown("poses late by 300 to 400 ms", _far_late, "pose clock"),
    unknown("camera late by 300 to 380 ms", _camera_late, "camera clock"),
    unknown("direction of the baseline negated", _baseline_negated, "extrinsics inverted",
            "cameras swapped"),
    unknown("x and y of the baseline exchanged", _baseline_upright),
    unknown("second camera's rows mirrored", _second_rows_mirrored),
    unknown("second camera's columns stamped as they are read", _second_read_late),
    unknown("second camera's clock fast", _second_clock_fast),
    unknown("second camera's events lost half of the time", _second_gaps, "gaps in the events"),
)  # fmt: skip
