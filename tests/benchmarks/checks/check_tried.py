"""Kinds of faults that were new when an earlier table was written, and on which rules were tried.

Where nothing that `check` tries mends a fault, the right answer is that no single cause was found.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import planting as pl
from check_cases import PLANTERS, pair
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.diagnose.check.alternatives import turns
from planting import Fault, Planter, Rng, unknown, with_poses

_OTHER_AXES = sorted(name for name in turns() if name.startswith("axes "))[7]


def _axes(name: str) -> Planter:
    """Poses of a body whose axes are called `name`."""
    return lambda r, rng: pl.posed_from(r, pl.turned(Rotation.from_matrix(turns()[name])))


def _yaw_only(r: Recording, rng: Rng) -> Recording:
    """A planar tracker: turns about one axis of the camera alone."""
    del rng
    return pl.since_start(r, pl.rotvec(r) * (0, 1, 0))


def _sign_of_a_turn(r: Recording, rng: Rng) -> Recording:
    """Turns about one axis with the other sign."""
    return pl.since_start(r, pl.rotvec(r) * np.where(np.arange(3) == rng.integers(3), -1, 1))


def _two_exchanged(rng: Rng) -> list[int]:
    """The three axes in order, but for two."""
    first, second = rng.permutation(3)[:2]
    return [{first: second, second: first}.get(axis, axis) for axis in range(3)]


def _turns_exchanged(r: Recording, rng: Rng) -> Recording:
    """Turns about two axes exchanged: a gyroscope that was wired wrongly."""
    return pl.since_start(r, pl.rotvec(r)[:, _two_exchanged(rng)])


def _scale_drifts(r: Recording, rng: Rng) -> Recording:
    """Monocular odometry: steps become up to 2 to 3 times as long from begin to end."""
    p = r.trajectory
    longer = np.linspace(1, rng.uniform(2, 3), len(p) - 1)[:, None]
    way = np.cumsum(np.diff(p.positions_m, axis=0) * longer, axis=0)
    return with_poses(r, positions_m=p.positions_m[0] + np.concatenate([np.zeros((1, 3)), way]))


def _axes_of_positions_exchanged(r: Recording, rng: Rng) -> Recording:
    return with_poses(r, positions_m=r.trajectory.positions_m[:, _two_exchanged(rng)])


def _lever_arm(r: Recording, rng: Rng) -> Recording:
    """Poses of a body 15 to 30 cm beside the camera, taken for those of the camera."""
    way = rng.normal(size=3)
    return pl.posed_from(r, pl.shifted(rng.uniform(0.15, 0.3) * way / np.linalg.norm(way)))


def _backwards(r: Recording, rng: Rng) -> Recording:
    del rng
    return pl.repeated(r, np.arange(len(r.trajectory))[::-1])


def _another_take(r: Recording, rng: Rng) -> Recording:
    """Poses of another motion: as far and as fast, and elsewhere."""
    t_s = pl.since_us(r) / 1e6
    waves = np.sin(rng.uniform(3, 7, (1, 6)) * t_s + rng.uniform(0, 2 * np.pi, 6))
    moved = pl.since_start(r, np.radians(4) * (waves[:, 3:] - waves[0, 3:]))
    return with_poses(moved, positions_m=r.trajectory.positions_m[0] + 0.12 * waves[:, :3])


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


def _principal_point(r: Recording, rng: Rng) -> Recording:
    by_px = rng.uniform(0.08, 0.14) * r.rig.cameras[0].width_px * pl.sign(rng)
    return pl.lenses(r, cx_px=lambda c: c + by_px)


def principal_point_off(*only: int) -> Planter:
    """By 12 to 25 px along either axis."""

    def plant(r: Recording, rng: Rng) -> Recording:
        by = rng.uniform(12, 25, 2) * rng.choice([-1, 1], 2)
        return pl.lenses(r, *only, cx_px=lambda c: c + by[0], cy_px=lambda c: c + by[1])

    return plant


def _fy(r: Recording, rng: Rng) -> Recording:
    times = pl.one_of(rng, (0.82, 0.9), (1.1, 1.2))
    return pl.lenses(r, fy_px=lambda f: f * times)


def _second_bent(r: Recording, rng: Rng) -> Recording:
    return pl.radtan(r, (float(rng.uniform(0.4, 0.8)), 0.0, 0.0, 0.0), 1)


def _rolling(r: Recording, rng: Rng) -> Recording:
    """Rows that are stamped as they are read, one after the other, in 20 to 40 ms."""
    whole_us = rng.uniform(20e3, 40e3)

    def edit(e: Events, sensor: Camera) -> Events:
        t_us = e.t_us + (e.y * (whole_us / sensor.height_px)).astype(np.int64)
        return Events(e.x, e.y, t_us, e.p)

    return pl.edited(r, edit)


def _knocked(r: Recording, rng: Rng) -> Recording:
    """The second camera is knocked in the middle: its image then lies 15 to 30 px beside."""
    by_px = int(rng.integers(15, 30)) * pl.sign(rng)
    middle_us = sum(r.event_span_us(1)) // 2

    def edit(e: Events, sensor: Camera) -> Events:
        x = e.x.astype(np.int64) + by_px * (e.t_us > middle_us)
        inside = (x >= 0) & (x < sensor.width_px)
        return Events(x[inside].astype(np.uint16), e.y[inside], e.t_us[inside], e.p[inside])

    return pl.edited(r, edit, 1)


def _far_late_camera(r: Recording, rng: Rng) -> Recording:
    return pl.second_late(r, round(float(rng.uniform(120e3, 250e3)) * pl.sign(rng)))


def _far_yaw(r: Recording, rng: Rng) -> Recording:
    T_0, T_1 = r.rig.T_body_cam[:2]
    angle = float(rng.uniform(5, 7.5) * pl.sign(rng))
    return pl.placed(r, T_0, T_1 @ pl.turned(Rotation.from_rotvec([0, angle, 0], degrees=True)))


def _inches(r: Recording, rng: Rng) -> Recording:
    del rng
    return with_poses(r, positions_m=r.trajectory.positions_m / 0.0254)


_THREE = ("pose clock", "stereo yaw", "camera clock")
TRIED = (
    pair("ROS axes", "cameras swapped"),
    pair("rotations inverted", "stereo yaw"),
    pair("stereo roll", "camera late"),
    pair("rows mirrored", "poses late"),
    pair("hand-eye applied twice", "stereo pitch"),
    pair("extrinsics inverted", "poses late"),
    pair("focal length off", "camera late"),
    Fault("an axis of the positions negated, stereo roll",
          pl.both(PLANTERS["an axis of the positions negated"], PLANTERS["stereo roll"]),
          tuple(name for axis in "xyz"
                for name in pl.two(f"{axis} of the positions negated", "stereo roll"))),
    Fault("poses late, stereo yaw, camera late",
          pl.both(pl.both(PLANTERS["poses late"], PLANTERS["stereo yaw"]), PLANTERS["camera late"]),
          tuple(f"{a} and {b}" for a in _THREE for b in _THREE if a != b)),
    Fault("camera upside down", _axes("camera upside down"), ("camera upside down",)),
    Fault(f"poses' {_OTHER_AXES}", _axes(_OTHER_AXES), (_OTHER_AXES,)),
    pl.misread("yzx", "zxy"),
    Fault("degrees read as radians, order xzy",
          pl.reread("XZY"[::-1], "XZY"[::-1], factor=180 / np.pi),
          ("impossible motion", *pl.UNKNOWN,
           *(f"Euler angles {order} in degrees read as radians" for order in pl.EULER))),
    Fault("camera late by 120 to 250 ms", _far_late_camera, ("camera clock",)),
    Fault("stereo yaw of 5 to 7.5 deg", _far_yaw, ("stereo yaw",)),
    unknown("positions in inches", _inches, "impossible motion"),
    unknown("scale of the positions drifts", _scale_drifts),
    unknown("two axes of the positions exchanged", _axes_of_positions_exchanged),
    # An image that is shifted is nearly that of a camera that is turned.
    unknown("second camera's principal point off", principal_point_off(1),
            "principal point off", "stereo yaw", "stereo pitch",
            *pl.two("stereo yaw", "stereo pitch")),
    unknown("principal point off by 8 to 14 %", _principal_point, "principal point off"),
    unknown("fy off by 10 to 20 %", _fy, "focal lengths unequal"),
    unknown("second camera's distortion that is not there", _second_bent),
    unknown("lever arm missing", _lever_arm),
    unknown("poses backwards in time", _backwards),
    unknown("poses of another take", _another_take),
    unknown("times of poses jitter", _jittering_times),
    unknown("positions in steps of centimetres", _rounded, "noisy poses", "poses jump",
            "poses frozen"),
    unknown("turns about one axis only", _yaw_only),
    unknown("turns about one axis negated", _sign_of_a_turn),
    unknown("turns about two axes exchanged", _turns_exchanged),
    unknown("rows stamped as they are read", _rolling),
    unknown("second camera knocked", _knocked),
)  # fmt: skip
