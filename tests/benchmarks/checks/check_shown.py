"""Kinds of faults that were new when the last table but one was written; rules were tried on them.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import planting as pl
from check_cases import pair
from check_opened import scaled
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from planting import Fault, Planter, Rng, unknown, with_poses


def _quaternions(order: tuple[int, ...], signs: tuple[int, ...] = (1, 1, 1, 1)) -> Planter:
    """Components of the quaternions in another order, or with other signs."""

    def plant(r: Recording, rng: Rng) -> Recording:
        del rng
        return with_poses(r, quats_xyzw=r.trajectory.quats_xyzw[:, order] * signs)

    return plant


def _positions_inverted(r: Recording, rng: Rng) -> Recording:
    """Positions of the inverse poses beside the rotations of the poses."""
    del rng
    p = r.trajectory
    return with_poses(r, positions_m=se3.inverse(p.at(p.t_us))[:, :3, 3])


def _twice_the_angle(r: Recording, rng: Rng) -> Recording:
    """The whole angle where a quaternion has half of it."""
    del rng
    return pl.turned_by(r, Rotation.from_rotvec(2 * pl.turns_of(r).as_rotvec()))


def _no_turns(r: Recording, rng: Rng) -> Recording:
    """A tracker of positions alone."""
    del rng
    return pl.since_start(r, np.zeros((len(r.trajectory), 3)))


def _axis_lost(r: Recording, rng: Rng) -> Recording:
    """Positions in a plane: along the axis of the largest extent they do not change."""
    del rng
    positions_m = r.trajectory.positions_m.copy()
    axis = int(np.ptp(positions_m, axis=0).argmax())
    positions_m[:, axis] = positions_m[0, axis]
    return with_poses(r, positions_m=positions_m)


def _positions_drift(r: Recording, rng: Rng) -> Recording:
    """Inertial odometry that drifts by 10 to 20 cm/s."""
    drift_m = pl.since_us(r) / 1e6 * rng.uniform(0.1, 0.2) * pl.direction(rng)
    return with_poses(r, positions_m=r.trajectory.positions_m + drift_m)


def _positions_swing(r: Recording, rng: Rng) -> Recording:
    """A tracked body on a flexible mount, which swings by 1 to 2 cm at 5 to 8 Hz."""
    t_s = r.trajectory.t_us[:, None] / 1e6
    waves = np.sin(2 * np.pi * rng.uniform(5, 8, 3) * t_s + rng.uniform(0, 2 * np.pi, 3))
    return with_poses(r, positions_m=r.trajectory.positions_m + rng.uniform(0.01, 0.02) * waves)


def _slow_clock(r: Recording, rng: Rng) -> Recording:
    """Poses stamped by a clock that runs 10 to 20 % slow and is right in the middle."""
    t_us = r.trajectory.t_us
    middle_us = (t_us[0] + t_us[-1]) // 2
    slow_us = ((t_us - middle_us) * rng.uniform(0.8, 0.9)).astype(np.int64)
    return with_poses(r, t_us=middle_us + slow_us)


def _closed_up(r: Recording, rng: Rng) -> Recording:
    """Poses lost in bursts, half of them in all; the others are stamped evenly over the time."""
    p = r.trajectory
    bursts = 6
    lost = np.repeat(rng.permutation(2 * bursts) < bursts, -(-len(p) // (2 * bursts)))[: len(p)]
    at = np.flatnonzero(~lost)
    t_us = np.linspace(p.t_us[0], p.t_us[-1], len(at)).astype(np.int64)
    return with_poses(with_poses(r, at=at), t_us=t_us)


def _rare_and_filled_in(r: Recording, rng: Rng) -> Recording:
    """Poses of 5 to 7 Hz between which somebody interpolated."""
    p = r.trajectory
    step = round(1e6 / rng.uniform(5, 7) / pl.period_us(r))
    rare = with_poses(r, at=slice(None, None, step)).trajectory
    times_us = p.t_us[p.t_us <= rare.t_us[-1]]
    return AlteredRecording(r, trajectory=Trajectory.from_matrices(times_us, rare.at(times_us)))


def _halves_exchanged(r: Recording, rng: Rng) -> Recording:
    """Two files of poses joined in the wrong order."""
    del rng
    count = len(r.trajectory)
    return pl.repeated(r, np.roll(np.arange(count), count // 2))


def _late_us(rng: Rng, low_ms: float, high_ms: float) -> int:
    return round(1e3 * float(rng.uniform(low_ms, high_ms))) * pl.sign(rng)


def _first_late(r: Recording, rng: Rng) -> Recording:
    """The first camera's clock is off; the second one's fits the poses."""
    return AlteredRecording(r, clock_us=(_late_us(rng, 30, 80), *[0] * (len(r.rig) - 1)))


def _all_late(r: Recording, rng: Rng) -> Recording:
    return AlteredRecording(r, clock_us=(_late_us(rng, 40, 120),) * len(r.rig))


def _portrait(r: Recording, rng: Rng) -> Recording:
    """The second sensor's columns and rows exchanged; what does not fit is lost."""
    del rng

    def edit(e: Events, sensor: Camera) -> Events:
        e = e.take((e.x < sensor.height_px) & (e.y < sensor.width_px))
        return replace(e, x=e.y, y=e.x)

    return pl.edited(r, edit, 1)


def _second_shifted(r: Recording, rng: Rng) -> Recording:
    """The second camera reads a part of its sensor that begins 40 to 60 columns farther."""
    by = int(rng.integers(40, 60))

    def edit(e: Events, _sensor: Camera) -> Events:
        e = e.take(e.x >= by)
        return replace(e, x=(e.x - by).astype(np.uint16))

    return pl.edited(r, edit, 1)


def _second_jumps(r: Recording, rng: Rng) -> Recording:
    """The second camera's clock jumps by 30 to 60 ms in the middle."""
    by_us, middle_us = round(rng.uniform(30e3, 60e3)), sum(r.event_span_us(1)) // 2
    return pl.edited(r, lambda e, _: replace(e, t_us=e.t_us + by_us * (e.t_us > middle_us)), 1)


def _second_backwards(r: Recording, rng: Rng) -> Recording:
    """The second camera's events of another take: here, its own backwards in time."""
    del rng
    first_us, last_us = r.event_span_us(1)

    class Reversed(pl.EditedRecording):
        def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
            if camera != 1:
                return r.events(camera, t0_us, t1_us)
            e = r.events(1, first_us + last_us - t1_us + 1, first_us + last_us - t0_us + 1)
            return Events(e.x[::-1], e.y[::-1], first_us + last_us - e.t_us[::-1], e.p[::-1])

    return Reversed(r, lambda camera, e: e)


def _one_polarity_late(r: Recording, rng: Rng) -> Recording:
    """Negative events are stamped 20 to 40 ms late."""
    by_us = round(rng.uniform(20e3, 40e3))
    return pl.edited(r, lambda e, _: replace(e, t_us=e.t_us + by_us * (e.p <= 0)))


def _both_mirrored(r: Recording, rng: Rng) -> Recording:
    """Columns and rows of the events of all cameras mirrored: sensors mounted upside down."""
    del rng
    return pl.edited(r, pl.mirrored)


def _blocks(r: Recording, rng: Rng) -> Recording:
    """Pixels of events in whole blocks of 8 by 8, as a filter bins them."""
    del rng
    return pl.edited(r, lambda e, _: replace(e, x=e.x // 8 * 8, y=e.y // 8 * 8))


def _bent_events(r: Recording, rng: Rng) -> Recording:
    """Images of a lens with barrel distortion, calibrated as a pinhole."""
    k = float(rng.uniform(-0.25, -0.15))

    def edit(e: Events, c: Camera) -> Events:
        x, y = (e.x - c.cx_px) / c.fx_px, (e.y - c.cy_px) / c.fy_px
        by = 1 + k * (x * x + y * y)
        x_px = np.clip(np.rint(x * by * c.fx_px + c.cx_px), 0, c.width_px - 1)
        y_px = np.clip(np.rint(y * by * c.fy_px + c.cy_px), 0, c.height_px - 1)
        return replace(e, x=x_px.astype(np.uint16), y=y_px.astype(np.uint16))

    return pl.edited(r, edit)


def _tangential(r: Recording, rng: Rng) -> Recording:
    """Tangential distortion that the lenses do not have."""
    p = tuple(map(float, rng.uniform(0.03, 0.06, 2) * rng.choice([-1, 1], 2)))
    return pl.radtan(r, (0.0, 0.0, *p))


def _second_pincushion(r: Recording, rng: Rng) -> Recording:
    return pl.radtan(r, (float(rng.uniform(-0.3, -0.2)), 0.0, 0.0, 0.0), 1)


def _turned_about(axis: int, low_deg: float, high_deg: float) -> Planter:
    return lambda r, rng: pl.second_turned(
        r, np.eye(3)[axis] * (rng.uniform(low_deg, high_deg) * pl.sign(rng))
    )


def _three_angles(r: Recording, rng: Rng) -> Recording:
    """Yaw, pitch and roll of the second camera, each off by 1.5 to 3 deg."""
    return pl.second_turned(r, rng.uniform(1.5, 3, 3) * rng.choice([-1, 1], 3))


def _baseline_ahead(r: Recording, rng: Rng) -> Recording:
    """x and z of the translation between the cameras exchanged."""
    del rng
    return pl.second_moved(r, pl.with_translation(lambda t: t[[2, 1, 0]]))


def _hand_eyes_exchanged(r: Recording, rng: Rng) -> Recording:
    """Each camera stands where the other does."""
    del rng
    return pl.placed(r, *r.rig.T_body_cam[1::-1])


def _lenses_exchanged_and_stretched(r: Recording, rng: Rng) -> Recording:
    """One camera's focal length 10 to 15 % too long, the other's too short by as much."""
    by = float(rng.uniform(1.1, 1.15))
    longer = pl.focal(r, by, 0)
    return pl.lenses(longer, 1, fx_px=lambda f: f / by, fy_px=lambda f: f / by)


_ANGLES = ("stereo yaw", "stereo pitch", "stereo roll")
SHOWN = (
    unknown("y and z of the quaternions exchanged", _quaternions((0, 2, 1, 3))),
    unknown("x of the quaternions negated", _quaternions((0, 1, 2, 3), (-1, 1, 1, 1))),
    unknown("quaternions in the order wzyx", _quaternions((3, 2, 1, 0))),
    unknown("positions inverted, rotations not", _positions_inverted),
    unknown("whole angles in the quaternions", _twice_the_angle),
    unknown("no turns in the poses", _no_turns, "poses frozen", "camera at rest"),
    unknown("one axis of the positions lost", _axis_lost, "poses frozen", "camera at rest"),
    unknown("positions drift", _positions_drift),
    unknown("positions swing", _positions_swing),
    unknown("clock of the poses slow", _slow_clock),
    unknown("poses lost, the others stamped evenly", _closed_up, "poses jump",
            "noisy poses"),
    unknown("poses interpolated from 5 to 7 Hz", _rare_and_filled_in),
    unknown("halves of the poses exchanged", _halves_exchanged, "poses jump"),
    unknown("positions 25 to 40 % too short", scaled(0.6, 0.75), "baseline"),
    unknown("first camera late", _first_late, *pl.two("camera clock", "pose clock")),
    Fault("all cameras late", _all_late, ("pose clock",)),
    unknown("second camera's columns and rows exchanged", _portrait, "sensor not filled"),
    unknown("second camera's part of the sensor shifted", _second_shifted, "stereo yaw"),
    unknown("second camera's clock jumps", _second_jumps, "gaps in the events"),
    unknown("second camera's events of another take", _second_backwards),
    unknown("one polarity late", _one_polarity_late),
    unknown("columns and rows of all mirrored", _both_mirrored,
            *pl.two("camera upside down", "cameras swapped"),
            *pl.two("camera upside down", "extrinsics inverted")),
    unknown("events in blocks of 8 px", _blocks, "sensor not filled"),
    unknown("barrel distortion missing from the calibration", _bent_events),
    unknown("tangential distortion that is not there", _tangential, "distortion folds"),
    unknown("second camera's barrel distortion not there", _second_pincushion,
            "distortion folds"),
    unknown("stereo yaw of 10 to 15 deg", _turned_about(1, 10, 15), "stereo yaw"),
    unknown("stereo roll of 15 to 30 deg", _turned_about(2, 15, 30), "stereo roll"),
    unknown("yaw, pitch and roll of the second camera", _three_angles,
            *(name for a in _ANGLES for b in _ANGLES if a != b for name in pl.two(a, b))),
    unknown("x and z of the baseline exchanged", _baseline_ahead),
    unknown("cameras' places exchanged", _hand_eyes_exchanged, "extrinsics inverted",
            "cameras swapped"),
    unknown("focal lengths unlike", _lenses_exchanged_and_stretched),
    pair("poses late", "stereo pitch"),
    pair("cameras swapped", "stereo roll"),
    pair("ROS axes", "camera late"),
    pair("rotations inverted", "focal length off"),
    pair("left-handed poses", "poses late"),
    pair("quaternions w first", "baseline off"),
    pair("baseline off", "camera late"),
    pair("focal length off", "stereo yaw"),
)  # fmt: skip
