"""Checks of the poses: do they cover the events, is the motion plausible, and is there parallax?

Motion is judged over steps of 50 ms: shorter ones show the noise of a tracker, longer ones blur a
head's. Speeds do not depend on the poses' frame, so wrong conventions are only found by mapping.

Without parallax there is no depth, whatever the method. A point at depth Z moves by f b / Z pixels
while the camera moves by b across its viewing direction; turning adds none. A window whose nearest
points move by less than a pixel has no depth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.occupied import Span, length_of, spans_of, spread
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError, significant
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.windows import choose_window, plan_windows
from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.events import time_unit
from eventsweep.plugins.diagnose.check.findings import TIME, Finding, Series, judged, worst
from eventsweep.plugins.diagnose.check.limits import LIMITS, verdict_of

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
_MEDIAN_CHI2_3 = 2.366  # of the chi-squared distribution with three degrees of freedom


def check_poses(poses: Trajectory, spans: Sequence[Span]) -> list[Finding]:
    """Checks that need only the poses, and the half-open spans of the events, µs."""
    coverage = _coverage(poses, spans)
    if len(poses) < 3:
        few = Finding(
            "poses-rate", "wrong", float(len(poses)), "poses", f"{len(poses)} poses in all",
            "motion between two poses is assumed straight", suspect="too few poses",
        )  # fmt: skip
        return [coverage, few]
    return [coverage, _rate(poses), _frozen(poses), _jumps(poses), *_motion(poses), _noise(poses)]


def _coverage(poses: Trajectory, spans: Sequence[Span]) -> Finding:
    first_us, last_us = poses.span_us
    occupied = [(begin_us, end_us - 1) for begin_us, end_us in spans]
    events_us = occupied[0][0], occupied[-1][1]
    whole_us = max(length_of(occupied), 1)
    both_us = sum(max(min(last_us, b) - max(first_us, a), 0) for a, b in occupied)
    share = float(np.clip(both_us / whole_us, 0, 1))
    verdict = LIMITS["poses-coverage"].verdict(share)
    ratio = whole_us / max(length_of(spans_of(poses.t_us)), 1)
    like = _mistaken_unit(ratio, _rate_hz(poses), covered=verdict == "good")
    if like:
        verdict = "wrong"
    elif verdict == "wrong" and 0.3 < ratio < 3:
        like = f"of another clock: the events begin {events_us[0] - first_us} µs after the poses"
    return judged(
        "poses-coverage", share,
        f"poses cover {share:.1%} of the events' time: poses {_seconds(first_us, last_us)}, events "
        f"{_seconds(*events_us)}{like and f'; as if {like}'}",
        verdict=verdict,
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
    usual = limits.TRACKERS_HZ[0] <= rate_hz <= limits.TRACKERS_HZ[1]
    if round(power) == 0 or abs(power - round(power)) > 0.15 or (covered and usual):
        return ""
    if not usual:
        return "pose times in another unit"
    return time_unit(1000.0 ** -round(power), "event") or "event times in another unit"


def _rate(poses: Trajectory) -> Finding:
    steps_s = np.diff(poses.t_us) / 1e6
    rate_hz, longest_s = _rate_hz(poses), float(steps_s.max())
    verdict = LIMITS["poses-rate"].verdict(rate_hz)
    longest = max(limits.GAP_STEPS * float(np.median(steps_s)), limits.GAP_S)
    if verdict == "good" and longest_s > longest:
        verdict = "doubtful"
    return judged(
        "poses-rate", rate_hz,
        f"{significant(rate_hz, 3)} poses per second, the longest gap is {longest_s:.3g} s",
        verdict=verdict,
        suspect="" if rate_hz < LIMITS["poses-rate"].usual[0] else "gaps in the poses",
    )  # fmt: skip


def _frozen(poses: Trajectory) -> Finding:
    steps = np.diff(np.hstack([poses.positions_m, poses.quats_xyzw]), axis=0)
    share = float((steps == 0).all(axis=1).mean())
    return judged("poses-frozen", share, f"{share:.1%} of the poses repeat the previous one")


def _jumps(poses: Trajectory) -> Finding:
    dt_s = np.diff(poses.t_us) / 1e6
    way_m = np.linalg.norm(np.diff(poses.positions_m, axis=0), axis=1)
    speed, times = way_m / dt_s, limits.JUMP_TIMES
    jumps = (way_m > times * _usual(way_m)) & (speed > limits.JUMP_SPEED)
    jumps &= speed / np.maximum(dt_s, 1e-3) > limits.JUMP_ACCELERATION
    count, largest_m = int(jumps.sum()), float(way_m[jumps].max(initial=0.0))
    seen = f"{count} steps of up to {significant(largest_m, 3)} m" if count else "no step"
    return judged(
        "poses-jumps", float(count), f"{seen} over {times:g} times as long as those around",
        series=Series(1e3 * way_m, poses.t_us[1:] / 1e6, TIME, "step between poses, mm"),
    )  # fmt: skip


def _usual(values: Floats, reach: int = 10) -> Floats:
    """The median around each value, at least a tenth of the overall median."""
    from scipy.ndimage import median_filter

    around = median_filter(values, 2 * reach + 1, mode="nearest")
    return np.asarray(np.maximum(around, 0.1 * np.median(values) + 1e-9), np.float64)


def _motion(poses: Trajectory) -> list[Finding]:
    """Speed, acceleration and turning, of the longest stretch without a long gap."""
    first_us, last_us = max(spans_of(poses.t_us), key=lambda span: span[1] - span[0])
    count = max(int((last_us - first_us) // limits.STEP_US) + 1, 3)
    t_us = first_us + np.linspace(0, last_us - first_us, count).astype(np.int64)
    T_world_body, t_s = poses.at(t_us), t_us / 1e6
    at_m, turned = T_world_body[:, :3, 3], Rotation.from_matrix(T_world_body[:, :3, :3])
    dt_s = np.maximum(np.diff(t_s), 1e-6)
    velocity = np.diff(at_m, axis=0) / dt_s[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    middle_s = np.maximum((t_s[2:] - t_s[:-2]) / 2, 1e-6)
    acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / middle_s
    turning = np.degrees((turned[:-1].inv() * turned[1:]).magnitude()) / dt_s
    findings = []
    for name, values in (
        ("poses-speed", speed), ("poses-acceleration", acceleration), ("poses-turning", turning)
    ):  # fmt: skip
        usual, unit, steps = float(np.percentile(values, 90)), LIMITS[name].unit, len(values)
        marks = LIMITS[name].usual[1], LIMITS[name].possible[1]
        findings.append(judged(
            name, usual,
            f"{significant(usual, 3)} {unit}, exceeded in a tenth of the time; heads, drones and "
            f"cars stay below {marks[0]:g}",
            series=Series(values, t_s[1 : steps + 1], TIME, f"{name[6:]}, {unit}", marks),
        ))  # fmt: skip
    return findings


def _noise(poses: Trajectory) -> Finding:
    """Noise of single poses, from their distance to the middle of their neighbours."""
    rate_hz = _rate_hz(poses)
    if rate_hz < limits.NOISE_RATE_HZ or len(poses) < 10:
        return Finding("poses-noise", "good", None, "mm", "too few poses for a verdict")
    at_m, rotations = poses.positions_m, Rotation.from_quat(poses.quats_xyzw)
    beside_mm = 1e3 * np.linalg.norm(at_m[1:-1] - (at_m[:-2] + at_m[2:]) / 2, axis=1)
    back, ahead = rotations[1:-1].inv() * rotations[:-2], rotations[1:-1].inv() * rotations[2:]
    beside_deg = np.degrees(np.linalg.norm(back.as_rotvec() + ahead.as_rotvec(), axis=1) / 2)
    # The middle of two neighbours scatters as well: variances add to 3/2, over three axes.
    noise_mm = float(np.median(beside_mm)) / np.sqrt(1.5 * _MEDIAN_CHI2_3)
    noise_deg = float(np.median(beside_deg)) / np.sqrt(1.5 * _MEDIAN_CHI2_3)
    verdicts = LIMITS["poses-noise"].verdict(noise_mm), verdict_of(noise_deg, *limits.NOISE_DEG)
    words = f"single poses scatter by {noise_mm:.2g} mm and {noise_deg:.2g} deg per axis"
    return judged("poses-noise", noise_mm, words, verdict=worst(verdicts))


def check_parallax(recording: Recording, config: MapperConfig) -> list[Finding]:
    """Checks that the camera moves enough in the windows that will be mapped.

    Args:
        recording: with poses.
        config: windows as `map` takes them, and the depth range.

    Raises:
        InputError: no window, or an impossible depth range.
    """
    near_m, far_m = depth_range_m(recording, config)
    begins_us, ends_us = _windows(recording, config)
    ways_m = np.array(
        [_across_m(recording, int(a), int(b)) for a, b in zip(begins_us, ends_us, strict=True)]
    )
    focal_px, row = recording.rig.cameras[0].fx_px, LIMITS["parallax"]
    near_px = focal_px * ways_m / near_m
    way_m, usual_px, most_px = map(float, (np.median(ways_m), np.median(near_px), near_px.max()))
    verdict = row.verdict(most_px)
    if verdict == "good" and usual_px < row.usual[0]:
        verdict = "doubtful"
    length_s = float(np.median(ends_us - begins_us)) / 1e6
    stereo = (
        ": only the distance between the cameras is left, and every error of the calibration with "
        "it"
    )
    return [judged(
        "parallax", usual_px,
        f"in windows of {length_s:.3g} s the camera moves by {significant(1e3 * way_m, 3)} mm: "
        f"{significant(usual_px, 3)} px at {near_m:g} m, "
        f"{significant(focal_px * way_m / far_m, 3)} px at {far_m:g} m; "
        f"{significant(most_px, 3)} px in the best window",
        verdict=verdict, more=stereo if len(recording.rig) > 1 else "",
        series=Series(near_px, (begins_us + ends_us) / 2e6, TIME,
                      f"parallax at {near_m:g} m, px", (row.possible[0], row.usual[0])),
    )]  # fmt: skip


def _windows(recording: Recording, config: MapperConfig) -> tuple[Times, Times]:
    """Begins and ends of the windows that will be mapped, or of usual ones if none is asked for."""
    if config.slides:
        plan = plan_windows(recording, config)
        few = np.unique(np.linspace(0, len(plan) - 1, limits.MOST_WINDOWS).astype(np.int64))
        return plan.begins_us[few], plan.ends_us[few]
    asked = config.start_s is not None or config.duration_s is not None
    try:
        window = choose_window(recording, config)
    except InputError:
        if asked:
            raise
    else:
        if asked:
            return np.array([window.t0_us]), np.array([window.t1_us])
    return _usual_windows(recording)  # with gaps between poses each window by itself


def _usual_windows(recording: Recording) -> tuple[Times, Times]:
    """Windows of half a second over what poses cover, or one of all where that is shorter."""
    spans = spans_of(recording.trajectory.t_us)
    longest_us = max(last_us - first_us for first_us, last_us in spans)
    length_us = min(round(limits.USUAL_WINDOW_S * 1e6), max(longest_us, 1))
    count = int(np.clip(length_of(spans) // length_us, 1, limits.MOST_WINDOWS))
    begins_us = spread(spans, length_us, count)
    return begins_us, begins_us + length_us


def _across_m(recording: Recording, t0_us: int, t1_us: int) -> float:
    """How far camera 0 moves across its viewing direction at half time."""
    first_us, last_us = recording.trajectory.span_us
    t = np.clip(np.linspace(t0_us, t1_us, limits.SAMPLES), first_us, last_us).astype(np.int64)
    T_world_cam = recording.trajectory.at(t) @ recording.rig.T_body_cam[0]
    middle = T_world_cam[limits.SAMPLES // 2]
    offsets_m = (T_world_cam[:, :3, 3] - middle[:3, 3]) @ middle[:3, :3]
    # Forward motion has parallax as well, away from the middle of the image: half as much.
    across_m = np.hypot(np.linalg.norm(offsets_m[:, :2], axis=1), 0.5 * offsets_m[:, 2])
    return float(np.ptp(np.sign(np.arange(limits.SAMPLES) - limits.SAMPLES // 2) * across_m))
