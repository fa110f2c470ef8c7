"""Numbers of a recording that may be off, how far each is looked for, and what corrects it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check.alternatives import (
    Matrix,
    between,
    hand_eye_times,
    with_baseline,
    with_lenses,
)

_FACTORS = (0.4, 0.55, 0.7, 0.85, 1.0, 1.18, 1.4, 1.8, 2.5)
_FOCAL = (0.35, 0.5, 0.7, 0.85, 1.0, 1.18, 1.4, 2.0, 2.8)
_CLOCK_MS = (320.0, 160.0, 80.0, 40.0, 20.0, 10.0)
_HAND_EYE_DEG = (40.0, 20.0, 10.0, 5.0, 2.5)
_ANGLES_DEG = (8.0, 5.0, 3.0, 2.0, 1.0, 0.4)


@dataclass(frozen=True)
class Amount:
    """A number that may be off.

    Attributes:
        name: of the number, such as `camera clock`.
        unit: of the amounts.
        neutral: the amount that changes nothing: 0, or 1 for a factor.
        grid: amounts to try, the neutral one among them.
        change: corrects a recording by an amount.
        hurts: the error from which a map suffers (page `studies`), in `unit`; of factors, in
            logarithms.
        cure: what to do, with the amount as `{amount}`.
        margin: the least gain that counts, in logarithms.
        of_pair: whether it concerns two cameras, and not camera 0 and its poses.
    """

    name: str
    unit: str
    neutral: float
    grid: tuple[float, ...]
    change: Callable[[Recording, float], Recording]
    hurts: float
    cure: str
    margin: float = 0.015
    of_pair: bool = False

    @property
    def is_factor(self) -> bool:
        """Whether amounts multiply: steps and differences are those of logarithms."""
        return self.neutral == 1.0

    def distance(self, amount: float) -> float:
        """How far an amount is from the neutral one."""
        return float(abs(np.log(amount)) if self.is_factor else abs(amount))

    def moved(self, amount: float, by: float) -> float:
        """An amount so far from another; `by` is a logarithm where amounts are factors."""
        return float(amount * np.exp(by) if self.is_factor else amount + by)


def _both_ways(amounts: tuple[float, ...]) -> tuple[float, ...]:
    return (*(-a for a in amounts), 0.0, *reversed(amounts))


def amounts_of_one(*, paired: bool) -> list[Amount]:
    """Numbers of a camera and its poses that may be wrong.

    Args:
        paired: whether there is a second camera. One alone does not determine its focal length:
            depth scales with it, and rays meet about as sharply.
    """
    focal = Amount(
        "focal length", "", 1.0, _FOCAL, _focal, 0.1,
        "the focal lengths fit when multiplied by {amount:.3g}: use the calibration of this "
        "lens and resolution", 0.06,
    )  # fmt: skip
    return [
        *([focal] if paired else []),
        Amount(
            "pose clock", "ms", 0.0, _both_ways(_CLOCK_MS), _late_poses, 20.0,
            "shift the times of the poses by {amount:+.0f} ms (poses.time_offset_us)",
        ),
        *(
            Amount(
                f"hand-eye rotation about {'xyz'[axis]}", "deg", 0.0, _both_ways(_HAND_EYE_DEG),
                _hand_eye_turned(axis), 1.0,
                f"turn the cameras on the body by {{amount:+.1f}} deg about the camera's "
                f"{'xyz'[axis]} axis: the hand-eye transformation is missing or wrong", 0.04,
            )
            for axis in range(3)
        ),
    ]  # fmt: skip


def amounts_of_pair() -> list[Amount]:
    """Numbers that can be wrong between two cameras, or between them and their poses."""
    angles = [
        Amount(
            f"stereo {name}", "deg", 0.0, _both_ways(_ANGLES_DEG), _turned(axis), hurts,
            "turn the second camera by {amount:+.2f} deg about its "
            + "xyz"[axis]
            + " axis, or calibrate the rig again", of_pair=True,
        )
        for name, axis, hurts in (("pitch", 0, 0.15), ("yaw", 1, 0.2), ("roll", 2, 0.3))
    ]  # fmt: skip
    return [
        Amount(
            "camera clock", "ms", 0.0, _both_ways(_CLOCK_MS), _late_camera, 5.0,
            "shift the times of the second camera's events by {amount:+.1f} ms "
            "(events.time_offset_us)", of_pair=True,
        ),
        Amount(
            "baseline", "", 1.0, _FACTORS, with_baseline, 0.1,
            "multiply the distance between the cameras by {amount:.3g}, or divide the "
            "positions of the poses by it: their ratio is wrong", of_pair=True,
        ),
        *angles,
    ]  # fmt: skip


def _late_poses(recording: Recording, late_ms: float) -> Recording:
    return AlteredRecording(recording, trajectory=_late(recording.trajectory, late_ms))


@lru_cache(maxsize=1)  # all windows have the same poses
def _late(poses: Trajectory, late_ms: float) -> Trajectory:
    return Trajectory(poses.t_us + round(1e3 * late_ms), poses.positions_m, poses.quats_xyzw)


def _late_camera(recording: Recording, late_ms: float) -> Recording:
    return AlteredRecording(recording, clock_us=(0, round(1e3 * late_ms)))


def _focal(recording: Recording, factor: float) -> Recording:
    return with_lenses(recording, lambda camera: camera.zoomed(factor))


def _turned(axis: int) -> Callable[[Recording, float], Recording]:
    def change(recording: Recording, angle_deg: float) -> Recording:
        T_1_turned = _turn(axis, angle_deg)
        return AlteredRecording(recording, rig=between(recording.rig, lambda T: T @ T_1_turned))

    return change


def _turn(axis: int, angle_deg: float) -> Matrix:
    turn = Rotation.from_rotvec(np.eye(3)[axis] * angle_deg, degrees=True)
    return se3.from_rotation(turn, np.zeros(3))


def _hand_eye_turned(axis: int) -> Callable[[Recording, float], Recording]:
    return lambda recording, angle_deg: hand_eye_times(_turn(axis, angle_deg))(recording)
