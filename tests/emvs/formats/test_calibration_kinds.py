"""Calibrations used whole or refused: pairs, places on an IMU, rounding, other programs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration_files import TURN, aslam, chain, dv, euroc, lens_of_ros, table, written
from eventsweep.emvs.formats.calibration import left_out, read_rig
from eventsweep.emvs.formats.calibration_values import matrix
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from refusals import refused

ON_IMU = se3.from_rotation(Rotation.from_euler("xyz", (90, 10, 3), degrees=True), (0.02, 0.05, 0))


@pytest.mark.parametrize("key", ["T_cam_imu", "T_imu_cam"])
def test_a_chain_with_places_on_an_imu_alone_is_a_rig(tmp_path, key):
    values = chain()
    T_imu_cam = [ON_IMU, ON_IMU @ TURN, ON_IMU @ TURN @ TURN]
    for entry, T in zip(values.values(), T_imu_cam, strict=True):
        entry[key] = (T if key == "T_imu_cam" else se3.inverse(T)).tolist()
    made = read_rig(written(tmp_path / "c.yaml", values))
    for found, T in zip(made.T_body_cam, (np.eye(4), TURN, TURN @ TURN), strict=True):
        np.testing.assert_allclose(found, T, atol=1e-12)
    del values["cam1"]  # a gap hides nothing where each place is known
    made = read_rig(written(tmp_path / "c.yaml", values))
    assert made.camera_names == ("cam0", "cam2")
    np.testing.assert_allclose(made.T_body_cam[1], TURN @ TURN, atol=1e-12)


def test_a_gap_in_a_chain_is_refused_and_either_side_read_alone(tmp_path):
    values = chain()
    values["cam1"]["T_cn_cnm1"] = values["cam2"]["T_cn_cnm1"] = TURN.tolist()
    del values["cam1"]
    path = written(tmp_path / "c.yaml", values)
    refused("where cam2 stands is not known: cam1 is missing", read_rig, path)
    assert read_rig(path, ["cam2"]).camera_names == ("cam2",)


@pytest.mark.parametrize("right_first", [False, True])
@pytest.mark.parametrize("baseline_m", [0.0, 0.102])
def test_two_files_of_a_pair_make_a_rig(tmp_path, baseline_m, right_first):
    left = written(tmp_path / "left.yaml", lens_of_ros(TURN))
    right = written(tmp_path / "right.yaml", lens_of_ros(TURN, baseline_m))
    made = read_rig([right, left] if right_first else [left, right])
    T_first_second = TURN if right_first else se3.inverse(TURN)
    np.testing.assert_allclose(made.T_body_cam[1], T_first_second, atol=1e-12)
    assert "T_right_left" in left_out(right)


@pytest.mark.parametrize(("files", "words"), [
    ([lens_of_ros(), lens_of_ros()], "do not say how their cameras stand"),
    ([lens_of_ros(TURN), lens_of_ros(TURN @ TURN)], "T_right_left differs"),
    ([lens_of_ros(TURN), lens_of_ros(TURN, 100.0)], "baseline in projection_matrix 100 m"),
    ([lens_of_ros(TURN), chain()], "not a file of one camera"),
])  # fmt: skip
def test_files_that_make_no_pair_are_refused(tmp_path, files, words):
    paths = [
        written(tmp_path / f"{side}.yaml", values)
        for side, values in zip(("left", "right"), files, strict=True)
    ]
    refused([words, paths[0]], read_rig, paths)


def test_a_pair_without_sides_is_refused(tmp_path):
    paths = [written(tmp_path / f"{k}.yaml", lens_of_ros(TURN)) for k in range(2)]
    refused("which camera is the right one", read_rig, paths)


def test_ros_and_euroc_place_two_files(tmp_path):
    ros = [written(tmp_path / f"r{k}.yaml", lens_of_ros(baseline_m=0.1 * k)) for k in range(2)]
    np.testing.assert_allclose(read_rig(ros).T_body_cam[1][:3, 3], (0.1, 0, 0), atol=1e-12)
    assert "baseline of 0.1 m" in left_out(ros[1])
    assert not left_out(ros[0])
    places = [ON_IMU, ON_IMU @ TURN]
    paths = [written(tmp_path / f"e{k}.yaml", euroc(T)) for k, T in enumerate(places)]
    np.testing.assert_allclose(read_rig(paths).T_body_cam[1], TURN, atol=1e-9)


@pytest.mark.parametrize(("name", "values", "model"), [
    ("a.yaml", aslam(ON_IMU, ON_IMU @ TURN), "kb4"), ("d.json", dv(), "radtan"),
    ("e.yaml", euroc(ON_IMU), "radtan"),
    ("m.yaml", {"height": 48, "width": 64, "distortion_model": "plumb_bob",
                "D": [-0.1, 0.01, 0, 0, 0], "K": [50, 0, 32, 0, 51, 24, 0, 0, 1]}, "radtan"),
])  # fmt: skip
def test_other_programs_files_are_read(tmp_path, name, values, model):
    made = read_rig(written(tmp_path / name, values))
    camera = made.cameras[0]
    assert (camera.width_px, camera.height_px, camera.model) == (64, 48, model)
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (50, 51, 32, 24)
    assert camera.distortion[0] == -0.1
    if len(made) > 1:
        np.testing.assert_allclose(made.T_body_cam[1], TURN, atol=1e-9)


@pytest.mark.parametrize(("name", "values", "words"), [
    ("d.json", dv(2), "transformationToC0 of dv-processing is not read"),
    ("o.yaml", {"Camera1.fx": 3.0}, "an ORB-SLAM settings file"),
    ("v.yaml", {"model_type": "PINHOLE", "projection_parameters": {}}, "camodocal"),
    ("s.yaml", {"M1": table(np.eye(3), 3), "D1": table([0.0])}, "OpenCV's stereo calibration"),
    ("p.json", {"K": [1.0] * 9, "D": [0.0] * 5, "img_size": [64, 48]}, "Metavision"),
    ("x.yaml", {"nothing": 1}, "contains no camera: needs a Kalibr"),
    ("j.json", {"name": "r", "cameras": [{"name": "c"}]}, "rig calibration: an entry is missing"),
])  # fmt: skip
def test_other_kinds_are_refused_by_their_name(tmp_path, name, values, words):
    path = written(tmp_path / name, values)
    refused([words, path], read_rig, path)


def test_rounded_rotations_become_rotations_and_others_say_by_how_much():
    for decimals in (4, 5, 7):
        found = matrix(np.round(TURN, decimals).tolist(), "T")
        assert se3.is_rigid(found)
        np.testing.assert_allclose(found, TURN, atol=2 * 10.0**-decimals)
    assert matrix(TURN.tolist(), "T").tolist() == TURN.tolist()  # exact ones stay as they are
    for wrong, words in (
        (np.diag([1.01, 1, 1, 1]), "differs from 1 by 0.02, at most 0.001"),
        (np.diag([-1.0, 1, 1, 1]), "mirrored"),
        (np.eye(4) + np.diag([1.0, 0, 0], -1), "last row|differs"),
        (np.eye(3), r"shape \(3, 3\)"),
        (np.full((4, 4), np.nan), "not finite"),
    ):
        refused(["T is not a rigid motion", words], matrix, wrong.tolist(), "T")


def test_a_rig_json_written_by_hand_may_be_rounded():
    camera = {"name": "c", "width_px": 64, "height_px": 48, "fx_px": 50.0, "fy_px": 51.0,
              "cx_px": 32.0, "cy_px": 24.0}  # fmt: skip
    values = {"name": "r", "cameras": [{**camera, "T_body_cam": np.round(TURN, 4).tolist()}]}
    assert se3.is_rigid(Rig.from_json(values).T_body_cam[0], 1e-12)
    values["cameras"][0]["T_body_cam"] = np.round(TURN, 2).tolist()
    refused("not a rigid motion .R R.T differs from 1 by", Rig.from_json, values)
