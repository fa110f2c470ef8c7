"""Kinds of faults that were new when the table before today's was written.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import planting as pl
from check_cases import PLANTERS, hand_eye, pair, tracked
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from planting import Fault, Matrix, Planter, Rng, unknown, with_poses

Floats = Matrix
Bend = Callable[[Floats, Rng], Floats]
EditOne = Callable[[Events, Camera, Rng], Events]


def _events(edit: EditOne, *only: int) -> Planter:
    """Events of some cameras edited, by the same random numbers whenever they are read."""

    def plant(r: Recording, rng: Rng) -> Recording:
        seed = int(rng.integers(2**31))
        return pl.edited(r, lambda e, c: edit(e, c, np.random.default_rng(seed)), *only)

    return plant


def _w_first_inverse(r: Recording, rng: Rng) -> Recording:
    """Two conventions at once: w first, and of the inverse rotations."""
    del rng
    x, y, z, w = r.trajectory.quats_xyzw.T
    return with_poses(r, quats_xyzw=np.stack([w, -x, -y, -z], axis=1))


def _positions_in_body(r: Recording, rng: Rng) -> Recording:
    """Positions seen from the turned body: R^T t."""
    del rng
    return with_poses(r, positions_m=pl.turns_of(r).inv().apply(r.trajectory.positions_m))


def _two_negated(r: Recording, rng: Rng) -> Recording:
    signs = np.where(np.arange(3) == rng.integers(3), 1.0, -1.0)
    return with_poses(r, positions_m=r.trajectory.positions_m * signs)


def _pitch_negated(r: Recording, rng: Rng) -> Recording:
    del rng
    angles = pl.turns_of(r).as_euler("YXZ") * (1, -1, 1)
    return pl.turned_by(r, Rotation.from_euler("YXZ", angles))


def _world_moves(by: Callable[[Recording, Rng], Rotation]) -> Planter:
    """The tracker's world turns about its origin: positions and rotations go with it."""

    def plant(r: Recording, rng: Rng) -> Recording:
        p = r.trajectory
        T = se3.from_rotation(by(r, rng), np.zeros((len(p), 3)))
        moved = Trajectory.from_matrices(p.t_us, T @ p.at(p.t_us))
        return AlteredRecording(r, trajectory=moved)

    return plant


def _loop_closed(r: Recording, rng: Rng) -> Rotation:
    """Corrected by 3 to 6 deg at once, in the middle."""
    count = len(r.trajectory)
    later = np.arange(count)[:, None] > count // 2
    return Rotation.from_rotvec(later * pl.direction(rng) * np.radians(rng.uniform(3, 6)))


def _world_drifts(r: Recording, rng: Rng) -> Rotation:
    """At 6 to 12 deg/s."""
    return Rotation.from_rotvec(
        pl.since_us(r) / 1e6 * pl.direction(rng) * np.radians(rng.uniform(6, 12))
    )


def _filtered(r: Recording, rng: Rng) -> Recording:
    """A causal low pass of 40 to 80 ms."""
    share = 1 - np.exp(-pl.period_us(r) / rng.uniform(40e3, 80e3))
    values = np.hstack([r.trajectory.positions_m, pl.rotvec(r)])
    for k in range(1, len(values)):
        values[k] = values[k - 1] + share * (values[k] - values[k - 1])
    return with_poses(pl.since_start(r, values[:, 3:]), positions_m=values[:, :3])


def _predicted(r: Recording, rng: Rng) -> Recording:
    """Extrapolated by 40 to 70 ms from the motion just before, as a headset does."""
    p, turns = r.trajectory, pl.turns_of(r)
    ahead_s = rng.uniform(0.04, 0.07)
    back = max(1, round(0.03 / (pl.period_us(r) / 1e6)))
    before = np.maximum(np.arange(len(p)) - back, 0)
    dt_s = np.maximum((p.t_us - p.t_us[before]) / 1e6, 1e-6)[:, None]
    rate = (turns[before].inv() * turns).as_rotvec() / dt_s
    speed = (p.positions_m - p.positions_m[before]) / dt_s
    moved = pl.turned_by(r, turns * Rotation.from_rotvec(rate * ahead_s))
    return with_poses(moved, positions_m=p.positions_m + speed * ahead_s)


def _pairs_exchanged(r: Recording, rng: Rng) -> Recording:
    """Neighbours in blocks of 20 to 40 ms exchanged: packets that overtook each other."""
    block, at = (
        max(1, round(rng.uniform(20e3, 40e3) / pl.period_us(r))),
        np.arange(len(r.trajectory)),
    )
    return pl.repeated(r, np.minimum(at + np.where(at // block % 2 == 0, block, -block), at[-1]))


def _of_the_middle(r: Recording, rng: Rng) -> Recording:
    """Poses of a point 20 to 30 cm behind the camera's, turned with it, taken for the camera's."""
    return pl.posed_from(r, pl.shifted(np.array([0, 0, -rng.uniform(0.2, 0.3)])))


def _lever_arm_negated(r: Recording, rng: Rng) -> Recording:
    """A tracked body 15 to 25 cm away, on the other side of the cameras."""
    T_tracked_body = hand_eye(rng)
    T_tracked_body[:3, 3] = rng.uniform(0.15, 0.25) * pl.direction(rng)
    right = tracked(r, T_tracked_body)
    other_side = pl.shifted(-2 * right.rig.T_body_cam[0][:3, 3])
    return pl.placed(right, *(other_side @ T for T in right.rig.T_body_cam))


def _turns_too_fast(r: Recording, rng: Rng) -> Recording:
    """Turns about the vertical axis alone overstated by 25 to 50 %."""
    return pl.since_start(r, pl.rotvec(r) * (1, rng.uniform(1.25, 1.5), 1))


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
    return pl.mirrored(e, sensor, rows=False)


def _upside_down(e: Events, sensor: Camera, rng: Rng) -> Events:
    del rng
    return pl.mirrored(e, sensor)


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


class _Mixed(pl.EditedRecording):
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
    times = pl.one_of(rng, (0.75, 0.85), (1.18, 1.3))
    return pl.lenses(r, 1, fx_px=lambda f: f * times)


def _second_placed(axis: int) -> Planter:
    """The second camera stands 4 to 8 cm off along an axis across the baseline."""

    def plant(r: Recording, rng: Rng) -> Recording:
        off_m = rng.uniform(0.04, 0.08) * pl.sign(rng) * np.eye(3)[axis]
        return pl.second_moved(r, pl.with_translation(lambda t: t + off_m))

    return plant


def _both_rolled(r: Recording, rng: Rng) -> Recording:
    """All sensors turned in their mounts by 8 to 15 deg: a turn on the body."""
    angle = rng.uniform(8, 15) * pl.sign(rng)
    return pl.posed_from(r, pl.turned(Rotation.from_euler("z", angle, degrees=True)))


def _first_turned(r: Recording, rng: Rng) -> Recording:
    """The first camera alone is turned on the rig by 2 to 4 deg about some axis."""
    turn = Rotation.from_rotvec(pl.direction(rng) * np.radians(rng.uniform(2, 4)))
    return pl.placed(r, r.rig.T_body_cam[0] @ pl.turned(turn))


def _slightly_late_and_long(r: Recording, rng: Rng) -> Recording:
    """Three amounts, each small: poses 30 ms late, baseline 15 % too long, lens 8 % too long."""
    late = with_poses(r, t_us=r.trajectory.t_us + 30_000 * pl.sign(rng))
    return pl.focal(pl.second_moved(late, pl.with_translation(lambda t: 1.15 * t)), 1.08)


LAST = (
    unknown("quaternions w first, of the inverse rotations", _w_first_inverse),
    unknown("positions in the body's frame", _positions_in_body),
    Fault("two axes of the positions negated", _two_negated,
          tuple(f"{axes} of the positions negated" for axes in ("x and y", "x and z", "y and z"))),
    unknown("pitch negated", _pitch_negated),
    unknown("tracker's world turned at once", _world_moves(_loop_closed), "poses jump"),
    unknown("tracker's world turns slowly", _world_moves(_world_drifts)),
    unknown("poses through a causal filter", _filtered, "pose clock"),
    unknown("poses extrapolated", _predicted, "pose clock"),
    unknown("blocks of poses exchanged", _pairs_exchanged, "poses jump", "noisy poses"),
    unknown("poses of a point behind the camera", _of_the_middle),
    unknown("lever arm negated", _lever_arm_negated),
    unknown("turns about one axis overstated", _turns_too_fast),
    unknown("rows read in pairs", _events(_squeezed), "sensor not filled"),
    unknown("second camera's rows read in pairs", _events(_squeezed, 1), "sensor not filled"),
    unknown("a bit of the columns inverted", _events(_bit_flipped), "hot pixels"),
    unknown("events' times scattered", _events(_jittered)),
    unknown("half of the second sensor dead", _events(_half_dead, 1), "sensor not filled"),
    unknown("more noise than signal", _events(_noisy)),
    unknown("first camera's columns mirrored", _events(_columns_mirrored, 0)),
    unknown("first camera upside down", _events(_upside_down, 0)),
    unknown("second camera stamped in packets", _events(_in_packets, 1), "coarse time stamps"),
    unknown("lower half of the sensors late", _events(_rows_late)),
    unknown("pincushion distortion left out", _events(_bent(_pincushion)), "lens distortion"),
    unknown("strong barrel distortion left out", _events(_bent(_strong_barrel)),
            "lens distortion"),
    unknown("fisheye calibrated as a pinhole", _events(_bent(_fisheye)), "lens distortion"),
    unknown("second camera's pincushion distortion left out", _events(_bent(_pincushion), 1)),
    unknown("cameras' events mixed", lambda r, rng: _Mixed(r)),
    unknown("one camera's events given for both", _first_twice),
    unknown("second camera's fx off", _second_fx, "focal lengths unequal"),
    unknown("second camera too far ahead", _second_placed(2)),
    unknown("second camera too high", _second_placed(1)),
    unknown("sensors turned in their mounts", _both_rolled, "hand-eye rotation about z"),
    unknown("first camera turned on the rig", _first_turned),
    unknown("poses late, baseline and lens too long", _slightly_late_and_long),
    unknown("second camera late, another scale of the positions",
            pl.both(PLANTERS["camera late"],
                 lambda r, rng: with_poses(r, positions_m=1.5 * r.trajectory.positions_m))),
    pair("poses late", "stereo yaw"),
    pair("baseline off", "stereo roll"),
    pair("focal length off", "stereo pitch"),
    pair("extrinsics inverted", "camera late"),
    pair("quaternions w first", "stereo pitch"),
    pair("NED axes", "poses late"),
    pair("baseline off", "focal length off"),
)  # fmt: skip
