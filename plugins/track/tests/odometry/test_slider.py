"""A real slider: one camera over all of its way and its stop, and pairs that turn back at once."""

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import track
from eventsweep.plugins.track.odometry.trust import ASTRAY
from slid_pair import SlidPair


class ThereAndBack(DerivedRecording):
    """A recording at a multiple of its speed, and then backwards: the same events, restamped."""

    def __init__(self, recording, faster):
        super().__init__(recording)
        (first_us, last_us), path = recording.event_span_us(0), recording.trajectory
        inside = (path.t_us >= first_us) & (path.t_us <= last_us)

        def restamped(t_us):
            forth_us = np.rint(first_us + (t_us - first_us) / faster).astype(np.int64)
            return np.concatenate([forth_us, 2 * forth_us[-1] - forth_us[::-1]])

        def twice(values):
            return np.concatenate([values, values[::-1]])

        self._streams = []
        for camera in range(len(recording.rig)):
            e = recording.events(camera, first_us, last_us)
            polarity = np.concatenate([e.p, 1 - e.p[::-1]]).astype(e.p.dtype)
            self._streams.append(Events(twice(e.x), twice(e.y), restamped(e.t_us), polarity))
        t_us = restamped(path.t_us[inside])
        rises = np.concatenate([[True], np.diff(t_us) > 0])
        places, quats = (twice(each[inside])[rises] for each in (path.positions_m, path.quats_xyzw))
        self._path = Trajectory(t_us[rises], places, quats)

    @property
    def trajectory(self):
        return self._path

    def event_span_us(self, camera):
        return int(self._path.t_us[0]), int(min(e.t_us[-1] for e in self._streams))

    def events(self, camera, t0_us, t1_us):
        return self._streams[camera].between(t0_us, t1_us)


@pytest.mark.slow
@pytest.mark.parametrize("baseline_m", [0.05, 0.1])
def test_a_real_pair_that_turns_back_at_once_is_followed(shared_data, baseline_m):
    """From 0.64 m/s to as much the other way, which nothing before it announces."""
    pair = SlidPair(open_recording(shared_data / "slider_depth"), baseline_m)
    recording = ThereAndBack(pair, 2.0)
    tracked = track(recording)
    scores = score_poses(recording.trajectory, tracked.trajectory).values
    assert scores["ate_share"] < 0.5
    assert scores["scale_error"] < 1
    assert scores["time_covered"] > 98
    assert np.mean([status is Status.TRACKING for status in tracked.statuses]) > 0.8


@pytest.mark.slow
def test_a_real_pair_that_is_led_astray_says_so(shared_data, monkeypatch):
    """The same, by a tracker that expects of every motion that it goes on as it was."""
    monkeypatch.setattr(Motion, "surprise", lambda *_: 0.0)
    pair = SlidPair(open_recording(shared_data / "slider_depth"), 0.04)
    recording = ThereAndBack(pair, 2.0)
    tracked = track(recording)
    scores = score_poses(recording.trajectory, tracked.trajectory).values
    assert scores["ate_share"] > 5
    said = np.array([status is Status.TRACKING for status in tracked.statuses])
    path = tracked.trajectory
    sure = Trajectory(path.t_us[said], path.positions_m[said], path.quats_xyzw[said])
    scores = score_poses(recording.trajectory, sure).values
    assert scores["ate_share"] < 2
    assert scores["scale_error"] < 3
    assert any(change.reason == ASTRAY for change in tracked.changes)


@pytest.mark.slow
def test_one_camera_keeps_its_way_and_its_scale_on_a_real_slider(shared_data):
    recording = open_recording(shared_data / "slider_depth")
    start_s = (recording.trajectory.span_us[0] - recording.event_span_us(0)[0]) / 1e6
    config = MapperConfig(methods=("Focus/cam0",), start_s=start_s, duration_s=0.3)
    first_map = map_window(recording, config).depth_maps["Focus/cam0"]
    tracked = track(recording, first_map=first_map)
    assert Status.LOST not in {change.status for change in tracked.changes}
    scores = score_poses(recording.trajectory, tracked.trajectory).values
    assert scores["ate_share"] < 1.2
    assert scores["scale_error"] < 4
    assert scores["time_covered"] > 98
    assert np.ptp(tracked.trajectory.positions_m, axis=0).max() > 0.9
