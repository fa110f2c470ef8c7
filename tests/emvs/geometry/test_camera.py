"""Cameras: the lens models against OpenCV, and the laws of projection."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from refusals import refused

PINHOLE = Camera(640, 480, 553.5, 552.1, 346.6, 216.5)
RADTAN = Camera(640, 480, 553.5, 552.1, 346.6, 216.5, "radtan", (-0.09, 0.19, 8e-5, 2e-3))
RADTAN5 = Camera(240, 180, 335.4, 335.3, 129.9, 99.2, "radtan", (-0.14, 0.09, -3e-4, 2e-4, 0.01))
KB4 = Camera(1280, 720, 1049.6, 1049.4, 634.7, 263.5, "kb4", (-0.115, -0.062, 0.217, -0.235))
CAMERAS = [PINHOLE, RADTAN, RADTAN5, KB4]


@pytest.mark.parametrize("camera", CAMERAS)
def test_every_pixel_goes_out_and_back(camera):
    table = camera.bearing_table()
    assert table.shape == (camera.height_px, camera.width_px, 2)
    assert np.isfinite(table).all()
    points = np.concatenate([table, np.ones((*table.shape[:2], 1))], axis=-1)
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    np.testing.assert_allclose(
        camera.project(3.7 * points), np.stack([columns, rows], -1), atol=1e-6
    )


@pytest.mark.parametrize("camera", [RADTAN, RADTAN5])
def test_radtan_is_opencvs(camera):
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3)) * (0.5, 0.4, 0) + (0, 0, 1)
    theirs, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion)
    )
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], atol=1e-9)


def test_kb4_is_opencvs_fisheye():
    bearing = np.random.default_rng(0).uniform(-0.6, 0.6, (500, 2))
    theirs = cv2.fisheye.distortPoints(bearing[None], KB4.K, np.array(KB4.distortion))[0]
    mine = KB4.project(np.concatenate([bearing, np.ones((500, 1))], axis=1))
    np.testing.assert_allclose(mine, theirs, atol=1e-9)


def test_a_lens_that_folds_over_has_no_ray_there():
    folding = Camera(64, 48, 30, 30, 32, 24, "radtan", (-0.5, 0.0, 0.0, 0.0))
    table = folding.bearing_table()
    assert np.isnan(table[0, 0]).all()
    assert np.isfinite(table[24, 32]).all()


@given(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(0.1, 100), st.sampled_from(CAMERAS))
def test_depth_does_not_move_a_projection(x, y, z, camera):
    near, far = camera.project([x, y, 1.0]), camera.project([x * z, y * z, z])
    np.testing.assert_allclose(near, far, rtol=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
def test_points_behind_are_not_projected(camera):
    assert np.isnan(camera.project([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0]])).all()


@pytest.mark.parametrize("camera", CAMERAS)
def test_json_round_trip(camera):
    assert Camera.from_json(camera.to_json()) == camera


def camera_with(**change):
    return Camera.from_json({**PINHOLE.to_json(), **change})


@pytest.mark.parametrize(("call", "given", "words"), [
    (camera_with, {"model": "fisheye"}, "needs one of pinhole, radtan, kb4"),
    (camera_with, {"distortion": (0.1,)}, "distortion terms"),
    (camera_with, {"fx_px": 0.0}, "above 0"), (camera_with, {"fy_px": float("nan")}, "finite"),
    (camera_with, {"width_px": 0}, "at least 1"), (camera_with, {"colour": "red"}, "colour"),
    *((Rig, {"name": "one", "cameras": (PINHOLE,), "T_body_cam": (matrix,)}, "not a rigid motion")
      for matrix in (2 * np.eye(4), np.full((4, 4), np.nan), np.diag([1.0, 1, -1, 1]), np.eye(3))),
    (Rig, {"name": "none", "cameras": (), "T_body_cam": ()}, "at least one"),
    *((Rig.from_json, {"values": values}, "")
      for values in ({}, {"name": "x", "cameras": [{}]}, {"name": "x", "cameras": 5}, [])),
])  # fmt: skip
def test_impossible_cameras_and_rigs_are_refused(call, given, words):
    refused(words, call, **given)


def test_rig_round_trip_and_baseline():
    right = np.eye(4)
    right[:3, 3] = (0.3, 0, 0.4)
    rig = Rig("pair", (PINHOLE, KB4), (np.eye(4), right))
    again = Rig.from_json(rig.to_json())
    assert again.baseline_m() == rig.baseline_m() == 0.5
    assert again.cameras == rig.cameras
    assert again.camera_names == ("cam0", "cam1")


def test_a_zoomed_camera_keeps_centre_sensor_and_distortion():
    camera = Camera(64, 48, 50.0, 60.0, 31.0, 25.0, "radtan", (-0.1, 0.02, 0.0, 0.0))
    zoomed = camera.zoomed(1.5)
    assert (zoomed.fx_px, zoomed.fy_px) == (75.0, 90.0)
    assert replace(zoomed, fx_px=50.0, fy_px=60.0) == camera
