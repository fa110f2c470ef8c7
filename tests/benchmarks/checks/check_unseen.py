"""New kinds of faults, written down and committed before any of them was planted.

All rules of `check` were chosen with other kinds and other sequences. Where nothing that `check`
tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from check_cases import (
    FAULTS,
    EditedRecording,
    Fault,
    Matrix,
    Planter,
    Rng,
    both,
    hand_eye,
    tracked,
    turned_by,
    with_poses,
)
from check_opened import UNKNOWN, pair
from check_shown import second_moved
from check_tried import lenses, since_start
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory

_PLANTERS: dict[str, Planter] = {fault.kind: fault.plant for fault in FAULTS}
Floats = Matrix
Bend = Callable[[Floats, Rng], Floats]
EditOne = Callable[[Events, Camera, Rng], Events]


def _posed(change: Callable[[Trajectory, Rng], Trajectory]) -> Planter:
    return lambda r, rng: AlteredRecording(r, trajectory=change(r.trajectory, rng))


def _events(edit: EditOne, *only: int) -> Planter:
    """Events of some cameras edited, and sorted by time again; of all where none is given."""

    def plant(r: Recording, rng: Rng) -> Recording:
        seed = int(rng.integers(2**31))

        def edited(camera: int, e: Events) -> Events:
            if only and camera not in only:
                return e
            e = edit(e, r.rig.cameras[camera], np.random.default_rng(seed))
            return e.take(np.argsort(e.t_us, kind="stable"))

        return EditedRecording(r, edited)

    return plant


def _axis(rng: Rng) -> Matrix:
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _since_s(p: Trajectory) -> Matrix:
    return np.asarray((p.t_us - p.t_us[0])[:, None] / 1e6)


def _w_first_inverse(r: Recording, rng: Rng) -> Recording:
    """Two conventions at once: w first, and of the inverse rotations."""
    del rng
    x, y, z, w = r.trajectory.quats_xyzw.T
    return with_poses(r, quats_xyzw=np.stack([w, -x, -y, -z], axis=1))


def _positions_in_body(r: Recording, rng: Rng) -> Recording:
    """Positions seen from the turned body: R^T t."""
    del rng
    p = r.trajectory
    turned = Rotation.from_quat(p.quats_xyzw).inv().apply(p.positions_m)
    return with_poses(r, positions_m=turned)


def _two_negated(r: Recording, rng: Rng) -> Recording:
    signs = np.where(np.arange(3) == rng.integers(3), 1.0, -1.0)
    return with_poses(r, positions_m=r.trajectory.positions_m * signs)


def _pitch_negated(r: Recording, rng: Rng) -> Recording:
    del rng
    angles = Rotation.from_quat(r.trajectory.quats_xyzw).as_euler("YXZ") * (1, -1, 1)
    return turned_by(r, Rotation.from_euler("YXZ", angles))


def _world_moves(by: Callable[[Trajectory, Rng], Rotation]) -> Planter:
    """The tracker's world turns about its origin: positions and rotations go with it."""

    def change(p: Trajectory, rng: Rng) -> Trajectory:
        T = se3.from_rotation(by(p, rng), np.zeros((len(p), 3)))
        return Trajectory.from_matrices(p.t_us, T @ p.at(p.t_us))

    return _posed(change)


def _loop_closed(p: Trajectory, rng: Rng) -> Rotation:
    """Corrected by 3 to 6 deg at once, in the middle."""
    later = np.arange(len(p))[:, None] > len(p) // 2
    return Rotation.from_rotvec(later * _axis(rng) * np.radians(rng.uniform(3, 6)))


def _world_drifts(p: Trajectory, rng: Rng) -> Rotation:
    """At 6 to 12 deg/s."""
    return Rotation.from_rotvec(_since_s(p) * _axis(rng) * np.radians(rng.uniform(6, 12)))


def _filtered(p: Trajectory, rng: Rng) -> Trajectory:
    """A causal low pass of 40 to 80 ms."""
    share = 1 - np.exp(-float(np.median(np.diff(p.t_us))) / rng.uniform(40e3, 80e3))
    first = Rotation.from_quat(p.quats_xyzw[0])
    values = np.hstack(
        [p.positions_m, (first.inv() * Rotation.from_quat(p.quats_xyzw)).as_rotvec()]
    )
    for k in range(1, len(values)):
        values[k] = values[k - 1] + share * (values[k] - values[k - 1])
    turns = first * Rotation.from_rotvec(values[:, 3:])
    return Trajectory(p.t_us, values[:, :3], turns.as_quat())


def _predicted(p: Trajectory, rng: Rng) -> Trajectory:
    """Extrapolated by 40 to 70 ms from the motion just before, as a headset does."""
    ahead_s = rng.uniform(0.04, 0.07)
    back = max(1, round(0.03 / float(np.median(np.diff(p.t_us)) / 1e6)))
    before = np.maximum(np.arange(len(p)) - back, 0)
    dt_s = np.maximum((p.t_us - p.t_us[before]) / 1e6, 1e-6)[:, None]
    turns = Rotation.from_quat(p.quats_xyzw)
    rate = (turns[before].inv() * turns).as_rotvec() / dt_s
    speed = (p.positions_m - p.positions_m[before]) / dt_s
    turned = turns * Rotation.from_rotvec(rate * ahead_s)
    return Trajectory(p.t_us, p.positions_m + speed * ahead_s, turned.as_quat())


def _pairs_exchanged(p: Trajectory, rng: Rng) -> Trajectory:
    """Neighbours in blocks of 20 to 40 ms exchanged: packets that overtook each other."""
    block = max(1, round(rng.uniform(20e3, 40e3) / float(np.median(np.diff(p.t_us)))))
    at = np.arange(len(p))
    at = np.minimum(at + np.where(at // block % 2 == 0, block, -block), len(p) - 1)
    return Trajectory(p.t_us, p.positions_m[at], p.quats_xyzw[at])


def _of_the_middle(r: Recording, rng: Rng) -> Recording:
    """Poses of a point 20 to 30 cm behind the camera's, turned with it, taken for the camera's."""
    back = np.eye(4)
    back[2, 3] = -rng.uniform(0.2, 0.3)
    return AlteredRecording(r, trajectory=r.trajectory.times(back))


def _lever_arm_negated(r: Recording, rng: Rng) -> Recording:
    """A tracked body 15 to 25 cm away, on the other side of the cameras."""
    T_tracked_body = hand_eye(rng)
    T_tracked_body[:3, 3] = rng.uniform(0.15, 0.25) * _axis(rng)
    right = tracked(r, T_tracked_body)
    T_0 = right.rig.T_body_cam[0]
    other_side = np.eye(4)
    other_side[:3, 3] = -2 * T_0[:3, 3]
    T = tuple(other_side @ one for one in right.rig.T_body_cam)
    return AlteredRecording(right, rig=replace(right.rig, T_body_cam=T))


def _turns_too_fast(r: Recording, rng: Rng) -> Recording:
    """Turns about the vertical axis alone overstated by 25 to 50 %."""
    turns = Rotation.from_quat(r.trajectory.quats_xyzw)
    since = (turns[0].inv() * turns).as_rotvec()
    return since_start(r, since * (1, rng.uniform(1.25, 1.5), 1))


def _squeezed(e: Events, sensor: Camera, rng: Rng) -> Events:
    """Rows read in pairs: the image is half as high."""
    del sensor, rng
    return replace(e, y=e.y // 2)


def _bit_flipped(e: Events, sensor: Camera, rng: Rng) -> Events:
    """The bit of 16 columns is read the other way round."""
    del rng
    x = e.x ^ 16
    return replace(e, x=np.minimum(x, sensor.width_px - 1).astype(np.uint16))


def _jittered(e: Events, sensor: Camera, rng: Rng) -> Events:
    """Time stamps off by up to 15 ms, event by event."""
    del sensor
    off_us = rng.uniform(-15e3, 15e3, len(e)).astype(np.int64)
    return replace(e, t_us=np.maximum(e.t_us + off_us, 0))


def _half_dead(e: Events, sensor: Camera, rng: Rng) -> Events:
    del rng
    return e.take(e.x < sensor.width_px // 2)


def _noisy(e: Events, sensor: Camera, rng: Rng) -> Events:
    """Six of ten events are noise, anywhere on the sensor."""
    lost = rng.uniform(size=len(e)) < 0.6
    x = np.where(lost, rng.integers(0, sensor.width_px, len(e)), e.x)
    y = np.where(lost, rng.integers(0, sensor.height_px, len(e)), e.y)
    return replace(e, x=x.astype(np.uint16), y=y.astype(np.uint16))


def _columns_mirrored(e: Events, sensor: Camera, rng: Rng) -> Events:
    del rng
    return replace(e, x=(sensor.width_px - 1 - e.x).astype(np.uint16))


def _upside_down(e: Events, sensor: Camera, rng: Rng) -> Events:
    e = _columns_mirrored(e, sensor, rng)
    return replace(e, y=(sensor.height_px - 1 - e.y).astype(np.uint16))


def _in_packets(e: Events, sensor: Camera, rng: Rng) -> Events:
    """Stamped at the end of packets of 20 to 35 ms."""
    del sensor
    step_us = int(rng.integers(20_000, 35_000))
    return replace(e, t_us=(e.t_us // step_us + 1) * step_us)


def _rows_late(e: Events, sensor: Camera, rng: Rng) -> Events:
    """The lower half of the sensor is stamped 20 to 40 ms late."""
    by_us = round(rng.uniform(20e3, 40e3))
    return replace(e, t_us=e.t_us + by_us * (e.y >= sensor.height_px // 2))


def _bent(bend: Bend) -> EditOne:
    """Images of a lens that is calibrated as a pinhole's: `bend` maps squared radii to factors."""

    def edit(e: Events, sensor: Camera, rng: Rng) -> Events:
        x, y = (e.x - sensor.cx_px) / sensor.fx_px, (e.y - sensor.cy_px) / sensor.fy_px
        by = bend(x * x + y * y, rng)
        x_px = np.rint(x * by * sensor.fx_px + sensor.cx_px)
        y_px = np.rint(y * by * sensor.fy_px + sensor.cy_px)
        inside = (x_px >= 0) & (y_px >= 0) & (x_px < sensor.width_px) & (y_px < sensor.height_px)
        e = e.take(inside)
        return replace(e, x=x_px[inside].astype(np.uint16), y=y_px[inside].astype(np.uint16))

    return edit


def _pincushion(r_squared: Floats, rng: Rng) -> Floats:
    return np.asarray(1 + rng.uniform(0.2, 0.4) * r_squared)


def _strong_barrel(r_squared: Floats, rng: Rng) -> Floats:
    return np.asarray(1 - rng.uniform(0.25, 0.35) * r_squared + 0.05 * r_squared**2)


def _fisheye(r_squared: Floats, rng: Rng) -> Floats:
    del rng
    radius = np.sqrt(np.maximum(r_squared, 1e-12))
    return np.asarray(np.arctan(radius) / radius)


class _Mixed(EditedRecording):
    """Every other event of each camera is one of the other camera, of the same instant."""

    def __init__(self, recording: Recording) -> None:
        super().__init__(recording, lambda camera, e: e)

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        halves = [
            one.take(np.arange(k, len(one), 2))
            for k, one in enumerate(self.recording.events(c, t0_us, t1_us) for c in (0, 1))
        ]
        columns = (np.concatenate([getattr(one, name) for one in halves])
                   for name in ("x", "y", "t_us", "p"))  # fmt: skip
        mixed = Events(*columns)
        sensor = self.rig.cameras[camera]
        mixed = mixed.take((mixed.x < sensor.width_px) & (mixed.y < sensor.height_px))
        return mixed.take(np.argsort(mixed.t_us, kind="stable"))


def _first_twice(r: Recording, rng: Rng) -> Recording:
    """The first camera's file given for both."""
    del rng
    return AlteredRecording(r, streams=(0, 0, *range(2, len(r.rig))))


def _second_fx(r: Recording, rng: Rng) -> Recording:
    times = float(rng.choice([rng.uniform(0.75, 0.85), rng.uniform(1.18, 1.3)]))
    return lenses(r, (1,), fx_px=lambda f: f * times)


def _second_placed(axis: int) -> Planter:
    """The second camera stands 4 to 8 cm off along an axis across the baseline."""

    def plant(r: Recording, rng: Rng) -> Recording:
        off_m = rng.uniform(0.04, 0.08) * rng.choice([-1, 1]) * np.eye(4)[axis]
        return second_moved(r, lambda T: T + np.outer(off_m, np.eye(4)[3]))

    return plant


def _both_rolled(r: Recording, rng: Rng) -> Recording:
    """All sensors turned in their mounts by 8 to 15 deg: a turn on the body."""
    angle = rng.uniform(8, 15) * rng.choice([-1, 1])
    turn = se3.from_rotation(Rotation.from_euler("z", angle, degrees=True), np.zeros(3))
    return AlteredRecording(r, trajectory=r.trajectory.times(turn))


def _first_turned(r: Recording, rng: Rng) -> Recording:
    """The first camera alone is turned on the rig by 2 to 4 deg about some axis."""
    turn = Rotation.from_rotvec(_axis(rng) * np.radians(rng.uniform(2, 4)))
    T_0 = r.rig.T_body_cam[0] @ se3.from_rotation(turn, np.zeros(3))
    return AlteredRecording(r, rig=replace(r.rig, T_body_cam=(T_0, *r.rig.T_body_cam[1:])))


def _slightly_late_and_long(r: Recording, rng: Rng) -> Recording:
    """Three amounts, each small: poses 30 ms late, baseline 15 % too long, lens 8 % too long."""
    late = with_poses(r, t_us=r.trajectory.t_us + 30_000 * int(rng.choice([-1, 1])))

    def longer(T: Matrix) -> Matrix:
        T = T.copy()
        T[:3, 3] *= 1.15
        return T

    every = tuple(range(len(r.rig)))
    return lenses(
        second_moved(late, longer), every, fx_px=lambda f: 1.08 * f, fy_px=lambda f: 1.08 * f
    )  # fmt: skip


def _unknown(kind: str, plant: Planter, *also: str) -> Fault:
    return Fault(kind, plant, (*UNKNOWN, *also))


def _two(first: str, second: str, *names: str) -> Fault:
    return pair(f"{first}, {second}", first, second, (names[0], names[1]))


UNSEEN = (
    _unknown("quaternions w first, of the inverse rotations", _w_first_inverse),
    _unknown("positions in the body's frame", _positions_in_body),
    _unknown("two axes of the positions negated", _two_negated),
    _unknown("pitch negated", _pitch_negated),
    _unknown("tracker's world turned at once", _world_moves(_loop_closed), "poses jump"),
    _unknown("tracker's world turns slowly", _world_moves(_world_drifts)),
    _unknown("poses through a causal filter", _posed(_filtered), "pose clock"),
    _unknown("poses extrapolated", _posed(_predicted), "pose clock"),
    _unknown("blocks of poses exchanged", _posed(_pairs_exchanged), "poses jump", "noisy poses"),
    _unknown("poses of a point behind the camera", _of_the_middle),
    _unknown("lever arm negated", _lever_arm_negated),
    _unknown("turns about one axis overstated", _turns_too_fast),
    _unknown("rows read in pairs", _events(_squeezed), "sensor not filled"),
    _unknown("second camera's rows read in pairs", _events(_squeezed, 1), "sensor not filled"),
    _unknown("a bit of the columns inverted", _events(_bit_flipped), "hot pixels"),
    _unknown("events' times scattered", _events(_jittered)),
    _unknown("half of the second sensor dead", _events(_half_dead, 1), "sensor not filled"),
    _unknown("more noise than signal", _events(_noisy)),
    _unknown("first camera's columns mirrored", _events(_columns_mirrored, 0)),
    _unknown("first camera upside down", _events(_upside_down, 0)),
    _unknown("second camera stamped in packets", _events(_in_packets, 1), "coarse time stamps"),
    _unknown("lower half of the sensors late", _events(_rows_late)),
    _unknown("pincushion distortion left out", _events(_bent(_pincushion)), "lens distortion"),
    _unknown("strong barrel distortion left out", _events(_bent(_strong_barrel)),
             "lens distortion"),
    _unknown("fisheye calibrated as a pinhole", _events(_bent(_fisheye)), "lens distortion"),
    _unknown("second camera's pincushion distortion left out", _events(_bent(_pincushion), 1)),
    _unknown("cameras' events mixed", lambda r, rng: _Mixed(r)),
    _unknown("one camera's events given for both", _first_twice),
    _unknown("second camera's fx off", _second_fx, "focal lengths unequal"),
    _unknown("second camera too far ahead", _second_placed(2)),
    _unknown("second camera too high", _second_placed(1)),
    _unknown("sensors turned in their mounts", _both_rolled, "hand-eye rotation about z"),
    _unknown("first camera turned on the rig", _first_turned),
    _unknown("poses late, baseline and lens too long", _slightly_late_and_long),
    _unknown("second camera late, another scale of the positions",
             both(_PLANTERS["camera late"],
                  lambda r, rng: with_poses(r, positions_m=1.5 * r.trajectory.positions_m))),
    _two("poses late", "stereo yaw", "pose clock", "stereo yaw"),
    _two("baseline off", "stereo roll", "baseline", "stereo roll"),
    _two("focal length off", "stereo pitch", "focal length", "stereo pitch"),
    _two("extrinsics inverted", "camera late", "extrinsics inverted", "camera clock"),
    _two("quaternions w first", "stereo pitch", "quaternions w first", "stereo pitch"),
    _two("NED axes", "poses late", "NED axes", "pose clock"),
    _two("baseline off", "focal length off", "baseline", "focal length"),
)  # fmt: skip
