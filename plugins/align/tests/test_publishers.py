"""Frames as publishers lay them out, carried into the event camera's pixels; poses scored."""

import json

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

import dataset_files
import dataset_world as world
from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.formats.calibration_writers import pose_values
from eventsweep.emvs.geometry import se3
from eventsweep.eval.cli.main import main


@pytest.fixture(scope="module")
def sequences(tmp_path_factory):
    """One for each model of lenses."""
    folder = tmp_path_factory.mktemp("ours")
    return {
        model: Sequence.open(world.write_sequence(folder / model, model))
        for model in ("radtan", "kb4")
    }


def write_dsec(sequence, folder, picture):
    """With a left frame camera that has the event camera's lens and a place of its own."""
    world.rewritten(sequence.path, folder, "dsec")
    path, place = folder / "calibration" / "cam_to_cam.yaml", dataset_files.beside(0)
    values = yaml.safe_load(path.read_text())
    T_32 = np.array(values["extrinsics"]["T_21"])  # of the frame cameras, where the events' were
    moved = {"T_10": se3.inverse(place), "T_21": T_32 @ place}
    values["extrinsics"] |= {name: T.tolist() for name, T in moved.items()}
    path.write_text(yaml.safe_dump(values))
    images = folder / "images" / "left" / "distorted"
    images.mkdir(parents=True)
    for k, image in enumerate(seen_from(sequence, place, picture)):
        Image.fromarray(image).save(images / f"{k:06d}.png")
    lines = "".join(f"{t_us - 2000}, {t_us + 2000}\n" for t_us in world.TRUTH_US)
    (images.parent / "exposure_timestamps.txt").write_text(lines)
    return folder


def write_tumvie(sequence, folder, picture):
    """With a left frame camera that has the event camera's lens and a place of its own."""
    world.rewritten(sequence.path, folder, "tumvie")
    path, place = next(folder.glob("camera-calibration*.json")), dataset_files.beside(0)
    values = json.loads(path.read_text())
    values["value0"]["T_imu_cam"][0] = pose_values(place)
    path.write_text(json.dumps(values))
    images = next(folder.glob("*vi_gt_data")) / "left_images"
    images.mkdir()
    for k, image in enumerate(seen_from(sequence, place, picture)):
        Image.fromarray(image).save(images / f"{k:05d}.jpg", quality=98)
    stamps = "".join(f"{t_us}\n" for t_us in world.TRUTH_US)
    (images / "image_timestamps_left.txt").write_text(stamps)
    return folder


def seen_from(sequence, T_left_frame, picture):
    """What the frame camera takes."""
    for t_us in world.TRUTH_US:
        T_world_left = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[0]
        yield picture(sequence.rig.cameras[0], T_world_left @ T_left_frame)


WRITERS = {**dataset_files.WRITERS, "dsec": write_dsec, "tumvie": write_tumvie}


def depth_of(layout, sequence, folder):
    """Depth given to `align`: VECtor and TUM-VIE have none of their own."""
    if layout in ("m3ed", "dsec"):
        return []
    depth_m = sequence.truth_depth_m(0, world.TRUTH_US[1])
    np.save(folder / "depth.npy", depth_m)
    return ["--depth", folder / "depth.npy", "--depth-at-s", world.TRUTH_US[1] / 1e6]


@pytest.mark.parametrize(("layout", "frames"), [
    ("vector", "frame_left"), ("vector", "frame_right"), ("m3ed", "frame_left"),
    ("m3ed", "frame_rgb"), ("dsec", "frame_left"), ("tumvie", "frame_left"),
])  # fmt: skip
def test_frames_fall_where_the_event_camera_sees_them(sequences, tmp_path, capsys, layout, frames):
    sequence = sequences["kb4" if layout == "tumvie" else "radtan"]
    folder = WRITERS[layout](sequence, tmp_path / layout, world.plane_image)
    out = tmp_path / "out"
    depth = map(str, depth_of(layout, sequence, tmp_path))
    command = ["align", str(folder), "--out", str(out), "--frames", frames, *depth, "--json"]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 3
    eye = sequence.rig.cameras[0]
    for k, t_us in enumerate(world.TRUTH_US):
        T_world_eye = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[0]
        image, mask = (
            cv2.imread(str(out / name / f"{k:06d}.png"), cv2.IMREAD_UNCHANGED)
            for name in ("frames", "mask")
        )
        off = np.abs(image.astype(float) - world.plane_image(eye, T_world_eye))[mask == 255]
        assert len(off) > 0.5 * mask.size
        assert np.median(off) < 1.5  # grey levels; a pixel makes 11 in the median
        assert np.percentile(off, 95) < 6


@pytest.mark.parametrize("layout", ["vector", "m3ed", "tumvie"])
def test_poses_score_against_a_publishers_files(sequences, tmp_path, capsys, layout):
    sequence = sequences["kb4"]
    folder = WRITERS[layout](sequence, tmp_path / layout, dataset_files.gradient)
    write_tum(tmp_path / "est.txt", open_recording(folder).trajectory)
    command = ["score", str(tmp_path / "est.txt"), "--truth", str(folder)]
    assert main([*command, "--out", str(tmp_path / "out"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert next(row["value"] for row in rows if row["metric"] == "ate_rmse") < 1e-6
