"""Turn rates of events and poses: measured per window, and matched."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from emvs.calibrate.angular_velocity import (
    PoseTurns,
    TurnRates,
    align,
    camera_turn_rates,
    turn_rates,
)
from emvs.calibrate.objective import Objective
from emvs.calibrate.parameters import Correction, parameters_of
from emvs.calibrate.windows import WindowPlan, read_windows
from point_world import edge_points, pinhole, stereo_rig, swinging

RECORDING = edge_points(
    swinging((12.0, 14.0, 10.0)), stereo_rig(pinhole(120, 90, 100.0)), points=500
)
WINDOWS = read_windows(RECORDING, WindowPlan(10, 0.1, 6000))
OBJECTIVE = Objective(RECORDING, WINDOWS, RECORDING.depth_range_m)
POSE_CLOCK, *HAND_EYE = parameters_of(("pose-delay", "hand-eye"), 2)[:4]


def test_poses_turn_as_fast_as_they_say():
    told = OBJECTIVE.told(Correction())
    for window, rate in zip(WINDOWS, camera_turn_rates(WINDOWS, told), strict=True):
        first, last = RECORDING.trajectory.at(np.array([window.t0_us, window.t1_us]))[:, :3, :3]
        turn = Rotation.from_matrix(first.T @ last).as_rotvec()
        assert np.allclose(rate, turn / 0.1)


def test_events_turn_as_fast_as_the_poses_where_those_are_right():
    rates = turn_rates(OBJECTIVE, Correction(), np.radians(4))
    assert np.degrees(np.sqrt(((rates.events - rates.poses) ** 2).mean())) < 1.5
    assert np.degrees(np.abs(rates.poses)).max() > 50


def test_lag_and_rotation_are_found_exactly_in_exact_rates():
    told = OBJECTIVE.told(Correction())
    turns = PoseTurns(WINDOWS, told)
    rotvec = np.radians([3.0, -2.0, 1.0])
    exact = TurnRates(turns.at(0.017, rotvec), turns.at(0, np.zeros(3)), np.array([np.eye(3)] * 10))
    found = align(exact, turns, 0.04, lag=True, turn=True)
    assert found.lag_s == pytest.approx(0.017, abs=1e-5)
    assert np.degrees(found.rotvec) == pytest.approx([3, -2, 1], abs=1e-2)
    assert np.degrees(found.residual).max() < 0.01


def test_a_rotation_is_undetermined_where_nothing_turns():
    told = OBJECTIVE.told(Correction())
    turns = PoseTurns(WINDOWS, told)
    still = TurnRates(np.zeros((10, 3)), np.zeros((10, 3)), np.array([np.eye(3)] * 10))
    turns.at = lambda lag_s, rotvec: np.zeros((10, 3))
    found = align(still, turns, 0.0, lag=False, turn=True)
    assert np.isinf(found.covariance[1:, 1:]).all()


def test_a_spoilt_clock_and_hand_eye_are_nearly_mended_by_rates_alone():
    spoilt = Correction.of([POSE_CLOCK, *HAND_EYE], [12.0, 1.0, -1.0, 0.5])
    rates = turn_rates(OBJECTIVE, spoilt, np.radians(4))
    turns = PoseTurns(WINDOWS, OBJECTIVE.told(spoilt))
    found = align(rates, turns, 0.04, lag=True, turn=True)
    assert 1e3 * found.lag_s == pytest.approx(-12, abs=5)
