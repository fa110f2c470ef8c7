"""What faults are planted with: poses, lenses, extrinsics and events of a recording, changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory

Rng = np.random.Generator
Floats = NDArray[np.float64]
Planter = Callable[[Recording, Rng], Recording]
Change = Callable[[Floats], Floats]
UNKNOWN = ("no single cause found",)
EULER = tuple("".join(order) for order in permutations("xyz"))


@dataclass(frozen=True)
class Fault:
    """One wrong statement about a recording.

    Attributes:
        kind: what is wrong, in the table.
        plant: makes the recording wrong.
        named: what `check` may call it.
        is_new: whether no rule was chosen with it.
    """

    kind: str
    plant: Planter
    named: tuple[str, ...]
    is_new: bool = False


def fault(kind: str, plant: Planter, *named: str) -> Fault:
    """A fault that `check` calls by its kind, unless other names are given."""
    return Fault(kind, plant, named or (kind,))


def unknown(kind: str, plant: Planter, *also: str) -> Fault:
    """A new fault that nothing mends, and what else it may be called."""
    return Fault(kind, plant, (*UNKNOWN, *also), is_new=True)


def both(first: Planter, second: Planter) -> Planter:
    return lambda r, rng: second(first(r, rng), rng)


def two(first: str, second: str) -> tuple[str, ...]:
    return (f"{first} and {second}", f"{second} and {first}")


def direction(rng: Rng) -> Floats:
    way = rng.normal(size=3)
    return np.asarray(way / np.linalg.norm(way))


def sign(rng: Rng) -> int:
    return int(rng.choice([-1, 1]))


def late_us(rng: Rng, least: float, most: float) -> int:
    return round(float(rng.uniform(least, most)) * sign(rng))


# Poses.


def with_poses(
    recording: Recording, *, at: slice | NDArray[np.int64] = slice(None), **columns: Any
) -> Recording:
    """Poses with some columns replaced, of which those `at` some places are kept."""
    columns = vars(recording.trajectory) | columns
    poses = Trajectory(**{name: column[at] for name, column in columns.items()})
    return AlteredRecording(recording, trajectory=poses)


def posed(**change: Callable[[Trajectory, Rng], Any]) -> Planter:
    """Columns of the poses changed: `t_us`, `positions_m` or `quats_xyzw`."""
    return lambda r, rng: with_poses(
        r, **{name: new(r.trajectory, rng) for name, new in change.items()}
    )


def period_us(r: Recording) -> float:
    """The usual time from a pose to the next, µs."""
    return float(np.median(np.diff(r.trajectory.t_us)))


def turns_of(r: Recording) -> Rotation:
    return Rotation.from_quat(r.trajectory.quats_xyzw)


def turning(change: Callable[[Rotation, Recording, Rng], Rotation]) -> Planter:
    """The poses' rotations changed."""
    return lambda r, rng: with_poses(r, quats_xyzw=change(turns_of(r), r, rng).as_quat())


def reread(order: str, as_order: str, *, degrees: bool = False, factor: float = 1.0) -> Planter:
    """Euler angles that were made into rotations in another order, or in another unit."""
    return turning(
        lambda turns, *_: Rotation.from_euler(as_order, turns.as_euler(order) * factor, degrees)
    )


def posed_from(r: Recording, T_body_other: Floats) -> Recording:
    """Poses of something that lies so on the body, taken for those of the body."""
    return AlteredRecording(r, trajectory=r.trajectory.times(T_body_other))


# Where cameras sit, and their lenses.


def turned(rotation: Rotation) -> Floats:
    """(4, 4) a rotation alone."""
    return se3.from_rotation(rotation, np.zeros(3))


def placed(r: Recording, *T_body_cam: Floats) -> Recording:
    """The first cameras stand elsewhere on the body."""
    rest = r.rig.T_body_cam[len(T_body_cam) :]
    return AlteredRecording(r, rig=replace(r.rig, T_body_cam=(*T_body_cam, *rest)))


def on_body(r: Recording, change: Change) -> Recording:
    """The hand-eye transformation changed, and what lies between cameras left as it is."""
    T_body_0 = r.rig.T_body_cam[0]
    inside = [se3.inverse(T_body_0) @ T for T in r.rig.T_body_cam]
    return placed(r, *(change(T_body_0) @ T for T in inside))


def tracked(recording: Recording, T_tracked_body: Floats) -> Recording:
    """The same recording, with the poses of another body that the cameras sit on."""
    posed_ = posed_from(recording, se3.inverse(T_tracked_body))
    return placed(posed_, *(T_tracked_body @ T for T in recording.rig.T_body_cam))


def hand_eye(rng: Rng) -> Floats:
    """A tracked body on a camera: turned by 20 to 120 deg, up to 10 cm away."""
    turn = Rotation.from_rotvec(direction(rng) * rng.uniform(20, 120), degrees=True)
    return se3.from_rotation(turn, rng.uniform(-0.1, 0.1, 3))


def wrong_hand_eye(change: Change) -> Planter:
    """Poses of a tracked body, whose hand-eye transformation is changed."""
    return lambda r, rng: on_body(tracked(r, hand_eye(rng)), change)


def second_moved(r: Recording, change: Change) -> Recording:
    """The second camera stands at a changed `T_0_1`."""
    T_0, T_1 = r.rig.T_body_cam[:2]
    return placed(r, T_0, T_0 @ change(se3.inverse(T_0) @ T_1))


def second_turned(axis: int, low_deg: float, high_deg: float) -> Planter:
    """The second camera turned about one of its axes."""

    def plant(r: Recording, rng: Rng) -> Recording:
        angle_deg = float(rng.uniform(low_deg, high_deg) * sign(rng))
        turn = turned(Rotation.from_rotvec(np.eye(3)[axis] * angle_deg, degrees=True))
        return second_moved(r, lambda T: T @ turn)

    return plant


def longer(low: float, high: float) -> Planter:
    """The second camera so many times as far away, spread evenly over the logarithm."""

    def plant(r: Recording, rng: Rng) -> Recording:
        times = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        return second_moved(r, part(slice(3), 3, lambda t_m: t_m * times))

    return plant


def part(rows: slice, columns: slice | int, change: Change) -> Change:
    """Changes a part of a rigid motion alone."""

    def changed(T: Floats) -> Floats:
        T = T.copy()
        T[rows, columns] = change(T[rows, columns])
        return T

    return changed


def cameras(r: Recording, change: Callable[[Camera], Camera]) -> Recording:
    """The calibration of all cameras changed."""
    return AlteredRecording(r, rig=replace(r.rig, cameras=tuple(map(change, r.rig.cameras))))


def lenses(r: Recording, **fields: Callable[[Any], Any]) -> Recording:
    """Fields of their calibration changed."""
    return cameras(r, lambda c: replace(c, **{k: new(getattr(c, k)) for k, new in fields.items()}))


# Events.


class EditedRecording(DerivedRecording):
    """A recording whose events pass through a function, camera by camera."""

    def __init__(
        self, recording: Recording, edit: Callable[[int, Events], Events], stretch: int = 1
    ) -> None:
        super().__init__(recording)
        self._edit, self._stretch = edit, stretch

    def event_span_us(self, camera: int) -> tuple[int, int]:
        """First and last instant, on a clock that runs so many times as fast, µs."""
        first_us, last_us = self.recording.event_span_us(camera)
        return first_us * self._stretch, last_us * self._stretch

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Edited events of a camera with `t0_us <= t < t1_us`."""
        s = self._stretch
        events = self.recording.events(camera, -(-t0_us // s), -(-t1_us // s))
        return self._edit(camera, replace(events, t_us=events.t_us * s))


def edited(r: Recording, edit: Callable[[Events, Camera], Events], *only: int) -> Recording:
    """Events of some cameras edited, of all where none is named, and sorted by time again."""

    def change(camera: int, e: Events) -> Events:
        if only and camera not in only:
            return e
        e = edit(e, r.rig.cameras[camera])
        return e.take(np.argsort(e.t_us, kind="stable"))

    return EditedRecording(r, change)
