"""Kinds of faults that were new when an earlier table was written, and on which rules were tried.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

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
from check_opened import UNKNOWN, pair
from eventsweep.emvs.check.alternatives import turns
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3

_PLANTERS: dict[str, Planter] = {fault.kind: fault.plant for fault in FAULTS}
_OTHER_AXES = sorted(name for name in turns() if name.startswith("axes "))[7]


def _axes(name: str) -> Planter:
    """Poses of a body whose axes are called `name`."""

    def plant(r: Recording, rng: Rng) -> Recording:
        del rng
        T_cam_given = se3.from_rotation(Rotation.from_matrix(turns()[name]), np.zeros(3))
        return AlteredRecording(r, trajectory=r.trajectory.times(T_cam_given))

    return plant


def since_start(r: Recording, rotvec: Matrix) -> Recording:
    """The first orientation, turned by (N, 3) rotation vectors about its own axes."""
    first = Rotation.from_quat(r.trajectory.quats_xyzw[0])
    return turned_by(r, first * Rotation.from_rotvec(rotvec))


def rotvec(r: Recording) -> Matrix:
    turns = Rotation.from_quat(r.trajectory.quats_xyzw)
    return np.asarray((turns[0].inv() * turns).as_rotvec())


def _yaw_only(r: Recording, rng: Rng) -> Recording:
    """A planar tracker: turns about one axis of the camera alone."""
    del rng
    return since_start(r, rotvec(r) * (0, 1, 0))


def _sign_of_a_turn(r: Recording, rng: Rng) -> Recording:
    """Turns about one axis with the other sign."""
    return since_start(r, rotvec(r) * np.where(np.arange(3) == rng.integers(3), -1, 1))


def _turns_exchanged(r: Recording, rng: Rng) -> Recording:
    """Turns about two axes exchanged: a gyroscope that was wired wrongly."""
    first, second = rng.permutation(3)[:2]
    order = np.arange(3)
    order[[first, second]] = second, first
    return since_start(r, rotvec(r)[:, order])


def _scale_drifts(r: Recording, rng: Rng) -> Recording:
    """Monocular odometry: steps become up to 2 to 3 times as long from begin to end."""
    p = r.trajectory
    longer = np.linspace(1, rng.uniform(2, 3), len(p) - 1)[:, None]
    way = np.cumsum(np.diff(p.positions_m, axis=0) * longer, axis=0)
    return with_poses(r, positions_m=p.positions_m[0] + np.concatenate([np.zeros((1, 3)), way]))


def _axes_of_positions_exchanged(r: Recording, rng: Rng) -> Recording:
    first, second = rng.permutation(3)[:2]
    order = np.arange(3)
    order[[first, second]] = second, first
    return with_poses(r, positions_m=r.trajectory.positions_m[:, order])


def _lever_arm(r: Recording, rng: Rng) -> Recording:
    """Poses of a body 15 to 30 cm beside the camera, taken for those of the camera."""
    way = rng.normal(size=3)
    T_cam_body = np.eye(4)
    T_cam_body[:3, 3] = rng.uniform(0.15, 0.3) * way / np.linalg.norm(way)
    return AlteredRecording(r, trajectory=r.trajectory.times(T_cam_body))


def _backwards(r: Recording, rng: Rng) -> Recording:
    del rng
    p = r.trajectory
    return with_poses(r, positions_m=p.positions_m[::-1], quats_xyzw=p.quats_xyzw[::-1])


def _another_take(r: Recording, rng: Rng) -> Recording:
    """Poses of another motion: as far and as fast, and elsewhere."""
    p = r.trajectory
    t_s = (p.t_us - p.t_us[0])[:, None] / 1e6
    waves = np.sin(rng.uniform(3, 7, (1, 6)) * t_s + rng.uniform(0, 2 * np.pi, 6))
    positions_m = p.positions_m[0] + 0.12 * waves[:, :3]
    turned = since_start(r, np.radians(4) * (waves[:, 3:] - waves[0, 3:]))
    return with_poses(turned, positions_m=positions_m)


def _jittering_times(r: Recording, rng: Rng) -> Recording:
    """Poses stamped by a computer that is busy: up to 40 ms early or late, changing slowly."""
    t_us = r.trajectory.t_us
    knots = np.linspace(t_us[0], t_us[-1], 12)
    off_us = np.interp(t_us, knots, rng.uniform(-40e3, 40e3, len(knots)))
    return with_poses(
        r, t_us=np.maximum.accumulate(t_us + off_us.astype(int)) + np.arange(len(t_us))
    )


def _rounded(r: Recording, rng: Rng) -> Recording:
    """Positions in whole steps of 2 to 4 cm."""
    step_m = rng.uniform(0.02, 0.04)
    return with_poses(r, positions_m=np.round(r.trajectory.positions_m / step_m) * step_m)


def lenses(r: Recording, which: tuple[int, ...], **fields: Callable[[Any], Any]) -> Recording:
    """Some cameras' calibration, with fields multiplied or added to."""
    cameras = tuple(
        replace(c, **{name: change(getattr(c, name)) for name, change in fields.items()})
        if k in which else c
        for k, c in enumerate(r.rig.cameras)
    )  # fmt: skip
    return AlteredRecording(r, rig=replace(r.rig, cameras=cameras))


def _principal_point(r: Recording, rng: Rng) -> Recording:
    by_px = rng.uniform(0.08, 0.14) * r.rig.cameras[0].width_px * rng.choice([-1, 1])
    return lenses(r, tuple(range(len(r.rig))), cx_px=lambda c: c + by_px)


def _second_principal_point(r: Recording, rng: Rng) -> Recording:
    by = rng.uniform(12, 25, 2) * rng.choice([-1, 1], 2)
    return lenses(r, (1,), cx_px=lambda c: c + by[0], cy_px=lambda c: c + by[1])


def _fy(r: Recording, rng: Rng) -> Recording:
    times = float(rng.choice([rng.uniform(0.82, 0.9), rng.uniform(1.1, 1.2)]))
    return lenses(r, tuple(range(len(r.rig))), fy_px=lambda f: f * times)


def _second_bent(r: Recording, rng: Rng) -> Recording:
    k1 = float(rng.uniform(0.4, 0.8))
    return lenses(r, (1,), model=lambda _: "radtan", distortion=lambda _: (k1, 0.0, 0.0, 0.0))


def _rolling(r: Recording, rng: Rng) -> Recording:
    """Rows that are stamped as they are read, one after the other, in 20 to 40 ms."""
    whole_us = rng.uniform(20e3, 40e3)

    def edit(camera: int, e: Events) -> Events:
        height = r.rig.cameras[camera].height_px
        t_us = e.t_us + (e.y * (whole_us / height)).astype(np.int64)
        in_order = np.argsort(t_us, kind="stable")
        return Events(e.x[in_order], e.y[in_order], t_us[in_order], e.p[in_order])

    return EditedRecording(r, edit)


def _knocked(r: Recording, rng: Rng) -> Recording:
    """The second camera is knocked in the middle: its image then lies 15 to 30 px beside."""
    by_px = int(rng.integers(15, 30)) * int(rng.choice([-1, 1]))
    first_us, last_us = r.event_span_us(1)
    width = r.rig.cameras[1].width_px

    def edit(camera: int, e: Events) -> Events:
        if camera != 1:
            return e
        x = e.x.astype(np.int64) + by_px * (e.t_us > (first_us + last_us) // 2)
        inside = (x >= 0) & (x < width)
        return Events(x[inside].astype(np.uint16), e.y[inside], e.t_us[inside], e.p[inside])

    return EditedRecording(r, edit)


def _far_late_camera(r: Recording, rng: Rng) -> Recording:
    late_us = round(float(rng.uniform(120e3, 250e3)) * rng.choice([-1, 1]))
    return AlteredRecording(r, clock_us=(0, late_us, *[0] * (len(r.rig) - 2)))


def _far_yaw(r: Recording, rng: Rng) -> Recording:
    angle, rig = float(rng.uniform(5, 7.5) * rng.choice([-1, 1])), r.rig
    turn = se3.from_rotation(Rotation.from_rotvec([0, angle, 0], degrees=True), np.zeros(3))
    T = (rig.T_body_cam[0], rig.T_body_cam[1] @ turn, *rig.T_body_cam[2:])
    return AlteredRecording(r, rig=replace(rig, T_body_cam=T))


def _inches(r: Recording, rng: Rng) -> Recording:
    del rng
    return with_poses(r, positions_m=r.trajectory.positions_m / 0.0254)


def _unknown(kind: str, plant: Planter, *also: str) -> Fault:
    return Fault(kind, plant, (*UNKNOWN, *also))


_THREE = ("pose clock", "stereo yaw", "camera clock")
TRIED = (
    pair("ROS axes, cameras swapped", "ROS axes", "cameras swapped",
         ("ROS axes", "cameras swapped")),
    pair("rotations inverted, stereo yaw", "rotations inverted", "stereo yaw",
         ("rotations inverted", "stereo yaw")),
    pair("stereo roll, camera late", "stereo roll", "camera late",
         ("stereo roll", "camera clock")),
    pair("rows mirrored, poses late", "rows mirrored", "poses late",
         ("rows mirrored", "pose clock")),
    pair("hand-eye applied twice, stereo pitch", "hand-eye applied twice", "stereo pitch",
         ("hand-eye beside poses of the camera", "stereo pitch")),
    pair("extrinsics inverted, poses late", "extrinsics inverted", "poses late",
         ("extrinsics inverted", "pose clock")),
    pair("focal length off, camera late", "focal length off", "camera late",
         ("focal length", "camera clock")),
    Fault("an axis of the positions negated, stereo roll",
          both(_PLANTERS["an axis of the positions negated"], _PLANTERS["stereo roll"]),
          tuple(name for axis in "xyz"
                for name in two(f"{axis} of the positions negated", "stereo roll"))),
    Fault("poses late, stereo yaw, camera late",
          both(both(_PLANTERS["poses late"], _PLANTERS["stereo yaw"]),
               _PLANTERS["camera late"]),
          tuple(f"{a} and {b}" for a in _THREE for b in _THREE if a != b)),
    Fault("camera upside down", _axes("camera upside down"), ("camera upside down",)),
    Fault(f"poses' {_OTHER_AXES}", _axes(_OTHER_AXES), (_OTHER_AXES,)),
    Fault("Euler angles yzx read as zxy", reread("YZX"[::-1], "ZXY"[::-1]),
          tuple(f"Euler angles {a} read as {b}" for a in EULER for b in EULER)),
    Fault("degrees read as radians, order xzy",
          reread("XZY"[::-1], "XZY"[::-1], factor=180 / np.pi),
          ("impossible motion", *UNKNOWN,
           *(f"Euler angles {order} in degrees read as radians" for order in EULER))),
    Fault("camera late by 120 to 250 ms", _far_late_camera, ("camera clock",)),
    Fault("stereo yaw of 5 to 7.5 deg", _far_yaw, ("stereo yaw",)),
    _unknown("positions in inches", _inches, "impossible motion"),
    _unknown("scale of the positions drifts", _scale_drifts),
    _unknown("two axes of the positions exchanged", _axes_of_positions_exchanged),
    # An image that is shifted is nearly that of a camera that is turned.
    _unknown("second camera's principal point off", _second_principal_point,
             "principal point off", "stereo yaw", "stereo pitch",
             *two("stereo yaw", "stereo pitch")),
    _unknown("principal point off by 8 to 14 %", _principal_point, "principal point off"),
    _unknown("fy off by 10 to 20 %", _fy, "focal lengths unequal"),
    _unknown("second camera's distortion that is not there", _second_bent),
    _unknown("lever arm missing", _lever_arm),
    _unknown("poses backwards in time", _backwards),
    _unknown("poses of another take", _another_take),
    _unknown("times of poses jitter", _jittering_times),
    _unknown("positions in steps of centimetres", _rounded, "noisy poses", "poses jump",
             "poses frozen"),
    _unknown("turns about one axis only", _yaw_only),
    _unknown("turns about one axis negated", _sign_of_a_turn),
    _unknown("turns about two axes exchanged", _turns_exchanged),
    _unknown("rows stamped as they are read", _rolling),
    _unknown("second camera knocked", _knocked),
)  # fmt: skip
