"""Turn rates of events and poses: measured per window, and matched."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.plugins.diagnose.calibrate.angular_velocity import (
    PoseTurns,
    TurnRates,
    align,
    camera_turn_rates,
    turn_rates,
)
from eventsweep.plugins.diagnose.calibrate.objective import Objective
from eventsweep.plugins.diagnose.parameters import Correction, parameters_of
from eventsweep.plugins.diagnose.windows import WindowPlan, read_windows
from point_world import edge_points, pinhole, stereo_rig, swinging

RECORDING = edge_points(
    swinging((12.0, 14.0, 10.0)), stereo_rig(pinhole(120, 90, 100.0)), points=500
)
WINDOWS = read_windows(RECORDING, WindowPlan(10, 0.1, 6000))
OBJECTIVE = Objective(RECORDING, WINDOWS, RECORDING.depth_range_m)
POSE_CLOCK, *HAND_EYE = parameters_of(("pose-delay", "hand-eye"), 2)[:4]


def test_turn_rates_of_poses_are_their_mean_rotation():
    hypothesis = OBJECTIVE.hypothesis(Correction())
    for window, rate in zip(WINDOWS, camera_turn_rates(WINDOWS, hypothesis), strict=True):
        first, last = RECORDING.trajectory.at(np.array([window.t0_us, window.t1_us]))[:, :3, :3]
        turn = Rotation.from_matrix(first.T @ last).as_rotvec()
        assert np.allclose(rate, turn / (1e-6 * (window.t1_us - window.t0_us)))


@pytest.mark.slow
def test_events_turn_as_fast_as_the_poses_where_those_are_right():
    rates = turn_rates(OBJECTIVE, Correction(), np.radians(4))
    assert np.degrees(np.sqrt(((rates.events - rates.poses) ** 2).mean())) < 1.5
    assert np.degrees(np.abs(rates.poses)).max() > 50


WIDE = np.r_[20.0, np.radians([10.0] * 3)]


def rates_of(turns, lag_s, rotvec, noise=0.0):
    """Turn rates of events whose poses lag and whose camera is turned."""
    rng = np.random.default_rng(0)
    seen = turns.at(lag_s, rotvec)
    return TurnRates(
        seen + noise * rng.normal(size=seen.shape), turns.at(0, np.zeros(3)),
        np.array([np.eye(3)] * len(seen)),
    )  # fmt: skip


def test_lag_and_rotation_are_found_exactly_in_exact_rates():
    turns = PoseTurns(WINDOWS, OBJECTIVE.hypothesis(Correction()))
    exact = rates_of(turns, 0.017, np.radians([3.0, -2.0, 1.0]))
    matched = align(exact, turns, np.zeros(4), WIDE)
    assert matched[0] == pytest.approx(17, abs=0.02)
    assert np.degrees(matched[1:]) == pytest.approx([3, -2, 1], abs=2e-2)


@pytest.mark.parametrize("held", [0, 2])
def test_what_is_not_asked_for_stays(held):
    turns = PoseTurns(WINDOWS, OBJECTIVE.hypothesis(Correction()))
    rotvec, spread = np.radians([3.0, 0.0, 1.0]), WIDE.copy()
    spread[held] = 0
    matched = align(rates_of(turns, 0.017 * (held > 0), rotvec), turns, np.zeros(4), spread)
    assert matched[held] == 0
    assert np.degrees(matched[1:]) == pytest.approx([3, 0, 1], abs=0.1)


def test_where_nothing_turns_the_calibration_as_given_is_believed():
    """Noise of 10 deg/s, motion of 0.1: without the belief, lag and rotation were anything."""
    turns = PoseTurns(WINDOWS, OBJECTIVE.hypothesis(Correction()))
    full = turns.at
    turns.at = lambda lag_s, rotvec: 1e-3 * full(lag_s, rotvec)
    noisy = rates_of(turns, 0.0, np.zeros(3), noise=np.radians(10))
    so_far = np.r_[3.0, np.radians([1.0, -1.0, 0.5])]
    matched = align(noisy, turns, so_far, np.r_[20.0, np.radians([2.0] * 3)])
    assert np.degrees(matched[1:] + so_far[1:]) == pytest.approx(np.zeros(3), abs=0.1)
    assert matched[0] + so_far[0] == pytest.approx(0, abs=1)


@pytest.mark.slow
def test_a_spoilt_clock_and_hand_eye_are_nearly_mended_by_rates_alone():
    spoilt = Correction.of([POSE_CLOCK, *HAND_EYE], [12.0, 1.0, -1.0, 0.5])
    rates = turn_rates(OBJECTIVE, spoilt, np.radians(4))
    turns = PoseTurns(WINDOWS, OBJECTIVE.hypothesis(spoilt))
    matched = align(rates, turns, np.zeros(4), np.r_[20.0, np.radians([2.0] * 3)])
    assert matched[0] == pytest.approx(-12, abs=5)
