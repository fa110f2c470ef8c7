"""Checks of the motion: without parallax there is no depth, whatever the method.

A point at depth Z moves by f b / Z pixels while the camera moves by b across its viewing direction.
Turning adds none. A window whose nearest points move by less than a pixel has no depth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError, significant
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.windows import choose_window, plan_windows
from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.findings import TIME, Finding, Series, judged
from eventsweep.plugins.diagnose.check.limits import LIMITS

Times = NDArray[np.int64]


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
    if config.slides:
        plan = plan_windows(recording, config)
        few = np.unique(np.linspace(0, len(plan) - 1, limits.MOST_WINDOWS).astype(np.int64))
        return plan.begins_us[few], plan.ends_us[few]
    try:
        window = choose_window(recording, config)
    except InputError:
        if config.start_s is not None or config.duration_s is not None:
            raise
        return _usual_windows(recording)  # gaps between poses: each window by itself
    if config.start_s is not None or config.duration_s is not None:
        return np.array([window.t0_us]), np.array([window.t1_us])
    return _usual_windows(recording)


def _usual_windows(recording: Recording) -> tuple[Times, Times]:
    """Windows of half a second over what poses cover, or one of all where that is shorter."""
    first_us, last_us = recording.trajectory.span_us
    length_us = min(round(limits.USUAL_WINDOW_S * 1e6), max(last_us - first_us, 1))
    count = int(np.clip((last_us - first_us) // length_us, 1, limits.MOST_WINDOWS))
    begins_us = np.linspace(first_us, last_us - length_us, count).astype(np.int64)
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
