"""New kinds of faults, written down and committed before any of them was planted.

All rules of `check` were chosen with other kinds and other sequences. Where nothing that `check`
tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import planting as pl
from check_cases import hand_eye, on_body, pair, tracked
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry.camera import Camera
from planting import Planter, Rng, unknown

_ENU_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


def _rotations_in_ned(r: Recording, rng: Rng) -> Recording:
    """Positions with east, north and up as axes of the world, rotations with north, east, down."""
    del rng
    return pl.turned_by(r, Rotation.from_matrix(_ENU_NED) * pl.turns_of(r))


def _other_heading(r: Recording, rng: Rng) -> Recording:
    """Rotations whose heading counts from another direction, 15 to 60 deg beside: a compass."""
    away = Rotation.from_euler("z", rng.uniform(15, 60) * pl.sign(rng), degrees=True)
    return pl.turned_by(r, away * pl.turns_of(r))


def _rotvec_as_euler(r: Recording, rng: Rng) -> Recording:
    del rng
    return pl.turned_by(r, Rotation.from_euler("xyz", pl.turns_of(r).as_rotvec()))


def _hand_eye(change: Planter) -> Planter:
    """Poses of a tracked body, whose hand-eye transformation is changed."""
    return lambda r, rng: change(tracked(r, hand_eye(rng)), rng)


def _in_mm(r: Recording, rng: Rng) -> Recording:
    del rng
    return on_body(r, pl.with_translation(lambda t: 1000 * t))


def _only_rotation_inverted(r: Recording, rng: Rng) -> Recording:
    del rng

    def change(T: pl.Matrix) -> pl.Matrix:
        T = T.copy()
        T[:3, :3] = T[:3, :3].T
        return T

    return on_body(r, change)


def _second_from_body(r: Recording, rng: Rng) -> Recording:
    """Where the second camera is on the body, taken for where it is beside the first one."""
    del rng
    T_0, T_1 = r.rig.T_body_cam[:2]
    return pl.placed(r, T_0, T_0 @ T_1)


def _two_decimals(r: Recording, rng: Rng) -> Recording:
    """Quaternions written with two decimals."""
    del rng
    return pl.turned_by(r, Rotation.from_quat(np.round(r.trajectory.quats_xyzw, 2)))


def _signs_flip(r: Recording, rng: Rng) -> Recording:
    """Quaternions of 15 to 30 Hz with signs as they come, and each number filled in by itself."""
    p = r.trajectory
    knots = np.arange(0, len(p), max(1, round(1e6 / rng.uniform(15, 30) / pl.period_us(r))))
    rare = p.quats_xyzw[knots] * rng.choice([-1, 1], (len(knots), 1))
    filled = [np.interp(np.arange(len(p)), knots, column) for column in rare.T]
    return pl.turned_by(r, Rotation.from_quat(np.stack(filled, axis=1) + 1e-6))


def _markers_confused(r: Recording, rng: Rng) -> Recording:
    """In a quarter of all stretches of 40 ms the body appears turned by 60 to 120 deg."""
    count = len(r.trajectory)
    length = max(1, round(40e3 / pl.period_us(r)))
    stretches = -(-count // length)
    lost = np.repeat(rng.permutation(stretches) < max(1, stretches // 4), length)[:count]
    turn = pl.direction(rng) * np.radians(rng.uniform(60, 120))
    return pl.turned_by(r, pl.turns_of(r) * Rotation.from_rotvec(lost[:, None] * turn))


def _single_precision(r: Recording, rng: Rng) -> Recording:
    """Seconds since a start two days ago as numbers of 32 bits: steps of 15.6 ms."""
    since_s = rng.uniform(140e3, 250e3)

    def edit(e: Events, _sensor: Camera) -> Events:
        t_s = (e.t_us / 1e6 + since_s).astype(np.float32).astype(np.float64) - since_s
        return replace(e, t_us=np.maximum(np.rint(1e6 * t_s), 0).astype(np.int64))

    return pl.edited(r, edit)


def _stamped_by_the_host(r: Recording, rng: Rng) -> Recording:
    """Packets of as many events as 20 to 40 ms hold on average, stamped when they are full."""
    usual_us = rng.uniform(20e3, 40e3)

    def edit(e: Events, _sensor: Camera) -> Events:
        if len(e) < 2:
            return e
        size = max(1, round(usual_us * len(e) / max(1, int(e.t_us[-1] - e.t_us[0]))))
        last = np.minimum((np.arange(len(e)) // size + 1) * size, len(e)) - 1
        return replace(e, t_us=e.t_us[last])

    return pl.edited(r, edit)


def _highest_bit_lost(r: Recording, rng: Rng) -> Recording:
    """Columns that begin anew at the largest power of two on the sensor: a type too narrow."""
    del rng

    def edit(e: Events, sensor: Camera) -> Events:
        highest = 1 << ((sensor.width_px - 1).bit_length() - 1)
        return replace(e, x=e.x % np.uint16(highest))

    return pl.edited(r, edit)


def _zoomed(r: Recording, rng: Rng) -> Recording:
    """The lenses are turned to 1.15 to 1.3 times the focal length in the middle."""
    middle_us, times = sum(r.event_span_us(0)) // 2, rng.uniform(1.15, 1.3)

    def edit(e: Events, c: Camera) -> Events:
        by = np.where(e.t_us > middle_us, times, 1.0)
        x = np.rint((e.x - c.cx_px) * by + c.cx_px)
        y = np.rint((e.y - c.cy_px) * by + c.cy_px)
        inside = (x >= 0) & (y >= 0) & (x < c.width_px) & (y < c.height_px)
        x, y = x[inside].astype(np.uint16), y[inside].astype(np.uint16)
        return Events(x, y, e.t_us[inside], e.p[inside])

    return pl.edited(r, edit)


def _flicker(r: Recording, rng: Rng) -> Recording:
    """Half of the events or more are of six lamps that flicker at 100 Hz."""
    share, radius = rng.uniform(0.5, 0.7), rng.uniform(0.03, 0.06)
    places, seed = rng.uniform(0.1, 0.9, (6, 2)), int(rng.integers(2**31))

    def edit(e: Events, sensor: Camera) -> Events:
        random, size = np.random.default_rng(seed), (sensor.width_px, sensor.height_px)
        lamp = random.uniform(size=len(e)) < share
        spot = places[random.integers(0, len(places), len(e))] * size
        near = spot + random.uniform(-radius, radius, spot.shape) * size[0]
        x, y = np.clip(near, 0, np.array(size) - 1).astype(np.uint16).T
        at_us = e.t_us // 10_000 * 10_000 + random.integers(0, 1500, len(e))
        t_us = np.where(lamp, at_us, e.t_us)
        return Events(np.where(lamp, x, e.x), np.where(lamp, y, e.y), t_us, e.p)

    return pl.edited(r, edit)


def _second_stops(r: Recording, rng: Rng) -> Recording:
    """The second camera's events end after 35 to 50 % of the time."""
    first_us, last_us = r.event_span_us(1)
    end_us = first_us + round(rng.uniform(0.35, 0.5) * (last_us - first_us))
    return pl.edited(r, lambda e, _: e.take(e.t_us < end_us), 1)


_ODD_TURNS = ("poses jump", "noisy poses", "impossible motion")
UNSEEN = (
    unknown("positions in ENU, rotations in NED", _rotations_in_ned),
    # Of a camera that keeps level this is a turn on the body.
    unknown("heading of another zero", _other_heading, "hand-eye rotation about y"),
    unknown("rotation vectors read as Euler angles", _rotvec_as_euler),
    unknown("hand-eye translation in mm", _hand_eye(_in_mm)),
    # Mapping sees the rotation far better than some centimetres of lever arm.
    unknown("hand-eye rotation alone inverted", _hand_eye(_only_rotation_inverted),
            "hand-eye inverted"),
    unknown("second camera's place on the body taken for its extrinsics",
            _hand_eye(_second_from_body), "cameras look apart", "impossible baseline"),
    unknown("quaternions with two decimals", _two_decimals, *_ODD_TURNS, "poses frozen"),
    unknown("signs of the quaternions flip", _signs_flip, *_ODD_TURNS),
    unknown("markers confused now and then", _markers_confused, *_ODD_TURNS),
    unknown("events' times in single precision", _single_precision, "coarse time stamps"),
    unknown("events stamped by the host", _stamped_by_the_host, "coarse time stamps"),
    unknown("highest bit of the columns lost", _highest_bit_lost, "sensor not filled"),
    unknown("lenses zoomed in the middle", _zoomed),
    unknown("lamps flicker", _flicker, "hot pixels"),
    unknown("second camera stops", _second_stops, "gaps in the events"),
    pair("OpenGL axes", "cameras swapped"),
    pair("left-handed poses", "stereo pitch"),
    pair("rotations inverted", "poses late"),
    pair("columns mirrored", "baseline off"),
    pair("hand-eye applied twice", "camera late"),
)  # fmt: skip
