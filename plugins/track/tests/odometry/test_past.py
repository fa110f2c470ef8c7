"""Poses before the stretch of the first map: found when that map comes late."""

import numpy as np
import pytest

import line_world
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import track
from eventsweep.plugins.track.odometry.start import LONGEST_START_US, begin
from eventsweep.plugins.track.odometry.trust import UNCONFIRMED
from line_world import CONFIG, Wrapped, tracker_of, worst_m

END_US = 650_000
STILL_US = 600_000


@pytest.fixture(scope="module")
def recording():
    return line_world.swaying(END_US)


@pytest.fixture
def late(monkeypatch):
    """Nothing begins before 0.6 s."""

    def begin_late(arrived, batches, *rest):
        if batches[-1].t_us < END_US - 100_000:
            return "nothing to see yet"
        return begin(arrived, batches, *rest)

    monkeypatch.setattr("eventsweep.plugins.track.odometry.beginning.begin", begin_late)


def test_poses_begin_with_the_events_however_late_the_first_map_is(recording, late):
    """Law: no pose is missing at the start, and those before the first map are true."""
    start = se3.exp([0.3, -0.2, 0.1, 0.2, 0.1, -0.3])
    tracked = track(recording, CONFIG, T_world_body=start)
    poses, truth = tracked.trajectory, recording.trajectory
    assert poses.t_us[0] < 20_000
    assert tracked.covered > 0.93
    assert np.diff(poses.t_us).max() <= 25_000
    np.testing.assert_allclose(poses.at(poses.t_us[0]), start, atol=1e-12)
    assert tracked.changes[-1].reason == UNCONFIRMED  # nothing is left for a second map
    assert tracked.changes[-1].t_us < 20_000
    assert worst_m(poses, truth, -1) < 0.008


def test_a_tracker_that_is_pushed_cannot_look_back(recording, late):
    tracker, poses = tracker_of(recording)
    tracker.push([recording.events(k, 0, END_US) for k in (0, 1)], END_US)
    assert END_US - LONGEST_START_US - 100_000 < poses[0].t_us < END_US - 300_000


class After(Wrapped):
    """A recording after a time in which hardly a pixel fires, now and then with a neighbour."""

    def event_span_us(self, camera):
        return 0, self._recording.event_span_us(camera)[1] + STILL_US

    def events(self, camera, t0_us, t1_us):
        t_us = np.repeat(np.arange(0, STILL_US, 10_000), 2)
        x = (20 + np.arange(len(t_us)) % 2).astype(np.uint16)
        noise = Events(x, np.full_like(x, 30), t_us, np.ones(len(t_us), np.uint8))
        rest = self._recording.events(camera, t0_us - STILL_US, t1_us - STILL_US)
        return Events.concat([noise.between(t0_us, t1_us), rest.shifted(STILL_US)])


def test_who_stands_still_at_first_was_there_all_the_time(recording):
    tracked = track(After(recording), CONFIG)
    before = tracked.trajectory.t_us < STILL_US - 40_000
    assert tracked.trajectory.t_us[0] < 50_000
    assert {s for s, b in zip(tracked.statuses, before, strict=True) if b} == {Status.STILL}
    assert tracked.covered > 0.93
    there = tracked.trajectory.at(tracked.trajectory.t_us[before])
    np.testing.assert_allclose(there, np.broadcast_to(np.eye(4), there.shape), atol=1e-12)
