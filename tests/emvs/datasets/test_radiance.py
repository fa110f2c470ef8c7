"""Views for radiance fields: rays of nerfstudio and EventNeRF are those of the recording."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dataset_files
import dataset_world as world
from dataset_world import rewritten
from eventsweep.emvs.data.image_stores import Photo, frame_cameras
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.radiance import Undistorter
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.eval.cli.main import main
from made_events import assert_same_events
from refusals import command_refused


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


@pytest.fixture(scope="module")
def vector(tmp_path_factory):
    """VECtor's layout with two frame cameras of their own size, lens and place."""
    folder = tmp_path_factory.mktemp("vector")
    ours = Sequence.open(world.write_sequence(folder / "ours", "radtan", steps=200))
    return dataset_files.write_vector(ours, folder / "v", world.plane_image)


def converted(source, out, kind, *words):
    assert main(["convert", str(source), str(out), "--to", kind, "--quiet", *words]) == 0
    return out


def test_a_sequence_keeps_frame_cameras(vector, tmp_path, capsys):
    shift_us = 1_000_000
    out = converted(vector, tmp_path / "s", "sequence", "--shift-us", str(shift_us))
    again = converted(out, tmp_path / "again", "sequence", "--shift-us", str(-shift_us))
    assert "left out" not in capsys.readouterr().err
    given = open_recording(vector)
    for path, moved_us in ((out, shift_us), (again, 0)):
        found = open_recording(path)
        found.verify()
        for one, two in zip(frame_cameras(given), frame_cameras(found), strict=True):
            assert (one.name, one.camera) == (two.name, two.camera)
            np.testing.assert_allclose(one.T_body_cam, two.T_body_cam, atol=1e-9)
            assert (one.pictures.t_us + moved_us).tolist() == two.pictures.t_us.tolist()
            for k in range(len(one.pictures.t_us)):
                start_us, end_us, gain, image = one.photo(k)
                assert two.photo(k)[:3] == (start_us + moved_us, end_us + moved_us, gain)
                np.testing.assert_array_equal(two.photo(k).image, image)


def test_stamps_without_exposure_stay_so(tmp_path):
    ours = Sequence.open(world.write_sequence(tmp_path / "ours", "kb4", steps=60))
    m3ed = dataset_files.write_m3ed(ours, tmp_path / "m")
    found = open_recording(converted(m3ed, tmp_path / "s", "sequence"))
    photos = [frame_cameras(found)[2].photo(k) for k in range(3)]
    assert [photo[:2] for photo in photos] == [(t_us, t_us) for t_us in world.TRUTH_US]


def test_frames_of_an_event_cameras_own_pixels_are_kept(tmp_path):
    ours = Sequence.open(world.write_sequence(tmp_path / "ours", "radtan", 1, steps=60))
    with SequenceWriter(
        tmp_path / "davis", name="d", rig=ours.rig, trajectory=ours.trajectory, config={}
    ) as writer:
        writer.append_events(0, ours.events(0, 0, 1 << 40))
        image = np.full((world.HEIGHT, world.WIDTH), 9, np.uint8)
        writer.append_photo(0, Photo(100_000, 104_000, 2.0, image))
    found = open_recording(converted(tmp_path / "davis", tmp_path / "s", "sequence"))
    assert found.photo(0, 0)[:3] == (100_000, 104_000, 2.0)


def true_view(folder, camera, t_us):
    """A frame camera's true pose and lens."""
    recording = open_recording(folder)
    T_world_left = recording.trajectory.at(t_us) @ recording.rig.T_body_cam[0]
    return T_world_left @ dataset_files.beside(camera), dataset_files.GREY


def test_nerfstudios_frame_views_give_the_points_their_pixels(vector, tmp_path):
    folder = converted(vector, tmp_path / "n", "nerfstudio", "--shift-us", "500")
    values = json.loads((folder / "transforms.json").read_text())
    views = [view for view in values["frames"] if view["camera"] >= 2]
    assert len(views) == 2 * len(world.TRUTH_US)
    points = world.points_world(40)
    for view in views:
        assert "events" not in view
        T, lens = true_view(vector, view["camera"] - 2, view["t_us"] - 500)
        image = cv2.imread(str(folder / view["file_path"]), -1)
        assert image.shape == (view["h"], view["w"]) == (lens.height_px, lens.width_px)
        assert np.abs(image.astype(int) - world.plane_image(lens, T)).max() <= 1
        T_cam_world = np.linalg.inv(np.array(view["transform_matrix"]) @ np.diag([1, -1, -1, 1]))
        px = projected(values["camera_model"], view, se3.transform(T_cam_world, points)) - 0.5
        seen = lens.project(se3.transform(se3.inverse(T), points))
        near = np.isfinite(seen).all(axis=1)
        np.testing.assert_allclose(px[near], seen[near], atol=1e-3)


def colmap_rows(path):
    """The words of a table of COLMAP, without comments and empty lines."""
    lines = path.read_text().splitlines()
    return [line.split() for line in lines if line and not line.startswith("#")]


ORDER = {
    "PINHOLE": (), "OPENCV": ("k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
}  # fmt: skip
"""Parameters of COLMAP's models after fx, fy, cx, cy."""


def colmap_points(folder, points):
    """File, camera and (N, 2) pixels of points by COLMAP's own conventions, for each image."""
    cameras = {}
    for number, model, *numbers in colmap_rows(folder / "sparse/0/cameras.txt"):
        width, height, *terms = map(float, numbers)
        names = ("fl_x", "fl_y", "cx", "cy", *ORDER[model])
        cameras[number] = model, (height, width), dict(zip(names, terms, strict=True))
    for _, w, x, y, z, *place, camera, name in colmap_rows(folder / "sparse/0/images.txt"):
        model, size, lens = cameras[camera]
        R = Rotation.from_quat([float(v) for v in (x, y, z, w)]).as_matrix()
        seen = points @ R.T + np.array(place, float)
        assert cv2.imread(str(folder / "images" / name), -1).shape == size
        yield name, int(camera) - 1, projected(model, lens, seen) - 0.5


def test_colmaps_images_give_the_points_their_pixels(vector, tmp_path):
    folder, points = converted(vector, tmp_path / "c", "colmap"), world.points_world(40)
    found = list(colmap_points(folder, points))
    assert len(found) == 2 * len(world.TRUTH_US)  # VECtor has no pictures of event cameras
    for name, camera, px in found:
        k, number = camera - 2, int(name[-9:-4])
        T, lens = true_view(vector, k, world.TRUTH_US[number])
        seen = lens.project(se3.transform(se3.inverse(T), points))
        near = np.isfinite(seen).all(axis=1)
        np.testing.assert_allclose(px[near], seen[near], atol=1e-3)
    assert not colmap_rows(folder / "sparse/0/points3D.txt")
    assert len(open_recording(folder).events(0, 0, 1 << 40))


def test_colmap_has_the_pictures_of_event_cameras(sequence, tmp_path):
    folder, points = rewritten(sequence.path, tmp_path / "c", "colmap"), world.points_world(40)
    found = list(colmap_points(folder, points))
    assert len(found) == 2 * len(world.TRUTH_US)
    for name, camera, px in found:
        t_us = world.TRUTH_US[int(name[-9:-4])]
        T_world_cam = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[camera]
        seen = se3.transform(se3.inverse(T_world_cam), points)
        np.testing.assert_allclose(px, sequence.rig.cameras[camera].project(seen), atol=1e-4)


def test_colmap_needs_pictures(vector, tmp_path, capsys):
    bare = converted(vector, tmp_path / "bare", "npz")
    assert "frames of frame_left, frame_right are left out" in capsys.readouterr().err
    line = command_refused(capsys, "convert", str(bare), str(tmp_path / "c"), "--to", "colmap")
    assert "choose nerfstudio" in line
    assert not (tmp_path / "c").exists()


def test_eventnerfs_frame_views_are_pinhole_pictures(vector, tmp_path):
    folder = converted(vector, tmp_path / "e", "eventnerf") / "frame1" / "train"
    assert sorted(path.name for path in folder.iterdir()) == ["intrinsics", "pose", "rgb"]
    for k, t_us in enumerate(world.TRUTH_US):
        T, lens = true_view(vector, 1, t_us)
        np.testing.assert_allclose(np.loadtxt(folder / f"pose/{k:06d}.txt"), T, atol=1e-6)
        K = np.loadtxt(folder / f"intrinsics/{k:06d}.txt")[:3, :3] - [
            [0, 0, 0.5],
            [0, 0, 0.5],
            [0] * 3,
        ]
        rays = np.moveaxis(np.indices((lens.height_px, lens.width_px))[::-1], 0, -1)
        bearing = (rays - K[:2, 2]) / [K[0, 0], K[1, 1]]
        seen = cv2.imread(str(folder / f"rgb/{k:06d}.png"), -1).astype(float)
        depth_m = world.plane_depth_m(T, bearing)[..., None]
        points = np.concatenate([bearing, np.ones_like(depth_m)], -1) * depth_m
        x, y, _ = np.moveaxis(se3.transform(T, points), -1, 0)
        true = 127 + 60 * np.sin(9 * x) + 60 * np.sin(11 * y)
        off = np.abs(seen - true)[8:-8, 8:-8]
        assert np.median(off) < 2
        assert np.percentile(off, 95) < 6


def test_another_lens_model_is_left_out_of_nerfstudio_and_said(tmp_path, capsys):
    ours = Sequence.open(world.write_sequence(tmp_path / "ours", "kb4", steps=60))
    m3ed = dataset_files.write_m3ed(ours, tmp_path / "m")
    out = converted(m3ed, tmp_path / "n", "nerfstudio")
    assert "frames of frame_left, frame_right, frame_rgb are left out" in capsys.readouterr().err
    views = json.loads((out / "transforms.json").read_text())["frames"]
    assert {view["camera"] for view in views} == {0, 1}
    assert len(list(colmap_points(converted(m3ed, tmp_path / "c", "colmap"), np.ones((1, 3))))) == 9


def test_a_frame_camera_keeps_its_place_where_the_body_was_another(tmp_path):
    """The converted body is camera 0; a camera that took no picture stays in the rig."""
    ours, lens = world.rig_of("radtan"), dataset_files.GREY
    places = tuple(ours.T_body_cam[0] @ dataset_files.beside(k) for k in range(2))
    rig = replace(ours, frame_cameras=Rig("beside", (lens, lens), places, ("grey", "idle")))
    image = dataset_files.gradient(lens, None)
    with SequenceWriter(
        tmp_path / "s", name="s", rig=rig, trajectory=world.trajectory_of(ours), config={}
    ) as writer:
        t_us = np.array([0, 500_000])
        ends = world.events_of(
            ours.cameras[0], writer.trajectory.at(t_us) @ ours.T_body_cam[0], t_us
        )
        writer.append_events(0, ends)
        writer.append_events(1, ends)
        writer.append_beside(0, Photo(1000, 2000, 1.0, image))
    found = open_recording(converted(tmp_path / "s", tmp_path / "t", "sequence"))
    (grey,) = frame_cameras(found)
    np.testing.assert_allclose(grey.T_body_cam, dataset_files.beside(0), atol=1e-9)
    assert found.rig.frame_cameras.camera_names == ("grey", "idle")
    np.testing.assert_allclose(
        found.rig.frame_cameras.T_body_cam[1], dataset_files.beside(1), atol=1e-9
    )
