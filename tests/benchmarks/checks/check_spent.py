"""Kinds of faults that were new when an earlier table was written, the last ones before today's.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from check_cases import EditedRecording, Fault, Matrix, Planter, Rng, turned_by, two, with_poses
from check_opened import UNKNOWN, pair
from check_tried import lenses, rotvec, since_start
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3


def _scaled(low: float, high: float) -> Planter:
    """Positions of a tracker whose scale is wrong."""

    def plant(r: Recording, rng: Rng) -> Recording:
        times = rng.uniform(low, high)
        return with_poses(r, positions_m=r.trajectory.positions_m * times)

    return plant


def _no_roll(r: Recording, rng: Rng) -> Recording:
    """A gimbal that reports no roll."""
    del rng
    return since_start(r, rotvec(r) * (1, 1, 0))


def _turns_off(r: Recording, rng: Rng) -> Recording:
    """A gyroscope whose scale is 10 to 20 % wrong."""
    return since_start(r, rotvec(r) * (1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.2)))


def _first_principal_point(r: Recording, rng: Rng) -> Recording:
    by = rng.uniform(12, 25, 2) * rng.choice([-1, 1], 2)
    return lenses(r, (0,), cx_px=lambda c: c + by[0], cy_px=lambda c: c + by[1])


def _first_focal(r: Recording, rng: Rng) -> Recording:
    times = float(rng.choice([rng.uniform(0.65, 0.8), rng.uniform(1.25, 1.5)]))
    return lenses(r, (0,), fx_px=lambda f: f * times, fy_px=lambda f: f * times)


def _cropped(r: Recording, rng: Rng) -> Recording:
    """The calibration is of the whole sensor, the events of a part of it."""
    by = rng.uniform(20, 40) * rng.choice([-1, 1])
    every = tuple(range(len(r.rig)))
    return lenses(r, every, cx_px=lambda c: c + by, cy_px=lambda c: c + by / 2)


def _pincushion(r: Recording, rng: Rng) -> Recording:
    k1 = float(rng.uniform(-0.25, -0.15))
    every = tuple(range(len(r.rig)))
    return lenses(
        r, every, model=lambda _: "radtan", distortion=lambda _: (k1, 0.0, 0.0, 0.0)
    )  # fmt: skip


def _held(r: Recording, rng: Rng) -> Recording:
    """A slow tracker whose last pose is repeated for 60 to 100 ms."""
    p = r.trajectory
    step = max(2, round(rng.uniform(60e3, 100e3) / float(np.median(np.diff(p.t_us)))))
    at = np.arange(len(p)) // step * step
    return with_poses(r, positions_m=p.positions_m[at], quats_xyzw=p.quats_xyzw[at])


def _smooth_positions(r: Recording, rng: Rng) -> Recording:
    """Positions alone that a filter smoothed over 0.3 to 0.4 s."""
    p = r.trajectory
    width = round(rng.uniform(300e3, 400e3) / float(np.median(np.diff(p.t_us))))
    return with_poses(r, positions_m=uniform_filter1d(p.positions_m, width, axis=0))


def _strays(r: Recording, rng: Rng) -> Recording:
    """Every twentieth pose lies 3 to 10 cm beside."""
    positions_m = r.trajectory.positions_m.copy()
    off_m = rng.normal(size=positions_m[::20].shape)
    off_m *= rng.uniform(0.03, 0.1) / np.linalg.norm(off_m, axis=1, keepdims=True)
    positions_m[::20] += off_m
    return with_poses(r, positions_m=positions_m)


def _noisy_turns(r: Recording, rng: Rng) -> Recording:
    noise = np.radians(rng.uniform(0.5, 1.0)) * rng.normal(size=(len(r.trajectory), 3))
    turns = Rotation.from_quat(r.trajectory.quats_xyzw) * Rotation.from_rotvec(noise)
    return turned_by(r, turns)


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
    T_0_1 = se3.inverse(r.rig.T_body_cam[0]) @ r.rig.T_body_cam[1]
    T_body_0 = r.rig.T_body_cam[0]
    return AlteredRecording(
        r, trajectory=r.trajectory.times(T_body_0 @ T_0_1 @ se3.inverse(T_body_0))
    )


def _poses_late(low_ms: float, high_ms: float) -> Planter:
    def plant(r: Recording, rng: Rng) -> Recording:
        late_us = round(1e3 * float(rng.uniform(low_ms, high_ms)) * rng.choice([-1, 1]))
        return with_poses(r, t_us=r.trajectory.t_us + late_us)

    return plant


def _camera_late(r: Recording, rng: Rng) -> Recording:
    late_us = round(float(rng.uniform(300e3, 380e3)) * rng.choice([-1, 1]))
    return AlteredRecording(r, clock_us=(0, late_us, *[0] * (len(r.rig) - 2)))


def _second_moved(r: Recording, to: Matrix) -> Recording:
    """The second camera stands at `T_0_1`."""
    T = (r.rig.T_body_cam[0], r.rig.T_body_cam[0] @ to, *r.rig.T_body_cam[2:])
    return AlteredRecording(r, rig=replace(r.rig, T_body_cam=T))


def _baseline_negated(r: Recording, rng: Rng) -> Recording:
    """The rotation of one direction beside the translation of the other."""
    del rng
    T_0_1 = se3.inverse(r.rig.T_body_cam[0]) @ r.rig.T_body_cam[1]
    T_0_1[:3, 3] *= -1
    return _second_moved(r, T_0_1)


def _baseline_upright(r: Recording, rng: Rng) -> Recording:
    """x and y of the translation exchanged."""
    del rng
    T_0_1 = se3.inverse(r.rig.T_body_cam[0]) @ r.rig.T_body_cam[1]
    T_0_1[:3, 3] = T_0_1[[1, 0, 2], 3]
    return _second_moved(r, T_0_1)


def _of_second(r: Recording, edit: Callable[[Events], Events]) -> Recording:
    """The second camera's events, edited."""
    return EditedRecording(r, lambda camera, e: edit(e) if camera == 1 else e)


def _second_rows_mirrored(r: Recording, rng: Rng) -> Recording:
    del rng
    last = r.rig.cameras[1].height_px - 1
    return _of_second(r, lambda e: replace(e, y=(last - e.y).astype(np.uint16)))


def _second_read_late(r: Recording, rng: Rng) -> Recording:
    """The second camera's columns are stamped as they are read, in 15 to 30 ms."""
    whole_us, width = rng.uniform(15e3, 30e3), r.rig.cameras[1].width_px

    def edit(e: Events) -> Events:
        t_us = e.t_us + (e.x * (whole_us / width)).astype(np.int64)
        in_order = np.argsort(t_us, kind="stable")
        return Events(e.x[in_order], e.y[in_order], t_us[in_order], e.p[in_order])

    return _of_second(r, edit)


def _second_clock_fast(r: Recording, rng: Rng) -> Recording:
    """The second camera's clock gains 30 to 60 ms in a second."""
    rate, first_us = rng.uniform(0.03, 0.06), r.event_span_us(1)[0]

    def edit(e: Events) -> Events:
        return replace(e, t_us=e.t_us + ((e.t_us - first_us) * rate).astype(np.int64))

    return _of_second(r, edit)


def _second_gaps(r: Recording, rng: Rng) -> Recording:
    """Every second tenth of a second of the second camera is lost."""
    del rng
    return _of_second(r, lambda e: e.take(e.t_us // 100_000 % 2 == 0))


def _unknown(kind: str, plant: Planter, *also: str) -> Fault:
    return Fault(kind, plant, (*UNKNOWN, *also))


_STEREO = ("stereo yaw", "stereo pitch", *two("stereo yaw", "stereo pitch"))
SPENT = (
    pair("rotations inverted, camera late", "rotations inverted", "camera late",
         ("rotations inverted", "camera clock")),
    pair("columns mirrored, stereo pitch", "columns mirrored", "stereo pitch",
         ("columns mirrored", "stereo pitch")),
    pair("NED axes, cameras swapped", "NED axes", "cameras swapped",
         ("NED axes", "cameras swapped")),
    pair("quaternions w first, camera late", "quaternions w first", "camera late",
         ("quaternions w first", "camera clock")),
    pair("OpenGL axes, baseline off", "OpenGL axes", "baseline off", ("OpenGL axes", "baseline")),
    pair("poses inverted, stereo roll", "poses inverted", "stereo roll",
         ("poses inverted", "stereo roll")),
    pair("hand-eye inverted, cameras swapped", "hand-eye inverted", "cameras swapped",
         ("hand-eye inverted", "cameras swapped")),
    pair("stereo pitch, stereo roll", "stereo pitch", "stereo roll",
         ("stereo pitch", "stereo roll")),
    pair("left-handed poses, stereo yaw", "left-handed poses", "stereo yaw",
         ("left-handed poses, axes right up ahead", "stereo yaw")),
    # Too long positions are too short a baseline: `check` says so in the cure of the baseline.
    _unknown("positions in feet", _scaled(1 / 0.3048, 1 / 0.3047), "impossible motion", "baseline"),
    _unknown("positions 40 to 80 % too long", _scaled(1.4, 1.8), "baseline"),
    _unknown("no roll in the poses", _no_roll),
    _unknown("turns off by 10 to 20 %", _turns_off),
    _unknown("first camera's principal point off", _first_principal_point, *_STEREO),
    _unknown("first camera's focal length off", _first_focal),
    _unknown("calibration of the sensor before a crop", _cropped, "principal point off"),
    _unknown("barrel distortion that is not there", _pincushion, "distortion folds"),
    _unknown("poses repeated for 60 to 100 ms", _held, "poses frozen", "poses too rare",
             "poses jump"),
    _unknown("positions smoothed, rotations not", _smooth_positions),
    _unknown("every twentieth pose astray", _strays, "poses jump", "noisy poses"),
    _unknown("noisy rotations", _noisy_turns, "noisy poses"),
    _unknown("clock of the poses jumps", _clock_jumps, "poses too rare"),
    Fault("w of the quaternions negated", _w_negated, ("rotations inverted",)),
    _unknown("poses of the second camera", _other_camera),
    _unknown("poses late by 300 to 400 ms", _poses_late(300, 400), "pose clock"),
    _unknown("camera late by 300 to 380 ms", _camera_late, "camera clock"),
    _unknown("direction of the baseline negated", _baseline_negated, "extrinsics inverted",
             "cameras swapped"),
    _unknown("x and y of the baseline exchanged", _baseline_upright),
    _unknown("second camera's rows mirrored", _second_rows_mirrored),
    _unknown("second camera's columns stamped as they are read", _second_read_late),
    _unknown("second camera's clock fast", _second_clock_fast),
    _unknown("second camera's events lost half of the time", _second_gaps, "gaps in the events"),
)  # fmt: skip
