"""A vector of parameters alters a recording as its names say."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.plugins.diagnose.check.alternatives import amounts
from eventsweep.plugins.diagnose.parameters import ROWS, Correction, parameters_of
from point_world import edge_points, pinhole, stereo_rig, swinging
from refusals import refused

RECORDING = edge_points(swinging(), stereo_rig(pinhole(), 0.1, 3), points=50)


def corrected(**values):
    by_name = {parameter.name: parameter for parameter in parameters_of(tuple(ROWS), 3)}
    values = {by_name[k.replace("_", " ")]: v for k, v in values.items()}
    return Correction(values).applied(RECORDING)


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
    assert all(camera.fx_px == pytest.approx(80 * 1.02) for camera in rig.cameras)


def test_names_stand_for_parameters():
    assert [parameter.name for parameter in parameters_of(("delay",), 1)] == ["pose clock"]
    assert [parameter.name for parameter in parameters_of(("delay",), 2)] == ["cam1 clock"]
    assert len(parameters_of(tuple(ROWS), 3)) == 2 * (3 + 1 + 2 + 1) + 1 + 1 + 6


@pytest.mark.parametrize(("names", "cameras", "words"), [
    (("stereo", "yaw"), 2, "choose from stereo, delay"), ((), 2, "refine is empty"),
    (("baseline",), 1, "needs a rig of 2 cameras"),
])  # fmt: skip
def test_names_that_stand_for_none_are_refused(names, cameras, words):
    refused(words, parameters_of, names, cameras)


@pytest.mark.parametrize(("name", "kind", "value", "unit"), [
    ("pose-delay", "pose clock", -4.0, 1.0), ("delay", "cam1 clock", 2.5, 1.0),
    ("stereo", "cam1 yaw", 2.0, 1.0), ("hand-eye", "hand-eye yaw", 2.0, 1.0),
    ("baseline", "cam1 baseline", 5.0, 0.01), ("focal", "focal length", 2.0, 0.01),
])  # fmt: skip
def test_an_amount_of_a_check_changes_a_recording_as_the_correction_does(name, kind, value, unit):
    pair = edge_points(swinging(), stereo_rig(pinhole(), 0.1), points=50)
    parameter = next(p for p in parameters_of((name,), 2) if p.name == kind)
    tried = amounts(name)
    amount = tried[1] if len(tried) == 3 else tried[0]  # about y
    by = 1 + value * unit if amount.is_factor else value
    told, corrected = amount.change(pair, by), Correction({parameter: value}).applied(pair)
    np.testing.assert_allclose(told.rig.T_body_cam, corrected.rig.T_body_cam, atol=1e-12)
    assert [c.fx_px for c in told.rig.cameras] == [c.fx_px for c in corrected.rig.cameras]
    assert (told.trajectory.t_us == corrected.trajectory.t_us).all()
    for camera in (0, 1):
        a, b = (r.events(camera, 200_000, 300_000).t_us for r in (told, corrected))
        assert len(a)
        assert (a == b).all()


def test_varied_clocks_keep_their_mean_on_the_poses_clock():
    first, second = parameters_of(("delay",), 3)
    so_far = Correction({first: 1.0})
    other = so_far.varied({first: 4.0, second: 3.0}, 3)
    assert other.clock_us(3) == (0, 4000, 3000)
    # Events 2 ms later in the mean, and poses as much
    assert other.trajectory(RECORDING.trajectory).t_us[0] == RECORDING.trajectory.t_us[0] + 2000
    assert so_far.varied({}, 3).trajectory(RECORDING.trajectory) is RECORDING.trajectory
