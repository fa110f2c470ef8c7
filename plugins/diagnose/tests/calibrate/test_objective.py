"""The objective: its levels, what it prefers, and the windows that it looks at."""

from itertools import pairwise

import numpy as np
import pytest

from eventsweep.plugins.diagnose.calibrate.before_after import epipolar_residuals_px
from eventsweep.plugins.diagnose.calibrate.objective import COARSE, FINE, MIDDLE, Objective
from eventsweep.plugins.diagnose.parameters import Correction, parameters_of
from eventsweep.plugins.diagnose.windows import WindowPlan, read_windows
from point_world import edge_points, pinhole, stereo_rig, swinging

RECORDING = edge_points(swinging(), stereo_rig(pinhole(), 0.1), points=400)
WINDOWS = read_windows(RECORDING, WindowPlan(4, 0.15, 2000))


def test_the_truth_is_sharper_than_what_is_wrong():
    objective = Objective(RECORDING, WINDOWS, RECORDING.depth_range_m)
    for level in (FINE, MIDDLE, COARSE):
        function = objective.at(level)
        truth = function(Correction())
        for parameter in parameters_of(("stereo", "delay", "baseline", "pose-delay"), 2):
            for sign in (1, -1):
                wrong = function(Correction({parameter: sign * parameter.reach}))
                assert wrong.mean() < truth.mean(), (level, parameter.name)


def test_each_window_may_be_told_otherwise():
    objective = Objective(RECORDING, WINDOWS, RECORDING.depth_range_m)
    pitch = parameters_of(("stereo",), 2)[0]
    right, wrong = (objective.hypothesis(Correction({pitch: value})) for value in (0.0, 2.0))
    mixed = objective.sharpness([right, wrong, right, wrong])
    assert (mixed[::2] == objective(Correction())[::2]).all()
    assert (mixed[1::2] == objective(Correction({pitch: 2.0}))[1::2]).all()


def test_windows_lie_where_the_camera_travels_farthest():
    plan = WindowPlan(3, 0.1, 500)
    windows = read_windows(RECORDING, plan)
    assert len(windows) == 3
    assert all(len(window.events[0]) <= 500 for window in windows)
    first_us, last_us = RECORDING.trajectory.span_us
    assert windows[0].t0_us >= first_us + plan.margin_us
    assert windows[-1].t1_us <= last_us - plan.margin_us
    assert all(a.t0_us < b.t0_us for a, b in pairwise(windows))


@pytest.mark.parametrize("rate_deg_s", [40.0, 100.0, 250.0])
def test_windows_are_shorter_and_more_where_the_camera_turns_fast(rate_deg_s):
    rolling = swinging(turn_deg=(0, 0, rate_deg_s / 2), even=True)
    quick = edge_points(rolling, stereo_rig(pinhole()), points=500)
    windows = read_windows(quick, WindowPlan(3, 0.2, 500))
    length_s = 1e-6 * (windows[0].t1_us - windows[0].t0_us)
    assert length_s == pytest.approx(min(0.2, 10 / max(rate_deg_s, 1)), rel=0.02)
    assert len(windows) >= 3
    assert len(windows) <= 24


@pytest.mark.parametrize("pitch_deg", [0.0, 0.8])
def test_epipolar_rows_miss_by_as_much_as_a_camera_is_pitched(pitch_deg):
    rig = stereo_rig(pinhole(160, 120, 140.0), 0.05)
    recording = edge_points(swinging(turn_deg=(3, 3, 3)), rig, points=900)
    pitch = parameters_of(("stereo",), 2)[0]
    changed = Correction({pitch: pitch_deg}).applied(recording)
    missed_px = epipolar_residuals_px(changed, 600_000, 0.7)
    assert len(missed_px) > 5
    assert abs(np.median(missed_px)) == pytest.approx(140 * np.radians(pitch_deg), abs=0.6)
