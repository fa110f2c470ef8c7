"""A real recording of one camera: tracked from a first map over all of its way and its stop."""

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import track


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
