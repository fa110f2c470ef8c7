"""Kinds of faults that were new when an earlier table was written, the last ones before today's.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

import planting as pl
from check_cases import pair
from check_tried import principal_point_off
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from planting import Fault, Planter, Rng, unknown, with_poses


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


def _very_late(r: Recording, rng: Rng) -> Recording:
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
SPENT = (
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
    unknown("poses late by 300 to 400 ms", _very_late, "pose clock"),
    unknown("camera late by 300 to 380 ms", _camera_late, "camera clock"),
    unknown("direction of the baseline negated", _baseline_negated, "extrinsics inverted",
            "cameras swapped"),
    unknown("x and y of the baseline exchanged", _baseline_upright),
    unknown("second camera's rows mirrored", _second_rows_mirrored),
    unknown("second camera's columns stamped as they are read", _second_read_late),
    unknown("second camera's clock fast", _second_clock_fast),
    unknown("second camera's events lost half of the time", _second_gaps, "gaps in the events"),
)  # fmt: skip
