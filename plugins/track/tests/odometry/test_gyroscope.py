"""A gyroscope predicts turns: laws of the update, and a world that shakes too fast without one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import line_world
from eventsweep.emvs.data.tables import ImuSamples
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.motion import Gyroscope, Motion
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import track
from line_world import Wrapped, worst_m
from refusals import refused

T_BODY_IMU = se3.exp([0.1, 0.02, -0.05, 0.3, -1.2, 0.8])
CONFIG = line_world.CONFIG.model_copy(update={"gyroscope": True})
END_US = 400_000


def expected(seed=0):
    rng = np.random.default_rng(seed)
    spread = rng.normal(size=(12, 12)) * 0.05
    pose = se3.exp(rng.normal(size=6))
    now = Motion(0, pose, rng.normal(size=6), spread @ spread.T + 1e-6 * np.eye(12))
    return now.at(10_000)


def test_what_is_known_is_that_of_the_information_form():
    """Twin: information adds up, and the estimate is the weighted mean of both."""
    before, rate, sigma = expected(), np.array([0.4, -1.0, 2.0]), 0.07
    after = before.turning(rate, sigma)
    H = np.zeros((3, 12))
    H[:, 9:] = np.eye(3)
    information = np.linalg.inv(before.covariance) + H.T @ H / sigma**2
    np.testing.assert_allclose(after.covariance, np.linalg.inv(information), atol=1e-9)
    change = np.linalg.solve(information, H.T @ (rate - before.twist[3:])) / sigma**2
    np.testing.assert_allclose(after.twist, before.twist + change[6:], atol=1e-6)
    moved = se3.log(se3.inverse(after.T_world_body) @ before.T_world_body)
    np.testing.assert_allclose(moved, change[:6], atol=1e-6)


def samples_of(trajectory, rate_hz=1000, end_us=END_US, T_body_imu=T_BODY_IMU):
    """What an exact gyroscope in another frame reports along a trajectory."""
    t_us = np.arange(500, end_us - 1000, round(1e6 / rate_hz))
    before, after = trajectory.at(t_us - 500), trajectory.at(t_us + 500)
    turns = [se3.log(se3.inverse(a) @ b)[3:] / 1e-3 for a, b in zip(before, after, strict=True)]
    rates = np.array(turns) @ T_body_imu[:3, :3]
    return ImuSamples(t_us, rates, np.zeros_like(rates), T_body_imu)


@given(st.lists(st.integers(1, 30_000), min_size=1, max_size=30), st.integers(0, 300_000))
def test_a_rate_lies_between_its_neighbours_and_never_comes_from_later(steps, t_us):
    times = np.cumsum(steps).astype(np.int64)
    rates = np.c_[times, -times, np.zeros(len(times))].astype(float)
    gyroscope = Gyroscope()
    gyroscope.push(ImuSamples(times, rates, np.zeros_like(rates)))
    known_us = t_us + 5000
    rate = gyroscope.rate_at(t_us, known_us)
    earlier = times[times < known_us]
    near = earlier[np.abs(earlier - t_us) <= 20_000]
    if rate is None:
        before, after = earlier[earlier <= t_us][-1:], earlier[earlier > t_us][:1]
        assert max(np.abs(np.r_[before, after] - t_us), default=1 << 40) > 20_000
    else:
        assert near.min() <= rate[0] <= near.max()
        assert rate[1] == -rate[0]


def test_times_must_rise_and_memory_is_bounded():
    gyroscope, rates = Gyroscope(), np.zeros((2, 3))
    gyroscope.push(ImuSamples(np.array([10, 20]), rates, rates))
    refused("times must increase", gyroscope.push, ImuSamples(np.array([20, 30]), rates, rates))
    gyroscope.push(ImuSamples(np.empty(0, np.int64), rates[:0], rates[:0]))
    gyroscope.drop_before(15)
    assert len(gyroscope) == 1


class WithImu(Wrapped):
    """A recording with inertial samples."""

    has_imu = True

    def __init__(self, recording, samples):
        super().__init__(recording)
        self._samples = samples

    def imu(self):
        return self._samples


@pytest.mark.slow
def test_tracking_with_a_gyroscope_is_as_good_and_goes_on_where_it_ends():
    recording = line_world.swaying(END_US)
    trajectory = recording.trajectory
    whole = samples_of(trajectory)
    ended = samples_of(trajectory, end_us=300_000)
    for samples in (whole, ended):
        tracked = track(WithImu(recording, samples), CONFIG)
        assert {*tracked.statuses} == {Status.TRACKING}
        assert tracked.covered > 0.9
        assert worst_m(tracked.trajectory, trajectory) < 0.006
    refused("has no inertial samples", track, recording, CONFIG)
    without = track(recording, CONFIG.model_copy(update={"gyroscope": False}))
    assert not np.array_equal(without.trajectory.positions_m, tracked.trajectory.positions_m)
    wrong = replace(whole, T_body_imu=np.eye(4))  # the frame of the samples matters
    assert np.abs(whole.gyro_rad_s @ T_BODY_IMU[:3, :3].T - wrong.gyro_rad_s).max() > 0.1
