"""Frames of VECtor's and M3ED's layouts, carried into the event camera's pixels and scored."""

import json

import cv2
import numpy as np
import pytest

import dataset_files
import dataset_world as world
from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.eval.cli.main import main


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return Sequence.open(world.write_sequence(tmp_path_factory.mktemp("ours") / "plane", "radtan"))


def depth_of(layout, sequence, folder):
    """What `align` is told of depth: VECtor has none of its own."""
    if layout == "m3ed":
        return []
    depth_m = sequence.truth_depth_m(0, world.TRUTH_US[1])
    np.save(folder / "depth.npy", depth_m)
    return ["--depth", folder / "depth.npy", "--depth-at-s", world.TRUTH_US[1] / 1e6]


@pytest.mark.parametrize(("layout", "frames"), [
    ("vector", "frame_left"), ("vector", "frame_right"), ("m3ed", "frame_left"),
    ("m3ed", "frame_rgb"),
])  # fmt: skip
def test_frames_fall_where_the_event_camera_sees_them(sequence, tmp_path, capsys, layout, frames):
    write = dataset_files.WRITERS[layout]
    folder = write(sequence, tmp_path / layout, world.plane_image)
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


@pytest.mark.parametrize("layout", ["vector", "m3ed"])
def test_poses_score_against_a_publishers_files(sequence, tmp_path, capsys, layout):
    folder = dataset_files.WRITERS[layout](sequence, tmp_path / layout)
    write_tum(tmp_path / "est.txt", open_recording(folder).trajectory)
    command = ["score", str(tmp_path / "est.txt"), "--truth", str(folder)]
    assert main([*command, "--out", str(tmp_path / "out"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert next(row["value"] for row in rows if row["metric"] == "ate_rmse") < 1e-6
