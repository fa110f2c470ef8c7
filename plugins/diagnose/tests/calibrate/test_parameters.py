"""A vector of parameters alters a recording as its names say."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.plugins.diagnose.calibrate.parameters import NAMES, Correction, parameters_of
from point_world import edge_points, pinhole, stereo_rig, swinging
from refusals import refused

RECORDING = edge_points(swinging(), stereo_rig(pinhole(), 0.1, 3), points=50)


def corrected(**values):
    by_name = {one.name: one for one in parameters_of(tuple(NAMES), 3)}
    return Correction({by_name[k.replace("_", " ")]: v for k, v in values.items()}).applied(
        RECORDING
    )


def test_nothing_is_altered_by_default():
    same = Correction().applied(RECORDING)
    for ours, given in zip(same.rig.T_body_cam, RECORDING.rig.T_body_cam, strict=True):
        assert np.allclose(ours, given, atol=1e-15)
    assert same.trajectory is RECORDING.trajectory
    assert same.rig.cameras == RECORDING.rig.cameras


def test_stereo_rotation_turns_one_camera_in_place():
    rig = corrected(cam1_yaw=2.0).rig
    turn = RECORDING.rig.T_body_cam[1][:3, :3].T @ rig.T_body_cam[1][:3, :3]
    assert np.allclose(Rotation.from_matrix(turn).as_rotvec(degrees=True), [0, 2, 0])
    assert np.allclose(rig.T_body_cam[1][:3, 3], RECORDING.rig.T_body_cam[1][:3, 3])
    assert np.allclose(rig.T_body_cam[2], RECORDING.rig.T_body_cam[2])


def test_direction_keeps_the_length_and_length_the_direction():
    ahead = corrected(cam1_forward=3.0).rig.T_body_cam[1][:3, 3]
    assert np.linalg.norm(ahead) == pytest.approx(0.1)
    assert np.degrees(np.arctan2(ahead[2], ahead[0])) == pytest.approx(3)
    longer = corrected(cam2_baseline=5.0).rig.T_body_cam[2][:3, 3]
    assert np.allclose(longer, [0.21, 0, 0])


def test_hand_eye_moves_all_cameras_and_keeps_them_together():
    rig = corrected(**{"hand-eye_yaw": 1.0, "lever_x": 20.0}).rig
    moved = se3.inverse(RECORDING.rig.T_body_cam[0]) @ rig.T_body_cam[0]
    assert np.allclose(moved[:3, 3], [0.02, 0, 0])
    for k in (1, 2):
        before = se3.inverse(RECORDING.rig.T_body_cam[0]) @ RECORDING.rig.T_body_cam[k]
        assert np.allclose(se3.inverse(rig.T_body_cam[0]) @ rig.T_body_cam[k], before)


def test_clocks_are_added_to_events_and_poses():
    late = corrected(cam1_clock=2.5, pose_clock=-4.0)
    first_us = RECORDING.streams[1].t_us[100]
    before = RECORDING.events(1, first_us, first_us + 5000)
    after = late.events(1, first_us + 2500, first_us + 7500)
    assert (after.t_us == before.t_us + 2500).all()
    assert (late.events(0, 0, 10_000).t_us == RECORDING.events(0, 0, 10_000).t_us).all()
    assert (late.trajectory.t_us == RECORDING.trajectory.t_us - 4000).all()


def test_focal_length_scales_all_cameras():
    rig = corrected(focal_length=2.0).rig
    assert all(one.fx_px == pytest.approx(80 * 1.02) for one in rig.cameras)


def test_names_are_known_and_told():
    assert [one.name for one in parameters_of(("delay",), 1)] == ["pose clock"]
    assert [one.name for one in parameters_of(("delay",), 2)] == ["cam1 clock"]
    assert len(parameters_of(tuple(NAMES), 3)) == 2 * (3 + 1 + 2 + 1) + 1 + 1 + 6
    refused("choose from stereo, delay", parameters_of, ("stereo", "yaw"), 2)
    refused("refine is empty", parameters_of, (), 2)
    refused("needs a rig of 2 cameras", parameters_of, ("baseline",), 1)


def test_varied_clocks_keep_their_mean_on_the_poses_clock():
    one, two = parameters_of(("delay",), 3)
    so_far = Correction({one: 1.0})
    other = so_far.varied({one: 4.0, two: 3.0}, 3)
    assert other.clock_us(3) == (0, 4000, 3000)
    # Events 2 ms later in the mean, and poses as much
    assert other.trajectory(RECORDING.trajectory).t_us[0] == RECORDING.trajectory.t_us[0] + 2000
    assert so_far.varied({}, 3).trajectory(RECORDING.trajectory) is RECORDING.trajectory
