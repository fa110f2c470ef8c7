"""What can be refined: each parameter, and how a vector of them alters a recording.

Values are corrections: what is to be added to the calibration that was given. All of them act in
the frames of the cameras, so that a body's frame, which is a convention, does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory

Floats = NDArray[np.float64]
Kind = Literal[
    "stereo", "clock", "direction", "baseline", "focal", "pose clock", "hand-eye", "lever"
]
AXES = ("x", "y", "z")
_TURNS = {"x": "pitch", "y": "yaw", "z": "roll"}


@dataclass(frozen=True)
class Parameter:
    """One number of a calibration.

    Attributes:
        kind: what it belongs to.
        camera: which camera it is of; 0 for what all cameras share.
        axis: which axis of the camera, or empty.
        unit: of its values.
        reach: how far from the given calibration it is searched.
        needed: with a larger uncertainty the recording does not determine it.
    """

    kind: Kind
    camera: int
    axis: str
    unit: str
    reach: float
    needed: float

    @property
    def spread(self) -> float:
        """Prior error of the given calibration, 1 sigma; the search reaches 2."""
        return self.reach / 2

    @property
    def name(self) -> str:
        """What tables and messages call it."""
        turn = _TURNS.get(self.axis, "")
        names = {
            "stereo": f"cam{self.camera} {turn}",
            "clock": f"cam{self.camera} clock",
            "direction": f"cam{self.camera} {self.axis}",
            "baseline": f"cam{self.camera} baseline",
            "focal": "focal length",
            "pose clock": "pose clock",
            "hand-eye": f"hand-eye {turn}",
            "lever": f"lever {self.axis}",
        }
        return names[self.kind]


class _Refinable(NamedTuple):
    """What a name of `refine` stands for: parameters per axis, and per further camera."""

    meaning: str
    kind: Kind
    axes: tuple[str, ...]
    unit: str
    reach: float
    needed: float
    needs_pair: bool = False

    def parameters(self, cameras: int) -> list[Parameter]:
        numbers = range(1, cameras) if self.needs_pair else (0,)
        values = self.unit, self.reach, self.needed
        return [Parameter(self.kind, k, axis, *values) for k in numbers for axis in self.axes]


_REFINABLE = {
    "stereo": _Refinable(
        "rotation of each further camera to the first", "stereo", AXES, "deg", 1.0, 0.15, True
    ),
    "delay": _Refinable(
        "clock of each further camera; with one camera, the clock of the poses",
        "clock", ("",), "ms", 12.0, 4.0, True,
    ),
    "direction": _Refinable(
        "direction of the baseline", "direction", ("forward", "across"), "deg", 2.0, 1.0, True
    ),
    "baseline": _Refinable(
        "length of the baseline; the poses give the scale", "baseline", ("",), "%", 6.0, 2.0, True
    ),
    "focal": _Refinable("focal length of all cameras", "focal", ("",), "%", 6.0, 1.5),
    "pose-delay": _Refinable("clock of the poses", "pose clock", ("",), "ms", 40.0, 2.5),
    "hand-eye": _Refinable(
        "rotation of the first camera on the tracked body", "hand-eye", AXES, "deg", 4.0, 0.5
    ),
    "lever": _Refinable(
        "position of the first camera on the tracked body", "lever", AXES, "mm", 40.0, 8.0
    ),
}  # fmt: skip
NAMES: Mapping[str, str] = {name: row.meaning for name, row in _REFINABLE.items()}
"""What `refine` takes, and what each means."""
_ORDER = [row.kind for row in _REFINABLE.values()]
(POSE_CLOCK,) = _REFINABLE["pose-delay"].parameters(1)
"""What is added to the times of the poses."""


def parameters_of(names: Sequence[str], cameras: int) -> tuple[Parameter, ...]:
    """The parameters that names such as `stereo` or `delay`, keys of `NAMES`, stand for.

    Raises:
        InputError: no name, an unknown one, or one that needs a second camera where there is none.
    """
    if not names:
        raise InputError(f"refine is empty: choose from {', '.join(NAMES)}")
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        raise InputError(f"refine {unknown[0]!r} is unknown: choose from {', '.join(NAMES)}")
    chosen = dict.fromkeys(parameter for name in names for parameter in _named(name, cameras))
    return tuple(sorted(chosen, key=lambda p: (_ORDER.index(p.kind), p.camera)))


def _named(name: str, cameras: int) -> list[Parameter]:
    if name == "delay" and cameras == 1:
        return [POSE_CLOCK]
    if _REFINABLE[name].needs_pair and cameras < 2:
        raise InputError(f"refine {name!r} needs a rig of 2 cameras, this has 1: leave it out")
    return _REFINABLE[name].parameters(cameras)


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
        later_us = round(1e3 * self._value("pose clock"))
        if not later_us:
            return trajectory
        return replace(trajectory, t_us=trajectory.t_us + later_us)

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
