"""Data sets in their publishers' layouts: miniatures map like ours; damage is told in one line."""

import json
import random
import re
from pathlib import Path

import numpy as np
import pytest

import dataset_world as world
from dataset_world import TRUTH_US, rewritten
from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.mvsec_m3ed import open_mvsec
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.calibration_writers import pose_values
from eventsweep.emvs.geometry import se3
from eventsweep.eval.cli.main import main
from made_events import assert_same_events
from refusals import refused

KINDS = ("dsec", "tumvie", "mvsec", "rosbag1", "evt2", "evt3", "aedat4", "npz", "sequence")


@pytest.fixture(scope="module")
def ours(tmp_path_factory) -> Path:
    """A plane before a moving pair, as a sequence with ground truth."""
    return world.write_sequence(tmp_path_factory.mktemp("ours") / "plane", "pinhole", steps=300)


@pytest.mark.parametrize("kind", KINDS)
def test_every_layout_keeps_events_rig_and_poses(ours, tmp_path, kind):
    """So that it maps to the same depth: the body is the first camera in all of them."""
    a, b = open_recording(ours), open_recording(rewritten(ours, tmp_path / kind, kind))
    T_cam0_body = se3.inverse(a.rig.T_body_cam[0])
    for k in range(2):
        assert_same_events(a.events(k, 0, 10**6), b.events(k, 0, 10**6))
        T_cam0_cam = T_cam0_body @ a.rig.T_body_cam[k]
        np.testing.assert_allclose(b.rig.T_body_cam[k], T_cam0_cam, atol=1e-9)
        assert b.rig.cameras[k].to_json() == a.rig.cameras[k].to_json()
    poses = a.trajectory.times(a.rig.T_body_cam[0])
    np.testing.assert_array_equal(poses.t_us, b.trajectory.t_us)
    np.testing.assert_allclose(poses.positions_m, b.trajectory.positions_m, atol=1e-9)


@pytest.mark.parametrize("kind", ["dsec", "tumvie", "mvsec", "rosbag1", "aedat4", "npz"])
@pytest.mark.parametrize("late_us", [5_000_000, 1_504_645_177_500_001])
def test_times_shift_together_and_keep_every_microsecond(ours, tmp_path, kind, late_us):
    """Events, poses and ground truth, as recordings of 2017 have them."""
    if kind == "tumvie" and late_us > 10**9:
        pytest.skip("its index counts every millisecond from 0")
    before = open_recording(ours)
    moved = open_recording(rewritten(ours, tmp_path / "k", kind, late_us))
    one, two = before.events(0, 0, 10**6), moved.events(0, late_us, late_us + 10**6)
    np.testing.assert_array_equal(one.t_us + late_us, two.t_us)
    np.testing.assert_array_equal(before.trajectory.t_us + late_us, moved.trajectory.t_us)
    if kind in ("dsec", "mvsec"):
        assert moved.truth_times_us(0).tolist() == [t_us + late_us for t_us in TRUTH_US]
        refused("the nearest time is", moved.truth_view_depth_m, 0, 7)


def test_a_tumvie_marker_off_the_camera_is_undone(ours, tmp_path):
    """Poses of a marker, with the hand-eye calibration, give the camera's own poses."""
    folder = rewritten(ours, tmp_path / "t", "tumvie")
    plain = open_recording(folder).trajectory
    T_imu_marker = se3.from_quat_xyzw(np.array([0.1, -0.2, 0.05]), np.array([0, 0.6, 0, 0.8]))
    marker = {"value0": {"T_imu_marker": pose_values(T_imu_marker)}}
    (folder / "mocap-imu-calibrationA.json").write_text(json.dumps(marker))
    poses = folder / "plane-vi_gt_data" / "mocap_data.txt"
    write_tum(poses, plain.times(T_imu_marker))  # the IMU is the left camera here
    text = poses.read_text().replace("t_s", "t_us")
    poses.write_text(re.sub(r"(?m)^(\d+)\.(\d{6})", r"\1\2", text))  # s to µs
    np.testing.assert_allclose(
        open_recording(folder).trajectory.positions_m, plain.positions_m, atol=1e-9
    )


def test_a_bag_needs_no_calibration_file(ours, tmp_path):
    folder = rewritten(ours, tmp_path / "bag", "rosbag1")
    assert {path.name for path in folder.iterdir()} == {"plane.bag", ".eventsweep.json"}
    assert open_recording(folder / "plane.bag").rig.baseline_m() == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize("kind", ["dsec", "tumvie", "mvsec", "rosbag1", "npz"])
def test_damaged_files_end_in_one_line(ours, tmp_path, kind):
    """Every file in turn is cut off, emptied, flipped or taken away; never another exception."""
    folder = rewritten(ours, tmp_path / kind, kind)
    rng = random.Random(1)
    told = 0
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        whole = path.read_bytes()
        for data in damaged(whole, rng):
            path.unlink()
            if data is not None:
                path.write_bytes(data)
            said = complaint(folder)
            assert said is None or len(said.splitlines()) == 1, said
            told += said is not None
            path.write_bytes(whole)
    assert told >= 4
    assert complaint(folder) is None


def damaged(whole: bytes, rng: random.Random):
    yield None
    yield b""
    yield whole[: len(whole) // 2]
    yield b"\xff\x00" * 50
    for _ in range(3):
        flipped = bytearray(whole)
        flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
        yield bytes(flipped)


def complaint(folder: Path) -> str | None:
    try:
        found = open_recording(folder)
        for camera in range(2):
            found.event_span_us(camera)
            found.events(camera, 0, 10**6)
        times = getattr(found, "truth_times_us", lambda _: [])(0)
        for t_us in times:
            found.truth_view_depth_m(0, int(t_us))
    except InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize(("text", "message"), [
    ("[", "cannot be read as TOML"),
    ('[calibration]\nfile="a\\u0000b"', "calibration.file.0: String should match"),
    ("name = 'x'", "calibration: Field required"),
    ("[calibration]\nfile='rig.json'\n[poses]\nfile='poses.txt'\nunit='h'\n"
     "[[events]]\nfile='cam0.npz'", "poses.unit"),
    ("[calibration]\nfile='rig.json'\n[poses]\nfile='poses.txt'\n"
     "[[events]]\nfile='cam0.npz'", "1 event streams for 2 calibrated"),
    ("[calibration]\nfile='rig.json'\n[poses]\nfile='absent'\n"
     "[[events]]\nfile='cam0.npz'\n[[events]]\nfile='cam1.npz'", "absent: cannot be read"),
])  # fmt: skip
def test_a_bad_descriptor_and_no_mvsec_at_all_are_refused(ours, tmp_path, text, message):
    refused("lacks the events", open_mvsec, tmp_path)
    folder = rewritten(ours, tmp_path / "d", "npz")
    (folder / "recording.toml").write_text(text)
    refused(message, open_recording, folder)


def test_slider_depth_maps_the_ball_before_the_dartboard(shared_data, tmp_path):
    """A real recording: where its frame shows a ball, a mug and a board on the wall."""
    out = tmp_path / "map"
    words = ("--map.min-depth-m", 0.25, "--map.max-depth-m", 4, "--map.planes", 50)
    command = ("map", shared_data / "slider_depth", "--out", out, *words, "--method", "EMVS/cam0")
    assert main([*map(str, command), "--quiet"]) == 0
    with np.load(out / "w000" / "EMVS-cam0" / "depth.npz") as stored:
        depth_m = np.where(stored["mask"], stored["depth_m"], np.nan)
    ball, mug, board = depth_m[125:165, 115:160], depth_m[125:165, 205:235], depth_m[5:75, 75:145]
    assert min(np.isfinite(part).sum() for part in (ball, mug, board)) > 30
    for near in (ball, mug):
        assert 0.45 < np.nanmedian(near) < 0.75
    assert np.nanmedian(board) > 1.5
