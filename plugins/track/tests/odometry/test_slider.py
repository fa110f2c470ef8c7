"""A real slider: one camera over all of its way and its stop, and pairs that turn back at once."""

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import track
from slid_laws import Law, Restamped
from slid_pair import SlidPair


@pytest.mark.slow
@pytest.mark.parametrize("baseline_m", [0.05, 0.1, 0.12])
def test_a_real_pair_that_turns_back_at_once_is_followed(shared_data, baseline_m):
    """From 0.64 m/s to as much the other way, which nothing before it announces."""
    pair = SlidPair(open_recording(shared_data / "slider_depth"), baseline_m)
    recording = Restamped(pair, Law(faster=2, back=True))
    tracked = track(recording)
    scores = score_poses(recording.trajectory, tracked.trajectory).values
    assert scores["ate_share"] < 0.5
    assert scores["scale_error"] < 1
    assert scores["time_covered"] > 98
    assert np.mean([status is Status.TRACKING for status in tracked.statuses]) > 0.8


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
