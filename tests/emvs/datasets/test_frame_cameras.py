"""Frame cameras as publishers lay them out: made files, lenses and places, and damage."""

import json

import h5py
import numpy as np
import pytest
import yaml
from PIL import Image

import dataset_files
import dataset_world as world
from dataset_world import rewritten
from eventsweep.emvs.data.image_stores import frame_cameras
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.mvsec_m3ed import StackedImages
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.frame_files import read_times_us
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from refusals import refused

GREY = Camera(64, 48, 70.0, 71.0, 31.5, 24.0, "radtan", (-0.1, 0.02, 1e-3, 2e-3))
RECTIFIED = Camera(64, 48, 60.0, 60.0, 32.0, 24.5)
T_CAM0_CAM1 = se3.exp([0.05, -0.01, 0.002, 0.01, -0.02, 0.03])
R_RECT1 = se3.exp([0, 0, 0, -0.02, 0.01, 0.015])[:3, :3]
STARTS = [10_000, 30_000, 50_000]


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    return world.write_sequence(tmp_path_factory.mktemp("ours") / "plane", "pinhole", steps=300)


def image(k):
    return (np.add.outer(np.arange(48), np.arange(64)) + 40 * k).astype(np.uint8)


def dsec(ours, folder, kind="distorted"):
    """A sequence with the left frame camera, whose calibration is written into its file."""
    rewritten(ours, folder, "dsec")
    path = folder / "calibration" / "cam_to_cam.yaml"
    values = yaml.safe_load(path.read_text())
    before = np.array(values["extrinsics"]["T_21"])  # cam1 was where cam0 is
    four = {"fx_px": "", "fy_px": "", "cx_px": "", "cy_px": ""}
    for name, camera in (("cam1", GREY), ("camRect1", RECTIFIED)):
        values["intrinsics"][name] |= {
            "camera_matrix": [getattr(camera, key) for key in four], "resolution": [64, 48],
            "distortion_model": "radtan" if camera.distortion else "none",
            "distortion_coeffs": list(camera.distortion),
        }  # fmt: skip
    values["extrinsics"] |= {
        "T_10": se3.inverse(T_CAM0_CAM1).tolist(), "T_21": (before @ T_CAM0_CAM1).tolist(),
        "R_rect1": R_RECT1.tolist(),
    }  # fmt: skip
    path.write_text(yaml.safe_dump(values))
    images = folder / "images" / "left" / kind
    images.mkdir(parents=True)
    for k in range(3):
        Image.fromarray(image(k)).save(images / f"{k:06d}.png")
    (folder / "images" / "timestamps.txt").write_text("12000\n32000\n52000\n")
    lines = "".join(f"{t}, {t + 4000}\n" for t in STARTS)
    (images.parent / "exposure_timestamps.txt").write_text(f"# start, end\n{lines}")
    return folder


def test_dsecs_frames_have_lens_place_and_exposure(ours, tmp_path):
    recording = open_recording(dsec(ours, tmp_path / "d"))
    (left,) = frame_cameras(recording)
    assert (left.name, left.camera, left.shares) == ("frame_left", GREY, None)
    np.testing.assert_allclose(left.T_body_cam, T_CAM0_CAM1, atol=1e-9)
    assert left.pictures.t_us.tolist() == [12_000, 32_000, 52_000]
    assert left.photo(1)[:2] == (30_000, 34_000)
    np.testing.assert_array_equal(left.photo(2).image, image(2))


def test_dsecs_rectified_frames_are_those_of_a_turned_pinhole(ours, tmp_path):
    (left,) = frame_cameras(open_recording(dsec(ours, tmp_path / "d", "rectified")))
    assert left.camera == RECTIFIED
    point = np.array([0.2, 0.1, 2.0])  # in cam1
    seen = se3.inverse(left.T_body_cam) @ T_CAM0_CAM1 @ np.append(point, 1)
    np.testing.assert_allclose(seen[:3], R_RECT1 @ point, atol=1e-9)


def tumvie(ours, folder):
    rewritten(ours, folder, "tumvie")
    size = open_recording(folder).rig.cameras[0]
    images = next(folder.glob("*vi_gt_data")) / "left_images"
    images.mkdir()
    for k in range(3):
        grey = np.full((size.height_px, size.width_px), 60 * k, np.uint8)
        Image.fromarray(grey).save(images / f"{k:05d}.jpg")
    lines = "".join(f"{t}\n" for t in STARTS)
    (images.parent / "image_timestamps_left.txt").write_text(f"# timestamps in us\n{lines}")
    return folder


def test_tumvies_frames_have_lens_and_place(ours, tmp_path):
    folder = tumvie(ours, tmp_path / "t")
    path = next(folder.glob("camera-calibration*.json"))
    values = json.loads(path.read_text())
    values["value0"]["T_imu_cam"][0]["px"] += 0.25
    path.write_text(json.dumps(values))
    recording = open_recording(folder)
    (left,) = frame_cameras(recording)
    assert left.name == "frame_left"
    np.testing.assert_allclose(np.linalg.norm(left.T_body_cam[:3, 3]), 0.25, atol=1e-6)
    assert left.pictures.t_us.tolist() == STARTS
    assert left.photo(2)[:2] == (50_000, 50_000)
    assert abs(int(left.photo(2).image.mean()) - 120) <= 1


@pytest.fixture(scope="module")
def sequence(ours):
    return Sequence.open(ours)


def test_vectors_frames_have_lens_place_and_exposure(sequence, tmp_path):
    recording = open_recording(dataset_files.write_vector(sequence, tmp_path / "v"))
    left, right = frame_cameras(recording)
    assert (left.name, right.name, left.shares) == ("frame_left", "frame_right", None)
    for k, seen in enumerate((left, right)):
        same_lens(seen.camera, dataset_files.GREY)
        np.testing.assert_allclose(seen.T_body_cam, dataset_files.beside(k), atol=1e-6)
        assert seen.pictures.t_us.tolist() == list(world.TRUTH_US)
        assert seen.photo(1)[:2] == (world.TRUTH_US[1] - 2000, world.TRUTH_US[1] + 2000)
        np.testing.assert_array_equal(
            seen.photo(2).image, dataset_files.gradient(dataset_files.GREY, None)
        )


def test_m3eds_imagers_have_lens_and_place(sequence, tmp_path):
    folder = dataset_files.write_m3ed(sequence, tmp_path / "m", world.plane_image)
    found = frame_cameras(open_recording(folder))
    assert [each.name for each in found] == ["frame_left", "frame_right", "frame_rgb"]
    for k, seen in enumerate(found):
        same_lens(seen.camera, dataset_files.GREY)
        T_left = dataset_files.beside(k)
        np.testing.assert_allclose(seen.T_body_cam, T_left, atol=1e-6)
        assert seen.pictures.t_us.tolist() == list(world.TRUTH_US)
        t_us = world.TRUTH_US[2]
        T = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[0] @ T_left
        start_us, end_us, _, image = seen.photo(2)
        assert (start_us, end_us) == (t_us, t_us)
        off = image.astype(int) - world.plane_image(seen.camera, T)
        assert np.abs(off).max() <= 1


def test_a_calibration_of_an_odd_type_is_not_read(sequence, tmp_path):
    """HDF5 would read lists of any length from wherever a damaged file points to."""
    folder = dataset_files.write_m3ed(sequence, tmp_path / "m")
    with h5py.File(folder / "plane_data.h5", "r+") as file:
        name = "prophesee/left/calib/camera_model"
        del file[name]
        file.create_dataset(name, (), dtype=h5py.vlen_dtype(np.uint8))
    refused("camera_model is not a valid calibration value", open_recording, folder)


def test_of_colour_the_first_is_blue(tmp_path):
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file["data"] = np.full((1, 4, 6, 3), (200, 100, 50), np.uint8)
    photo = StackedImages(tmp_path / "f.h5", "data", np.array([7])).photo(0)
    assert (photo.start_us, photo.image.shape) == (7, (4, 6))
    assert abs(int(photo.image[0, 0]) - (0.114 * 200 + 0.587 * 100 + 0.299 * 50)) <= 1


def same_lens(found, true):
    assert (found.width_px, found.height_px) == (true.width_px, true.height_px)
    rays = np.array([[0.1, -0.2, 1.0], [-0.3, 0.25, 1.0]])
    np.testing.assert_allclose(found.project(rays), true.project(rays), atol=1e-6)


def edited(path, edit):
    with h5py.File(path, "r+") as file:
        edit(file)


def replaced(file, name, values):
    del file[name]
    file[name] = values


@pytest.mark.parametrize(("layout", "change", "line"), [
    ("vector", lambda f: (f / "plane1.synced.left_camera/timestamp.txt").write_text("0.1 x\n"),
     "needs 2 times in s in each line"),
    ("vector", lambda f: (f / "plane1.synced.left_camera/timestamp.txt").write_text("1e300 1\n"),
     r"beyond 2\^62 µs"),
    ("vector", lambda f: (f / "plane1.synced.left_camera/timestamp.txt").write_text("0.1 0.2\n"),
     "3 images for 1 times"),
    ("vector", lambda f: (f / "plane1.synced.right_camera/timestamp.txt").unlink(),
     "lacks the times of images"),
    ("vector", lambda f: next(f.glob("calib/left_regular*")).unlink(), "lacks the lens of images"),
    ("vector", lambda f: next(f.glob("calib/small*")).write_text(
        next(f.glob("calib/small*")).read_text().replace("T_cam0_cam1", "T_cam1_cam0")),
     "cam1.T_cam0_cam1"),
    ("m3ed", lambda f: edited(f / "plane_data.h5", lambda h: h.__delitem__("ovc/ts")),
     "has ovc/left/data, but not ovc/ts"),
    ("m3ed", lambda f: edited(f / "plane_data.h5", lambda h: h.__delitem__("ovc/rgb/calib")),
     "lacks ovc/rgb/calib"),
    ("m3ed", lambda f: edited(f / "plane_data.h5", lambda h: replaced(h, "ovc/ts", [3, 2, 1])),
     "do not rise"),
    ("m3ed", lambda f: edited(f / "plane_data.h5", lambda h: replaced(h, "ovc/ts", [3, 4])),
     "2 times for 3 entries"),
    ("m3ed", lambda f: edited(f / "plane_data.h5", lambda h: replaced(
        h, "ovc/left/data", np.zeros((3, 60, 80, 2), "u1"))), "with 1 or 3 channels"),
])  # fmt: skip
def test_damage_of_imagers_is_refused_in_one_line(sequence, tmp_path, layout, change, line):
    folder = dataset_files.WRITERS[layout](sequence, tmp_path / "d")
    change(folder)
    recording = open_recording(folder)  # maps need no frames
    refused(line, frame_cameras, recording)


@pytest.mark.parametrize(("change", "line"), [
    (lambda f: (f / "images/left/exposure_timestamps.txt").write_text("1, x\n"), "whole µs"),
    (lambda f: (f / "images/left/exposure_timestamps.txt").write_text("1, 2\n"),
     "3 images for 1 times"),
    (lambda f: (f / "images/left/exposure_timestamps.txt").write_text("9, 2\n5, 6\n7, 8\n"),
     "do not rise"),
    (lambda f: [(f / "images/left/exposure_timestamps.txt").unlink(),
                (f / "images/timestamps.txt").unlink()], "lacks the times of images"),
])  # fmt: skip
def test_damage_of_frames_is_refused_in_one_line(ours, tmp_path, change, line):
    folder = dsec(ours, tmp_path / "d")
    change(folder)
    recording = open_recording(folder)  # maps need no frames
    refused(line, frame_cameras, recording)


def test_a_damaged_or_foreign_image_is_refused_when_it_is_read(ours, tmp_path):
    folder = dsec(ours, tmp_path / "d")
    images = folder / "images" / "left" / "distorted"
    Image.fromarray(image(0)[:30]).save(images / "000001.png")
    data = (images / "000000.png").read_bytes()
    (images / "000000.png").write_bytes(data[: len(data) // 2])
    (left,) = frame_cameras(open_recording(folder))
    refused("not a complete PNG", left.photo, 0)
    refused(r"frame 1 of frame_left has shape \(30, 64\)", left.photo, 1)


def test_mutants_of_times_end_in_one_line_or_in_times(ours, tmp_path):
    folder = dsec(ours, tmp_path / "d")
    path, rng = folder / "images" / "left" / "exposure_timestamps.txt", np.random.default_rng(3)
    data = path.read_bytes()
    read, lines = 0, []
    for _ in range(500):
        bad = bytearray(data)
        for at in rng.integers(0, len(bad), rng.integers(1, 4)):
            bad[at] = rng.integers(0, 256)
        path.write_bytes(bytes(bad))
        try:
            table = read_times_us(path, 2)
        except InputError as error:
            lines.append(str(error))
        else:
            read += table.dtype == np.int64
    assert 0 < read == 500 - len(lines) < 500
    assert not any("\n" in line for line in lines)
