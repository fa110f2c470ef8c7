"""Numbers of a recording that may be off: its calibration, its clocks, where its cameras sit.

Each kind is a row of one table: `calibrate` refines near the given value, `check` looks far from
it. Values are corrections, what is to be added to the calibration that was given. All of them act
in the frames of the cameras, so that a body's frame, which is a convention, does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

Floats = NDArray[np.float64]
Kind = Literal[
    "stereo", "clock", "direction", "baseline", "focal", "pose clock", "hand-eye", "lever"
]
AXES = ("x", "y", "z")
TURNS = dict(zip(AXES, ("pitch", "yaw", "roll"), strict=True))


@dataclass(frozen=True)
class Parameter:
    """One number of a calibration.

    Attributes:
        kind: what it belongs to.
        camera: which camera it is of; 0 for what all cameras share.
        axis: which axis of the camera, or empty.
        name: what tables and messages call it.
        unit: of its values.
        reach: how far from the given calibration it is searched: two prior sigmas.
        needed: with a larger uncertainty the recording does not determine it.
    """

    kind: Kind
    camera: int
    axis: str
    name: str
    unit: str
    reach: float
    needed: float


class Search(NamedTuple):
    """How `check` looks for an amount that is far off.

    Attributes:
        name: of the amount; `{turn}` and `{axis}` are those of the camera's axis.
        unit: of the amounts; empty for factors.
        grid: amounts to try, that which changes nothing among them: 0, or 1 for a factor.
        change: corrects a recording by an amount, about the axis of a number.
        hurts: the error from which a map suffers (page `studies`), by axis; of factors, in
            logarithms.
        margin: the least gain that counts, in logarithms.
        cure: what to do, with the amount as `{amount}`.
    """

    name: str
    unit: str
    grid: tuple[float, ...]
    change: Callable[[int, Recording, float], Recording]
    hurts: tuple[float, ...]
    margin: float
    cure: str


class Row(NamedTuple):
    """A kind of numbers, one per axis, and per further camera if it is of a pair.

    Attributes:
        meaning: for a user.
        kind: what the numbers are of.
        axes: of the camera, or one that is empty.
        unit: of corrections.
        reach, needed: of each number, as `Parameter` says.
        of_pair: whether it concerns two cameras, and not camera 0 and its poses.
        name: of a number; `{turn}` is what the axis is called.
        search: how `check` looks for it; None where it does not.
    """

    meaning: str
    kind: Kind
    axes: tuple[str, ...]
    unit: str
    reach: float
    needed: float
    of_pair: bool
    name: str
    search: Search | None = None

    def parameters(self, cameras: int) -> list[Parameter]:
        """Of a rig of so many cameras."""
        return [
            Parameter(
                self.kind, camera, axis,
                self.name.format(camera=camera, turn=TURNS.get(axis, ""), axis=axis),
                self.unit, self.reach, self.needed,
            )
            for camera in (range(1, cameras) if self.of_pair else (0,)) for axis in self.axes
        ]  # fmt: skip


def _turn(axis: int, angle_deg: float) -> Floats:
    return se3.from_rotation(
        Rotation.from_rotvec(np.eye(3)[axis] * angle_deg, degrees=True), np.zeros(3)
    )


@lru_cache(maxsize=1)  # all windows have the same poses
def late_poses(poses: Trajectory, late_ms: float) -> Trajectory:
    """The poses on a later clock."""
    late_us = round(1e3 * late_ms)
    return replace(poses, t_us=poses.t_us + late_us) if late_us else poses


def with_lenses(recording: Recording, change: Callable[[Camera], Camera]) -> Recording:
    """The recording with each camera's calibration changed."""
    rig = recording.rig
    return AlteredRecording(recording, rig=replace(rig, cameras=tuple(map(change, rig.cameras))))


def with_second(recording: Recording, change: Callable[[Floats], Floats]) -> Recording:
    """The recording with the `T_cam0_cam1` of its two cameras changed."""
    T_0, T_1 = recording.rig.T_body_cam
    places = T_0, T_0 @ change(se3.inverse(T_0) @ T_1)
    return AlteredRecording(recording, rig=replace(recording.rig, T_body_cam=places))


def with_hand_eye(recording: Recording, change: Callable[[Floats], Floats]) -> Recording:
    """The recording with its first camera elsewhere on the body, and the others with it."""
    T_body_cam = recording.rig.T_body_cam
    inside = [se3.inverse(T_body_cam[0]) @ T for T in T_body_cam]
    first = change(T_body_cam[0])
    places = tuple(first @ T for T in inside)
    return AlteredRecording(recording, rig=replace(recording.rig, T_body_cam=places))


def with_baseline(recording: Recording, factor: float) -> Recording:
    """The recording with its two cameras so many times as far from each other."""
    scale = np.ones((4, 4))
    scale[:3, 3] = factor
    return with_second(recording, lambda T: T * scale)


def _both_ways(*amounts: float) -> tuple[float, ...]:
    return (*(-a for a in amounts), 0.0, *reversed(amounts))


_CLOCK_MS = _both_ways(320.0, 160.0, 80.0, 40.0, 20.0, 10.0)
ROWS = {
    "stereo": Row(
        "rotation of each further camera to the first", "stereo", AXES, "deg", 1.0, 0.15, True,
        "cam{camera} {turn}", Search(
            "stereo {turn}", "deg", _both_ways(8.0, 5.0, 3.0, 2.0, 1.0, 0.4),
            lambda axis, r, x: with_second(r, lambda T: T @ _turn(axis, x)),
            (0.15, 0.2, 0.3), 0.015,
            "turn the second camera by {amount:+.2f} deg about its {axis} axis, or calibrate the "
            "rig again",
        ),
    ),
    "delay": Row(
        "clock of each further camera; with one camera, the clock of the poses",
        "clock", ("",), "ms", 12.0, 4.0, True, "cam{camera} clock", Search(
            "camera clock", "ms", _CLOCK_MS,
            lambda _, r, x: AlteredRecording(r, clock_us=(0, round(1e3 * x))), (5.0,), 0.015,
            "shift the times of the second camera's events by {amount:+.1f} ms "
            "(events.time_offset_us)",
        ),
    ),
    "direction": Row(
        "direction of the baseline", "direction", ("forward", "across"), "deg", 2.0, 1.0, True,
        "cam{camera} {axis}",
    ),
    "baseline": Row(
        "length of the baseline; the poses give the scale", "baseline", ("",), "%", 6.0, 2.0, True,
        "cam{camera} baseline", Search(
            "baseline", "", (0.4, 0.55, 0.7, 0.85, 1.0, 1.18, 1.4, 1.8, 2.5),
            lambda _, r, x: with_baseline(r, x), (0.1,), 0.015,
            "multiply the distance between the cameras by {amount:.3g}, or divide the positions of "
            "the poses by it: their ratio is wrong",
        ),
    ),
    "focal": Row(
        "focal length of all cameras", "focal", ("",), "%", 6.0, 1.5, False, "focal length", Search(
            "focal length", "", (0.35, 0.5, 0.7, 0.85, 1.0, 1.18, 1.4, 2.0, 2.8),
            lambda _, r, x: with_lenses(r, lambda camera: camera.zoomed(x)), (0.1,), 0.06,
            "the focal lengths fit when multiplied by {amount:.3g}: use the calibration of this "
            "lens and resolution",
        ),
    ),
    "pose-delay": Row(
        "clock of the poses", "pose clock", ("",), "ms", 40.0, 2.5, False, "pose clock", Search(
            "pose clock", "ms", _CLOCK_MS,
            lambda _, r, x: AlteredRecording(r, trajectory=late_poses(r.trajectory, x)),
            (20.0,), 0.015,
            "shift the times of the poses by {amount:+.0f} ms (poses.time_offset_us)",
        ),
    ),
    "hand-eye": Row(
        "rotation of the first camera on the tracked body", "hand-eye", AXES, "deg", 4.0, 0.5,
        False, "hand-eye {turn}", Search(
            "hand-eye rotation about {axis}", "deg", _both_ways(40.0, 20.0, 10.0, 5.0, 2.5),
            lambda axis, r, x: with_hand_eye(r, lambda T: T @ _turn(axis, x)),
            (1.0, 1.0, 1.0), 0.04,
            "turn the cameras on the body by {amount:+.1f} deg about the camera's {axis} axis: the "
            "hand-eye transformation is missing or wrong",
        ),
    ),
    "lever": Row(
        "position of the first camera on the tracked body", "lever", AXES, "mm", 40.0, 8.0, False,
        "lever {axis}",
    ),
}  # fmt: skip
"""What may be off, by the names that `refine` takes."""
_ORDER = [row.kind for row in ROWS.values()]
(POSE_CLOCK,) = ROWS["pose-delay"].parameters(1)
"""What is added to the times of the poses."""


def parameters_of(names: Sequence[str], cameras: int) -> tuple[Parameter, ...]:
    """The parameters that names such as `stereo` or `delay`, keys of `ROWS`, stand for.

    Raises:
        InputError: no name, an unknown one, or one that needs a second camera where there is none.
    """
    if not names:
        raise InputError(f"refine is empty: choose from {', '.join(ROWS)}")
    unknown = [name for name in names if name not in ROWS]
    if unknown:
        raise InputError(f"refine {unknown[0]!r} is unknown: choose from {', '.join(ROWS)}")
    chosen: dict[Parameter, None] = {}
    for name in names:
        alone = "pose-delay" if name == "delay" and cameras == 1 else name
        if ROWS[alone].of_pair and cameras < 2:
            raise InputError(f"refine {name!r} needs a rig of 2 cameras, this has 1: leave it out")
        chosen |= dict.fromkeys(ROWS[alone].parameters(cameras))
    return tuple(sorted(chosen, key=lambda p: (_ORDER.index(p.kind), p.camera)))


@dataclass(frozen=True)
class Correction:
    """What to add to a calibration: parameter -> value in its unit, 0 where it is not there."""

    values: Mapping[Parameter, float] = field(default_factory=dict)

    @classmethod
    def of(cls, parameters: Sequence[Parameter], values: Sequence[float] | Floats) -> Correction:
        """From parameters and as many values."""
        return cls(dict(zip(parameters, map(float, values), strict=True)))

    def with_values(self, values: Mapping[Parameter, float]) -> Correction:
        """The same with some values in place of those before."""
        return Correction({**self.values, **values})

    def varied(self, values: Mapping[Parameter, float], cameras: int) -> Correction:
        """The same with some values changed, and the mean of all cameras' clocks kept.

        A sensor's lag is common to all cameras, and each camera alone is sharper with its clock set
        back by it. If one clock moved alone, the lag would look like one between cameras.
        """
        other = self.with_values(values)
        later_us = np.subtract(other.clock_us(cameras), self.clock_us(cameras)).mean()
        pose_ms = other._value("pose clock") + later_us / 1e3
        return other.with_values({POSE_CLOCK: pose_ms})

    def vector(self, parameters: Sequence[Parameter]) -> Floats:
        """The (P,) values of some parameters."""
        return np.array([self.values.get(parameter, 0.0) for parameter in parameters])

    def rig(self, rig: Rig) -> Rig:
        """The rig with its focal lengths, its cameras and the first one's place corrected."""
        scale = 1 + self._value("focal") / 100
        cameras = tuple(camera.zoomed(scale) for camera in rig.cameras)
        first = rig.T_body_cam[0] @ self.hand_eye()
        T_0_cam = [se3.inverse(rig.T_body_cam[0]) @ T for T in rig.T_body_cam]
        places = [first] + [first @ self._place(k, T_0_cam[k]) for k in range(1, len(rig))]
        return replace(rig, cameras=cameras, T_body_cam=tuple(places))

    def hand_eye(self) -> Floats:
        """(4, 4) where the first camera sits in what was taken for its frame."""
        turn = Rotation.from_rotvec(self._axes("hand-eye", 0), degrees=True)
        return se3.from_rotation(turn, self._axes("lever", 0) / 1e3)

    def trajectory(self, trajectory: Trajectory) -> Trajectory:
        """The poses on their corrected clock."""
        return late_poses(trajectory, self._value("pose clock"))

    def clock_us(self, cameras: int) -> tuple[int, ...]:
        """What is added to the time stamps of each camera's events, µs."""
        return tuple(round(1e3 * self._value("clock", camera)) for camera in range(cameras))

    def applied(self, recording: Recording) -> AlteredRecording:
        """The recording as corrected; its events are read as before."""
        return AlteredRecording(
            recording,
            rig=self.rig(recording.rig),
            trajectory=self.trajectory(recording.trajectory),
            clock_us=self.clock_us(len(recording.rig)),
        )

    def _value(self, kind: Kind, camera: int = 0, axis: str = "") -> float:
        key = kind, camera, axis
        return next((v for p, v in self.values.items() if (p.kind, p.camera, p.axis) == key), 0.0)

    def _axes(self, kind: Kind, camera: int) -> Floats:
        return np.array([self._value(kind, camera, axis) for axis in AXES])

    def _place(self, camera: int, T_0_cam: Floats) -> Floats:
        """Where a camera sits in the first one's frame."""
        turn = Rotation.from_rotvec(self._axes("stereo", camera), degrees=True)
        R = T_0_cam[:3, :3] @ turn.as_matrix()
        ways = [self._value("direction", camera, way) for way in ("forward", "across")]
        length = 1 + self._value("baseline", camera) / 100
        position_m = length * _turned_baseline(T_0_cam[:3, 3], np.radians(ways))
        return se3.from_rotation(Rotation.from_matrix(R), position_m)


def _turned_baseline(baseline_m: Floats, angles: Floats) -> Floats:
    """A baseline turned towards the optical axis and across it by two angles, as long as before."""
    length_m = float(np.linalg.norm(baseline_m))
    if not angles.any() or length_m == 0:
        return baseline_m
    along = baseline_m / length_m
    # Towards the optical axis, or, where the cameras sit one behind the other, downwards
    ahead = np.array([0.0, 0, 1]) if abs(along[2]) < 0.9 else np.array([0.0, 1, 0])
    forward = ahead - along * (ahead @ along)
    forward /= np.linalg.norm(forward)
    turned = along + np.tan(angles[0]) * forward + np.tan(angles[1]) * np.cross(along, forward)
    return np.asarray(length_m * turned / np.linalg.norm(turned))
