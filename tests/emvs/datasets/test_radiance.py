"""Views for radiance fields: rays of nerfstudio and EventNeRF are those of the recording."""

import json

import cv2
import numpy as np
import pytest

import dataset_world as world
from dataset_world import rewritten
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.radiance import Undistorter
from eventsweep.emvs.geometry import se3
from eventsweep.eval.cli.main import main
from made_events import assert_same_events


@pytest.fixture(scope="module", params=["pinhole", "radtan", "kb4"])
def sequence(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("radiance")
    return Sequence.open(world.write_sequence(folder / "ours", request.param, steps=200))


def test_nerfstudio_opens_again_with_every_event_and_lens(sequence, tmp_path):
    found = open_recording(rewritten(sequence.path, tmp_path / "n", "nerfstudio"))
    for k in range(2):
        assert found.rig.cameras[k].to_json() == sequence.rig.cameras[k].to_json()
        one, two = (r.events(k, 0, 1 << 40) for r in (sequence, found))
        assert_same_events(one, two)


def test_transforms_give_the_points_their_pixels(sequence, tmp_path):
    """By nerfstudio's conventions, written out here: OpenGL's axes, centres of pixels at a half."""
    folder = rewritten(sequence.path, tmp_path / "n", "nerfstudio")
    values = json.loads((folder / "transforms.json").read_text())
    points = world.points_world(40)
    assert len(values["frames"]) == 2 * len(world.TRUTH_US)
    for view in values["frames"]:
        assert cv2.imread(str(folder / view["file_path"]), -1).shape == (world.HEIGHT, world.WIDTH)
        k, t_us = view["camera"], view["t_us"]
        T_cam_world = np.linalg.inv(np.array(view["transform_matrix"]) @ np.diag([1, -1, -1, 1]))
        px = projected(values["camera_model"], view, se3.transform(T_cam_world, points)) - 0.5
        T_world_cam = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[k]
        seen = se3.transform(se3.inverse(T_world_cam), points)
        np.testing.assert_allclose(px, sequence.rig.cameras[k].project(seen), atol=1e-4)


def projected(model, view, points):
    """OpenCV's own projection with a view's numbers."""
    K = np.array([[view["fl_x"], 0, view["cx"]], [0, view["fl_y"], view["cy"]], [0, 0, 1]])
    zero = np.zeros(3)
    if model == "OPENCV_FISHEYE":
        terms = np.array([view[f"k{n}"] for n in (1, 2, 3, 4)])
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, K, terms)[0][:, 0]
    terms = np.array([view.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")])
    return cv2.projectPoints(points, zero, zero, K, terms)[0][:, 0]


def test_eventnerfs_views_follow_each_other_evenly_over_the_events(sequence, tmp_path):
    """As its loader reads them: view i of n is at i / (n - 1) of the last event's time."""
    folder = rewritten(sequence.path, tmp_path / "e", "eventnerf") / "cam1" / "train"
    with np.load(folder / "events" / "events.npz") as stored:
        x, y, t, p = (stored[name] for name in "xytp")
    assert t[0] == 0
    assert set(np.unique(p)) == {-1, 1}
    poses = sorted((folder / "pose").iterdir())
    assert [len(list((folder / n).iterdir())) for n in ("intrinsics", "rgb")] == [len(poses)] * 2
    first_us = sequence.events(1, 0, 1 << 40).t_us[0]
    for i in (0, len(poses) // 2, len(poses) - 1):
        t_us = first_us + i / (len(poses) - 1) * t.max()
        expected = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[1]
        np.testing.assert_allclose(np.loadtxt(poses[i]), expected, atol=1e-5)
    K = np.loadtxt(folder / "intrinsics" / "000000.txt")
    assert K.shape == (5, 4)
    np.testing.assert_allclose(K[:2, 2] - 0.5, sequence.rig.cameras[1].K[:2, 2])
    assert (K[4] == 0).all()
    assert x.max() < world.WIDTH
    assert y.max() < world.HEIGHT


def test_eventnerf_opens_again_as_the_undistorted_recording(sequence, tmp_path):
    found = open_recording(rewritten(sequence.path, tmp_path / "e", "eventnerf"))
    for k in range(2):
        camera = sequence.rig.cameras[k]
        expected = Undistorter(camera)(sequence.events(k, 0, 500_001))
        assert_same_events(found.events(k, 0, 1 << 40), expected)
        assert found.rig.cameras[k].to_json() == camera.undistorted().to_json()


def test_undistorted_events_lie_where_their_rays_lead(sequence):
    camera = sequence.rig.cameras[0]
    events = sequence.events(0, 0, 1 << 40)
    moved = Undistorter(camera)(events)
    bearing = camera.unproject(np.stack([events.x, events.y], axis=-1).astype(float))
    uv = camera.undistorted().project(np.concatenate([bearing, np.ones((len(events), 1))], -1))
    px = np.rint(uv)
    inside = ((px >= 0) & (px < (camera.width_px, camera.height_px))).all(axis=-1)
    np.testing.assert_array_equal(np.stack([moved.x, moved.y], -1), px[inside])
    assert len(moved) > 0.7 * len(events)


def test_a_recording_without_pictures_has_views_at_its_poses(sequence, tmp_path):
    bare = rewritten(sequence.path, tmp_path / "bare", "npz")
    assert main(["convert", str(bare), str(tmp_path / "n"), "--to", "nerfstudio", "--quiet"]) == 0
    frames = json.loads((tmp_path / "n" / "transforms.json").read_text())["frames"]
    assert len(frames) == 2 * len(sequence.trajectory)
    assert not any("file_path" in view for view in frames)
    assert main(["convert", str(bare), str(tmp_path / "e"), "--to", "eventnerf", "--quiet"]) == 0
    assert cv2.imread(str(tmp_path / "e/cam0/train/rgb/000000.png"), -1).max() == 0


def test_times_shift_with_the_events(sequence, tmp_path):
    out = tmp_path / "n"
    words = ("--to", "nerfstudio", "--shift-us", "7000000", "--quiet")
    assert main(["convert", str(sequence.path), str(out), *words]) == 0
    frames = json.loads((out / "transforms.json").read_text())["frames"]
    own = [view["t_us"] - 7_000_000 for view in frames if view["camera"] == 0]
    assert own == list(world.TRUTH_US)
    assert open_recording(out).events(0, 0, 7_000_000).t_us.size == 0
