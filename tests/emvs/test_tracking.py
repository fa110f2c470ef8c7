"""Mapping with a source of poses that learns them as it goes."""

import pytest

import point_world as world
from depth_maps import assert_same_bits
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.windows import Window, choose_window
from refusals import refused

CONFIG = MapperConfig(methods=("Alg1/H",), planes=30, min_depth_m=1.0, max_depth_m=4.0)
STEP_US = 100_000


class Follower:
    """Knows the true poses, but only up to what it was fed."""

    def __init__(self, truth):
        self._truth, self.until_us = truth, 0

    def known(self):
        keep = self._truth.t_us <= self.until_us
        return Trajectory(
            self._truth.t_us[keep], self._truth.positions_m[keep], self._truth.quats_xyzw[keep]
        )


@pytest.fixture
def recording():
    return world.fronto_parallel(2.0)


def window_until(t_us):
    return Window(t_us - STEP_US, t_us, t_us - STEP_US // 2, (0, 0))


def test_maps_of_a_tracker_are_those_of_its_poses(recording):
    """Tracked and mapped in turns: the same bits as with the whole trajectory at hand."""
    tracker = Follower(recording.trajectory)
    tracked = AlteredRecording(recording, trajectory=tracker)
    for t_us in range(STEP_US, 500_001, STEP_US):
        tracker.until_us = t_us
        mapped, whole = (
            map_window(source, CONFIG, window=window_until(t_us)).depth_maps["Alg1/H"]
            for source in (tracked, recording)
        )
        assert_same_bits(mapped, whole)
        assert mapped.points > 50


def test_windows_go_as_far_as_poses_are_known(recording):
    tracker = Follower(recording.trajectory)
    tracked = AlteredRecording(recording, trajectory=tracker)
    for t_us in (200_000, 400_000):
        tracker.until_us = t_us
        assert choose_window(tracked, CONFIG).t1_us == t_us + 1
        assert sum(choose_window(tracked, CONFIG).left_out) > 0
    refused("poses", map_window, tracked, CONFIG, window=window_until(500_000))
