"""Rigs: named ones, and calibration files read, refused, and compared with OpenCV."""

import copy
import json
import math
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.formats.calibration_values import parsed
from eventsweep.emvs.geometry import se3
from eventsweep.sim.rigs import RIGS, rig
from places import SHARED
from refusals import refused

DATA = SHARED / "data"
TUMVIE = "tumvie/camera-calibrationA.json"
MVSEC = "mvsec/camchain-imucam-indoor_flying.yaml"
DSEC = "dsec/zurich_city_04_a/cam_to_cam.yaml"
FILES = {
    "tumvie-kb4": (TUMVIE, (0.1184, 0.1185)),
    "mvsec": (MVSEC, (0.0998, 0.0999)),
    "dsec": (DSEC, (0.59, 0.61)),
}
REAL = {**FILES, "tumvie-b": ("tumvie/camera-calibrationB.json", (0.1188, 0.1189))}
"""Rig B is 0.35 mm wider than rig A: the distance of its two `T_imu_cam` is 11.88 cm."""
TURN = se3.from_quat_xyzw(
    np.array([-0.1, 0.002, 0.0]), np.array([0, np.sin(0.01), 0, np.cos(0.01)])
)


def basalt() -> dict:
    """A file like TUM-VIE's, with four cameras 10 cm apart."""
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
    lens = dict(zip(names, (500, 501, 320, 200, 0.1, 0, 0, 0), strict=True))
    turn = {"qx": 0.0, "qy": 0.0, "qz": 0.6, "qw": 0.8}
    places = [{"px": 0.1 * k, "py": 0.0, "pz": 0.0, **turn} for k in range(4)]
    return {
        "value0": {
            "T_imu_cam": places,
            "intrinsics": [{"camera_type": "kb4", "intrinsics": lens.copy()} for _ in range(4)],
            "resolution": [[640, 480 - k] for k in range(4)],
        }
    }


def kalibr() -> dict:
    """A chain of three cameras; the first and the last are event cameras."""
    camera = {
        "camera_model": "pinhole", "camera_type": "event", "distortion_model": "radtan",
        "distortion_coeffs": [-0.1, 0.05, 0.001, 0.002], "resolution": [640, 480],
        "intrinsics": [500.0, 501.0, 320.0, 240.0],
    }  # fmt: skip
    chain = {f"cam{k}": copy.deepcopy(camera) for k in range(3)}
    chain["cam1"]["camera_type"] = "frame"
    for k in (1, 2):
        chain[f"cam{k}"]["T_cn_cnm1"] = TURN.tolist()
    return chain


def written(folder: Path, values: dict, suffix: str) -> Path:
    path = folder / f"calibration{suffix}"
    text = json.dumps(values) if suffix == ".json" else yaml.safe_dump(values)
    path.write_text(text, encoding="utf-8")
    return path


def real(name: str) -> Path:
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"{name} of the reference data is not here")
    return path


def test_basalt_takes_the_event_cameras_and_the_first_is_the_body(tmp_path):
    made = read_rig(written(tmp_path, basalt(), ".json"))
    assert made.camera_names == ("cam2", "cam3")
    assert [c.height_px for c in made.cameras] == [478, 477]
    assert made.cameras[0].distortion == (0.1, 0, 0, 0)
    np.testing.assert_allclose(made.T_body_cam[0], np.eye(4), atol=1e-12)
    # 10 cm along x of the IMU, seen from a camera turned about z by 2 atan(0.6 / 0.8).
    np.testing.assert_allclose(made.T_body_cam[1][:3, 3], [0.028, -0.096, 0], atol=1e-12)


def test_kalibr_links_are_followed_from_camera_to_camera(tmp_path):
    path = written(tmp_path, kalibr(), ".yaml")
    made = read_rig(path)
    assert made.camera_names == ("cam0", "cam2")
    np.testing.assert_allclose(made.T_body_cam[1], se3.inverse(TURN @ TURN), atol=1e-9)
    chosen = read_rig(path, ["cam1", 0])
    np.testing.assert_allclose(chosen.T_body_cam[1], TURN, atol=1e-9)


def test_a_rig_of_our_own_is_read_back(tmp_path):
    path = written(tmp_path, RIGS["mvsec"].to_json(), ".json")
    assert rig(str(path)).to_json() == RIGS["mvsec"].to_json()


@pytest.mark.parametrize(("change", "words"), [
    (lambda v: v["intrinsics"][2]["intrinsics"].pop("fy"), "intrinsics.fy is mis"),
    (lambda v: v["intrinsics"][3]["intrinsics"].update(fx=-3), "focal lengths above 0"),
    (lambda v: v["intrinsics"][3]["intrinsics"].update(cx=9e5), "far off the sensor"),
    (lambda v: v["intrinsics"][0].update(camera_type="ds"), "camera_type is 'ds'"),
    (lambda v: v["T_imu_cam"][2].update(qw=0.1), "norm is 0.608"),
    (lambda v: v["T_imu_cam"][2].update(px="left"), "T_imu_cam.2..px"),
    (lambda v: v["resolution"][1].__setitem__(0, 0), "resolution.1. is 0x479"),
    (lambda v: v["resolution"].pop(), "3 resolutions"),
    (lambda v: v.pop("T_imu_cam"), "value0.T_imu_cam is missing"),
])  # fmt: skip
def test_basalt_names_the_file_and_the_key_of_what_is_wrong(tmp_path, change, words):
    values = basalt()
    change(values["value0"])
    path = written(tmp_path, values, ".json")
    refused([words, path], rig, str(path))


@pytest.mark.parametrize(("change", "words"), [
    (lambda v: v["cam2"].pop("T_cn_cnm1"), "cam2.T_cn_cnm1 is missing"),
    (lambda v: v["cam1"].update(T_cn_cnm1=[[1, 0], [0, 1]]), "cam1.T_cn_cnm1 is not a rigid"),
    (lambda v: v["cam1"]["T_cn_cnm1"][0].__setitem__(0, 2.0), "not a rigid motion"),
    (lambda v: v["cam0"].update(distortion_coeffs=[0.1]), "1 distortion terms"),
    (lambda v: v["cam0"].update(distortion_coeffs=[0, 0, 0, float("nan")]), "finite numbers"),
    (lambda v: v["cam0"].update(distortion_model="fov"), "distortion_model is 'fov'"),
    (lambda v: v["cam0"].update(camera_model="omni"), "camera_model is 'omni'"),
    (lambda v: v["cam0"].update(intrinsics=[1, 2, 3]), "4 finite numbers"),
    (lambda v: v.clear(), "contains no camera: needs a Kalibr"),
    (lambda v: v.pop("cam1"), "where cam2 stands is not known: cam1 is missing before it"),
    (lambda v: v.update(right=v["cam0"]), "'right' is a camera outside the chain"),
])  # fmt: skip
def test_kalibr_names_the_file_and_the_key_of_what_is_wrong(tmp_path, change, words):
    values = kalibr()
    change(values)
    path = written(tmp_path, values, ".yaml")
    refused([words, path], rig, str(path))


ROS = """
image_width: 240
image_height: 180
camera_name: dvs
camera_matrix:
  rows: 3
  cols: 3
  data: [335.4, 0., 129.9, 0., 335.3, 99.2, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.1386, 0.0934, -0.0003, 0.0002, 0.]
"""
OPENCV = re.sub(r"\n  rows: [13]", r" !!opencv-matrix\g<0>", ROS)


@pytest.mark.parametrize("text", [ROS, "%YAML:1.0\n---" + OPENCV, "%YAML 1.2\n---" + ROS])
def test_one_camera_of_opencv_or_ros(tmp_path, text):
    path = tmp_path / "dvs.yaml"
    path.write_text(text, encoding="utf-8")
    (camera,) = read_rig(path).cameras
    assert (camera.width_px, camera.height_px) == (240, 180)
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (335.4, 335.3, 129.9, 99.2)
    assert camera.model == "radtan"
    assert camera.distortion == (-0.1386, 0.0934, -0.0003, 0.0002)


def in_opencv(was, now):
    assert was in OPENCV
    return OPENCV.replace(was, now)


@pytest.mark.parametrize(("text", "words"), [
    (in_opencv("335.4, 0.,", "335.4, 0.1,"), "camera_matrix has skew"),
    (in_opencv("0.0002, 0.", "0, 0, 0, 0, 0.3"), "8 lens terms: more than 5 cannot be represented"),
    (in_opencv("plumb_bob", "fov"), "lens model 'fov'.*needs plumb_bob"),
    (in_opencv("image_height: 180", ""), "image_height is missing"),
    (in_opencv("rows: 1", "rows: ["), "not valid JSON or YAML"),
    (in_opencv("data: [-0", "data: [x, -0"), "distortion_coefficients is .*numbers"),
    (in_opencv("data: [335.4", "data: [1, 335.4"), "camera_matrix is .*needs 9 finite numbers"),
    (in_opencv("distortion_coefficients", "D"), "distortion_coefficients is missing"),
    ("{", "not valid JSON"), ("[1, 2]", "contains no calibration"), (None, "No such file"),
])  # fmt: skip
def test_texts_that_are_no_calibration_name_what_is_wrong(tmp_path, text, words):
    path = tmp_path / "odd.yaml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    refused([words, path], rig, str(path))


def test_refuses_cameras_and_rigs_that_are_not_there(tmp_path):
    path = written(tmp_path, kalibr(), ".yaml")
    refused("no camera cam7: choose from cam0, cam1, cam2", read_rig, path, [7])
    refused("choose one of davis346, davis346-frames, dsec, mvsec", rig, "goggles")


@pytest.mark.parametrize("name", FILES)
def test_named_rigs_are_the_real_ones_rounded(name):
    file, (least_m, most_m) = FILES[name]
    made, named = read_rig(real(file)), RIGS[name]
    assert least_m <= made.baseline_m() <= most_m
    assert named.baseline_m() == pytest.approx(made.baseline_m(), abs=2e-5)
    points = np.random.default_rng(0).uniform((-0.4, -0.2, 1), (0.4, 0.3, 1), (500, 3)) * 2
    for k in (0, 1):
        uv_px = [
            r.cameras[k].project(se3.transform(se3.inverse(r.T_body_cam[k]), points))
            for r in (made, named)
        ]
        np.testing.assert_allclose(*uv_px, atol=0.05)


def off_opencv_px(camera) -> float:
    """Farthest distance of a lens's projection from OpenCV's, all over the sensor."""
    bearing = camera.bearing_table()[::7, ::7].reshape(-1, 1, 2)
    rays = np.concatenate([bearing, np.ones((len(bearing), 1, 1))], axis=-1)
    terms, zero = np.array(camera.distortion), np.zeros(3)
    if camera.model == "kb4":
        expected, _ = cv2.fisheye.projectPoints(rays, zero, zero, camera.K, terms)
    else:
        expected, _ = cv2.projectPoints(rays, zero, zero, camera.K, terms)
    return float(np.abs(camera.project(rays) - expected).max())


def table_off_opencv_px(camera) -> float:
    """The same for the table of bearings, which OpenCV must lead back to each pixel."""
    rows, columns = np.mgrid[: camera.height_px : 7, : camera.width_px : 7]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    terms = np.array(camera.distortion)
    if camera.model == "kb4":
        expected = cv2.fisheye.undistortPoints(pixels, camera.K, terms)
    else:
        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
        expected = cv2.undistortPoints(pixels, camera.K, terms, criteria=stop)
    table = camera.bearing_table()[::7, ::7].reshape(-1, 1, 2)
    return float((np.abs(table - expected) * (camera.fx_px, camera.fy_px)).max())


@pytest.mark.parametrize("name", REAL)
def test_real_pairs_have_their_baselines_and_lenses_as_opencv_has_them(name):
    """Projection and table of bearings, all over the sensor, to 1e-3 px."""
    file, (least_m, most_m) = REAL[name]
    made = read_rig(real(file))
    assert len(made) == 2
    assert least_m <= made.baseline_m() <= most_m
    for camera in made.cameras:
        assert off_opencv_px(camera) < 1e-3
        assert table_off_opencv_px(camera) < 1e-3


@pytest.mark.parametrize("name", RIGS)
def test_every_rig_has_its_body_at_camera_0_and_looks_ahead(name):
    made = RIGS[name]
    assert np.array_equal(made.T_body_cam[0], np.eye(4))
    for T_body_cam in made.T_body_cam:
        assert T_body_cam[2, 2] > np.cos(np.radians(6))


def test_yaml_has_the_numbers_of_its_version_1_2(tmp_path):
    text = """%YAML:1.0
a: [5e-05, 1e3, +1E-4, .5, 0o17, 0x1F, 010, 1., 1.e+02, -.5, +12]
b: [yes, no, on, 1_000, 1:30, 2020-01-01, "5e-05"]
c: [true, False, ~, null, .inf, -.Inf]
d: !!opencv-matrix {rows: 1, cols: 1, dt: d, data: [2.5e-01]}
e: &it {f: 1}
g: {<<: *it, h: 2}
"""
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8-sig")
    found = parsed(tmp_path / "a.yaml")
    assert found["a"] == [5e-05, 1000.0, 1e-4, 0.5, 15, 31, 10, 1.0, 100.0, -0.5, 12]
    assert found["b"] == ["yes", "no", "on", "1_000", "1:30", "2020-01-01", "5e-05"]
    assert found["c"] == [True, False, None, None, math.inf, -math.inf]
    assert found["d"]["data"] == [0.25]
    assert found["g"] == {"f": 1, "h": 2}
