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
Matrix = NDArray[np.float64]
Planter = Callable[[Recording, Rng], Recording]
Edit = Callable[[Events, Camera, Rng], Events]
UNKNOWN = ("no single cause found",)
EULER = tuple("".join(order) for order in permutations("xyz"))


@dataclass(frozen=True)
class Fault:
    """One wrong statement about a recording.

    Attributes:
        kind: what is wrong, in the table.
        plant: makes the recording wrong.
        named: what `check` may call it.
    """

    kind: str
    plant: Planter
    named: tuple[str, ...]


def fault(kind: str, plant: Planter, *named: str) -> Fault:
    """A fault that `check` calls by its kind, unless other names are given."""
    return Fault(kind, plant, named or (kind,))


def unknown(kind: str, plant: Planter, *also: str) -> Fault:
    """A fault that nothing mends, and what else it may be called."""
    return Fault(kind, plant, (*UNKNOWN, *also))


def both(first: Planter, second: Planter) -> Planter:
    return lambda r, rng: second(first(r, rng), rng)


def two(first: str, second: str) -> tuple[str, ...]:
    return (f"{first} and {second}", f"{second} and {first}")


def with_poses(
    recording: Recording, *, t_us: NDArray[np.int64] | None = None,
    positions_m: Matrix | None = None, quats_xyzw: Matrix | None = None,
    at: slice | NDArray[np.int64] = slice(None),
) -> Recording:  # fmt: skip
    """Poses with some columns replaced, of which those `at` some places are kept."""
    p = recording.trajectory
    poses = Trajectory(
        (p.t_us if t_us is None else t_us)[at],
        (p.positions_m if positions_m is None else positions_m)[at],
        (p.quats_xyzw if quats_xyzw is None else quats_xyzw)[at],
    )
    return AlteredRecording(recording, trajectory=poses)


def repeated(r: Recording, at: NDArray[np.int64]) -> Recording:
    """Poses of other times at the present times."""
    p = r.trajectory
    return with_poses(r, positions_m=p.positions_m[at], quats_xyzw=p.quats_xyzw[at])


def period_us(r: Recording) -> float:
    """The usual time from a pose to the next, µs."""
    return float(np.median(np.diff(r.trajectory.t_us)))


def turned_by(r: Recording, turns: Rotation) -> Recording:
    return with_poses(r, quats_xyzw=turns.as_quat())


def turns_of(r: Recording) -> Rotation:
    return Rotation.from_quat(r.trajectory.quats_xyzw)


def reread(order: str, as_order: str, *, degrees: bool = False, factor: float = 1.0) -> Planter:
    """Euler angles that were made into rotations in another order, or in another unit."""

    def plant(r: Recording, rng: Rng) -> Recording:
        del rng
        angles = turns_of(r).as_euler(order) * factor
        return turned_by(r, Rotation.from_euler(as_order, angles, degrees=degrees))

    return plant


def direction(rng: Rng) -> Matrix:
    way = rng.normal(size=3)
    return np.asarray(way / np.linalg.norm(way))


def sign(rng: Rng) -> int:
    return int(rng.choice([-1, 1]))


def turned(rotation: Rotation) -> Matrix:
    """(4, 4) a rotation alone."""
    return se3.from_rotation(rotation, np.zeros(3))


def posed_from(r: Recording, T_body_given: Matrix) -> Recording:
    """Poses of something that lies so on the body, taken for those of the body."""
    return AlteredRecording(r, trajectory=r.trajectory.times(T_body_given))


def placed(r: Recording, *T_body_cam: Matrix) -> Recording:
    """The first cameras stand elsewhere on the body."""
    rest = r.rig.T_body_cam[len(T_body_cam) :]
    return AlteredRecording(r, rig=replace(r.rig, T_body_cam=(*T_body_cam, *rest)))


def second_moved(r: Recording, change: Callable[[Matrix], Matrix]) -> Recording:
    """The second camera stands at a changed `T_0_1`."""
    T_0, T_1 = r.rig.T_body_cam[:2]
    return placed(r, T_0, T_0 @ change(se3.inverse(T_0) @ T_1))


def second_turned(r: Recording, rotvec_deg: Matrix) -> Recording:
    turn = turned(Rotation.from_rotvec(rotvec_deg, degrees=True))
    return second_moved(r, lambda T: T @ turn)


def with_translation(change: Callable[[Matrix], Matrix]) -> Callable[[Matrix], Matrix]:
    """Changes the translation alone of a rigid motion."""

    def changed(T: Matrix) -> Matrix:
        T = T.copy()
        T[:3, 3] = change(T[:3, 3])
        return T

    return changed


def cameras(r: Recording, change: Callable[[Camera], Camera], *only: int) -> Recording:
    """Some cameras' calibration changed; of all where none is given."""
    changed = (change(c) if k in only or not only else c for k, c in enumerate(r.rig.cameras))
    return AlteredRecording(r, rig=replace(r.rig, cameras=tuple(changed)))


def lenses(r: Recording, *only: int, **fields: Callable[[Any], Any]) -> Recording:
    """Fields of their calibration multiplied or added to."""

    def change(c: Camera) -> Camera:
        return replace(c, **{name: change(getattr(c, name)) for name, change in fields.items()})

    return cameras(r, change, *only)


def focal(r: Recording, times: float, *only: int) -> Recording:
    return lenses(r, *only, fx_px=lambda f: f * times, fy_px=lambda f: f * times)


def one_of(rng: Rng, *ranges: tuple[float, float]) -> float:
    """A number from one of several ranges."""
    return float(rng.choice([rng.uniform(*limits) for limits in ranges]))


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
    """Events of some cameras edited, of all where none is given, and sorted by time again."""

    def change(camera: int, e: Events) -> Events:
        if only and camera not in only:
            return e
        e = edit(e, r.rig.cameras[camera])
        return e.take(np.argsort(e.t_us, kind="stable"))

    return EditedRecording(r, change)


def second_late(r: Recording, late_us: int) -> Recording:
    return AlteredRecording(r, clock_us=(0, late_us, *[0] * (len(r.rig) - 2)))
