"""Checks of the poses: do they cover the events, and is the motion plausible?

Motion is judged over steps of 50 ms: shorter ones show the noise of a tracker, longer ones blur a
head's. Speeds do not depend on the poses' frame, so wrong conventions are only found by mapping.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import significant
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check.events import time_unit
from eventsweep.plugins.diagnose.check.findings import (
    TIME,
    Finding,
    Series,
    Verdict,
    above,
    below,
    judged,
)

Floats = NDArray[np.float64]
STEP_US = 50_000
# m/s, m/s², deg/s. Heads: Grossman et al. 1988 have turns up to 780 deg/s; a hand throws a camera
# at 3 m/s and 50 m/s². Cars brake with 10 m/s² and drive 50 m/s. Racing drones reach 40 m/s and
# 150 m/s² (UZH-FPV, Delmerico et al. 2019), with 750 deg/s.
_SPEED, _ACCELERATION, _TURNING = (50.0, 150.0), (60.0, 200.0), (900.0, 2500.0)
# Share of the events' time that poses cover.
_COVERAGE_DOUBTFUL, _COVERAGE_WRONG = 0.9, 0.3
# Poses per second: 20 Hz cost 7 to 10 % on moving heads, 10 Hz are not enough (page `studies`).
_RATE_DOUBTFUL_HZ, _RATE_WRONG_HZ = 18.0, 9.0
# Noise that doubles every method's error is 3 mm and 0.15 deg per pose (page `studies`).
_NOISE_MM, _NOISE_DEG = (1.5, 5.0), (0.08, 0.4)
_NOISE_RATE_HZ = 50.0
# Poses per second of any tracker: GPS has 5 or more, the fastest simulated ones 1000.
_TRACKERS_HZ = (3.0, 20_000.0)
# Share of steps in which a tracker that moves before and after stands still.
_FROZEN_DOUBTFUL, _FROZEN_WRONG = 0.05, 0.3
# A step many times as long as those around it, and faster than a body moves.
_JUMP_TIMES, _JUMP_SPEED, _JUMP_ACCELERATION = 20.0, 5.0, 500.0


def check_poses(recording: Recording, spans_us: tuple[int, int]) -> list[Finding]:
    """Checks that need only the poses, and the events' time.

    Args:
        recording: with poses.
        spans_us: first and last event of all cameras.
    """
    poses = recording.trajectory
    coverage = _coverage(poses, spans_us)
    if len(poses) < 3:
        few = judged(
            "poses-rate", "wrong", float(len(poses)), "poses", f"{len(poses)} poses in all",
            meaning="motion between two poses is assumed straight",
            suspect="too few poses",
        )  # fmt: skip
        return [coverage, few]
    return [coverage, _rate(poses), _frozen(poses), _jumps(poses), *_motion(poses), _noise(poses)]


def _coverage(poses: Trajectory, events_us: tuple[int, int]) -> Finding:
    first_us, last_us = poses.span_us
    whole_us = max(events_us[1] - events_us[0], 1)
    both_us = min(last_us, events_us[1]) - max(first_us, events_us[0])
    share = float(np.clip(both_us / whole_us, 0, 1))
    verdict = below(share, _COVERAGE_DOUBTFUL, _COVERAGE_WRONG)
    ratio = whole_us / max(last_us - first_us, 1)
    like = _mistaken_unit(ratio, _rate_hz(poses), covered=verdict == "good")
    if like:
        verdict = "wrong"
    elif verdict == "wrong" and 0.3 < ratio < 3:
        like = f"of another clock: the events begin {events_us[0] - first_us} µs after the poses"
    return judged(
        "poses-coverage", verdict, share, "",
        f"poses cover {share:.1%} of the events' time: poses {_seconds(first_us, last_us)}, events "
        f"{_seconds(*events_us)}{like and f'; as if {like}'}",
        meaning="events without a pose cannot vote: look at unit and clock of the times (time_unit "
        "of the events, unit and time_offset_us of the poses)",
        suspect="poses and events apart",
    )  # fmt: skip


def _rate_hz(poses: Trajectory) -> float:
    return 1e6 / float(np.median(np.diff(poses.t_us))) if len(poses) > 1 else 0.0


def _seconds(first_us: int, last_us: int) -> str:
    return f"{first_us / 1e6:.3f} to {last_us / 1e6:.3f} s"


def _mistaken_unit(ratio: float, rate_hz: float, *, covered: bool) -> str:
    """What it looks like where events last a power of 1000 times as long as poses; else empty.

    Args:
        ratio: duration of the events over that of the poses.
        rate_hz: poses per second, as given.
        covered: whether poses cover the events: then poses may go on for long, at the rate of a
            tracker.
    """
    power = np.log10(max(ratio, 1e-12)) / 3
    usual = _TRACKERS_HZ[0] <= rate_hz <= _TRACKERS_HZ[1]
    if round(power) == 0 or abs(power - round(power)) > 0.15 or (covered and usual):
        return ""
    if not usual:
        return "pose times in another unit"
    return time_unit(1000.0 ** -round(power), "event") or "event times in another unit"


def _rate(poses: Trajectory) -> Finding:
    steps_s = np.diff(poses.t_us) / 1e6
    rate_hz = _rate_hz(poses)
    longest_s = float(steps_s.max())
    verdict = below(rate_hz, _RATE_DOUBTFUL_HZ, _RATE_WRONG_HZ)
    rate = significant(rate_hz, 3)
    words = f"{rate} poses per second, the longest gap is {longest_s:.3g} s"
    if verdict == "good" and longest_s > max(10 * float(np.median(steps_s)), 0.05):
        verdict = "doubtful"
    return judged(
        "poses-rate", verdict, rate_hz, "Hz", words,
        meaning="motion between poses is assumed straight and uniform; heads need 50 Hz or more",
        suspect="poses too rare" if rate_hz < _RATE_DOUBTFUL_HZ else "gaps in the poses",
    )  # fmt: skip


def _frozen(poses: Trajectory) -> Finding:
    still = (np.diff(poses.positions_m, axis=0) == 0).all(axis=1)
    still &= (np.diff(poses.quats_xyzw, axis=0) == 0).all(axis=1)
    share = float(still.mean())
    return judged(
        "poses-frozen", above(share, _FROZEN_DOUBTFUL, _FROZEN_WRONG), share, "",
        f"{share:.1%} of the poses repeat the previous one",
        meaning="a tracker that loses the body repeats its last pose, while the camera moves on",
        suspect="poses frozen",
    )  # fmt: skip


def _jumps(poses: Trajectory) -> Finding:
    dt_s = np.diff(poses.t_us) / 1e6
    way_m = np.linalg.norm(np.diff(poses.positions_m, axis=0), axis=1)
    usual_m = _usual(way_m)
    speed = way_m / dt_s
    jumps = (way_m > _JUMP_TIMES * usual_m) & (speed > _JUMP_SPEED)
    jumps &= speed / np.maximum(dt_s, 1e-3) > _JUMP_ACCELERATION
    count, largest_m = int(jumps.sum()), float(way_m[jumps].max(initial=0.0))
    seen = f"{count} steps of up to {significant(largest_m, 3)} m" if count else "no step"
    return judged(
        "poses-jumps", "wrong" if count else "good", float(count), "jumps",
        f"{seen} over {_JUMP_TIMES:g} times as long as those around",
        meaning="the tracker lost the body, or its world moved: windows across a jump show two "
        "scenes",
        suspect="poses jump",
        series=Series(1e3 * way_m, poses.t_us[1:] / 1e6, TIME, "step between poses, mm"),
    )  # fmt: skip


def _usual(values: Floats, reach: int = 10) -> Floats:
    """The median around each value, at least a tenth of the overall median."""
    from scipy.ndimage import median_filter

    around = median_filter(values, 2 * reach + 1, mode="nearest")
    return np.asarray(np.maximum(around, 0.1 * np.median(values) + 1e-9), np.float64)


def sampled(poses: Trajectory) -> tuple[Floats, Floats, Rotation]:
    """Times (N,) s, positions (N, 3) m and rotations at steps of `STEP_US`, at least three."""
    first_us, last_us = poses.span_us
    count = max(int((last_us - first_us) // STEP_US) + 1, 3)
    t_us = np.linspace(first_us, last_us, count).astype(np.int64)
    T = poses.at(t_us)
    return t_us / 1e6, T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3])


def _motion(poses: Trajectory) -> list[Finding]:
    t_s, at_m, turned = sampled(poses)
    dt_s = np.maximum(np.diff(t_s), 1e-6)
    velocity = np.diff(at_m, axis=0) / dt_s[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    middle_s = np.maximum((t_s[2:] - t_s[:-2]) / 2, 1e-6)
    acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / middle_s
    turning = np.degrees((turned[:-1].inv() * turned[1:]).magnitude()) / dt_s
    units = "positions in mm or cm are read as metres, or times in another unit"
    turns = "order of the quaternion, unit of the times, or degrees read as radians"
    findings = []
    for name, values, limits, unit, like in (
        ("poses-speed", speed, _SPEED, "m/s", units),
        ("poses-acceleration", acceleration, _ACCELERATION, "m/s²", units),
        ("poses-turning", turning, _TURNING, "deg/s", turns),
    ):
        usual = float(np.percentile(values, 90))
        findings.append(judged(
            name, above(usual, *limits), usual, unit,
            f"{significant(usual, 3)} {unit}, exceeded in a tenth of the time; heads, drones and "
            f"cars stay below {limits[0]:g}",
            meaning=f"implausible motion: {like}?", suspect="impossible motion",
            series=Series(values, t_s[1 : len(values) + 1], TIME, f"{name[6:]}, {unit}",
                          limits),
        ))  # fmt: skip
    return findings


def _noise(poses: Trajectory) -> Finding:
    """Noise of single poses, from their distance to the middle of their neighbours."""
    rate_hz = _rate_hz(poses)
    if rate_hz < _NOISE_RATE_HZ or len(poses) < 10:
        return Finding("poses-noise", "good", None, "mm", "too few poses for a verdict")
    beside_mm = 1e3 * np.linalg.norm(_beside(poses.positions_m), axis=1)
    rotations = Rotation.from_quat(poses.quats_xyzw)
    back, ahead = rotations[1:-1].inv() * rotations[:-2], rotations[1:-1].inv() * rotations[2:]
    beside_deg = np.degrees(np.linalg.norm(back.as_rotvec() + ahead.as_rotvec(), axis=1) / 2)
    # The middle of two neighbours scatters as well: variances add to 3/2, over three axes.
    noise_mm = float(np.median(beside_mm)) / np.sqrt(1.5 * _MEDIAN_CHI2_3)
    noise_deg = float(np.median(beside_deg)) / np.sqrt(1.5 * _MEDIAN_CHI2_3)
    verdicts: list[Verdict] = [above(noise_mm, *_NOISE_MM), above(noise_deg, *_NOISE_DEG)]
    verdict = max(verdicts, key=("good", "doubtful", "wrong").index)
    return judged(
        "poses-noise", verdict, noise_mm, "mm",
        f"single poses scatter by {noise_mm:.2g} mm and {noise_deg:.2g} deg per axis",
        meaning="3 mm and 0.15 deg double every method's error",
        suspect="noisy poses",
    )  # fmt: skip


_MEDIAN_CHI2_3 = 2.366


def _beside(values: Floats) -> Floats:
    """(N - 2, 3) each minus the middle of its neighbours."""
    return values[1:-1] - (values[:-2] + values[2:]) / 2
