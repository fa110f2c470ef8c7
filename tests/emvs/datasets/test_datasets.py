"""Data sets in their publishers' layouts: miniatures map like ours; damage is told in one line."""

import random
from pathlib import Path

import numpy as np
import pytest

import point_world as world
from depth_maps import mapped_like
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.export import RecordingExport, write_recording
from eventsweep.emvs.datasets.mvsec_m3ed import open_mvsec
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.main import main
from made_events import assert_same_events
from refusals import refused

DEPTH_M = 2.0
KINDS = ("dsec", "tumvie", "mvsec", "rosbag1", "evt2", "evt3", "aedat4", "npz", "sequence")
T_REF_US = 250_000
CONFIG = MapperConfig(min_depth_m=1.0, max_depth_m=4.0, planes=30, methods=("Alg1/H",))


@pytest.fixture(scope="module")
def ours(tmp_path_factory) -> Path:
    """A plane before a moving pair, as a sequence with ground truth."""
    made = world.fronto_parallel(DEPTH_M)
    path = tmp_path_factory.mktemp("ours") / "plane"
    camera = made.rig.cameras[0]
    with SequenceWriter(
        path, name="plane", rig=made.rig, trajectory=made.trajectory, config={},
        depth_range_m=(1.0, 4.0),
    ) as writer:  # fmt: skip
        for k in range(2):
            writer.append_events(k, made.streams[k])
            depth = np.full((camera.height_px, camera.width_px), DEPTH_M, np.float32)
            writer.append_truth(k, T_REF_US, depth, np.zeros(depth.shape, np.uint8))
    return path


def rewritten(ours: Path, out: Path, kind: str, shift_us: int = 0) -> Path:
    found = open_readable(ours)
    sources = tuple(source for _, source in found.streams)
    write_recording(RecordingExport(found.recording, sources, shift_us, lambda _: None), out, kind)
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_every_layout_maps_to_the_same_depth(ours, tmp_path, kind):
    theirs = rewritten(ours, tmp_path / kind, kind)
    expected, got = mapped_like(ours, ours, CONFIG), mapped_like(theirs, ours, CONFIG)
    assert expected.mask.sum() > 100
    np.testing.assert_array_equal(got.mask, expected.mask)
    np.testing.assert_allclose(got.depth_m[got.mask], expected.depth_m[got.mask], rtol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_every_layout_keeps_events_rig_and_poses(ours, tmp_path, kind):
    a, b = open_recording(ours), open_recording(rewritten(ours, tmp_path / kind, kind))
    for camera in range(2):
        one, two = (r.events(camera, 0, 10**6) for r in (a, b))
        assert_same_events(one, two)
        np.testing.assert_allclose(b.rig.T_body_cam[camera], a.rig.T_body_cam[camera], atol=1e-9)
        assert b.rig.cameras[camera].to_json() == a.rig.cameras[camera].to_json()
    np.testing.assert_array_equal(a.trajectory.t_us, b.trajectory.t_us)
    np.testing.assert_allclose(a.trajectory.positions_m, b.trajectory.positions_m, atol=1e-9)


def test_times_shift_together(ours, tmp_path):
    moved = open_recording(rewritten(ours, tmp_path / "late", "tumvie", 5_000_000))
    before = Sequence.open(ours)
    assert moved.trajectory.span_us[0] == before.trajectory.span_us[0] + 5_000_000
    one, two = before.events(0, 100_000, 200_000), moved.events(0, 5_100_000, 5_200_000)
    np.testing.assert_array_equal(one.t_us + 5_000_000, two.t_us)


@pytest.mark.parametrize("kind", ["dsec", "mvsec", "rosbag1", "aedat4", "npz"])
def test_unix_time_keeps_every_microsecond(ours, tmp_path, kind):
    """Events, poses and ground truth, as recordings of 2017 have them."""
    late_us = 1_504_645_177_500_001
    before, moved = (
        Sequence.open(ours),
        open_recording(rewritten(ours, tmp_path / "k", kind, late_us)),
    )
    one, two = before.events(0, 0, 10**6), moved.events(0, late_us, late_us + 10**6)
    np.testing.assert_array_equal(one.t_us + late_us, two.t_us)
    np.testing.assert_array_equal(before.trajectory.t_us + late_us, moved.trajectory.t_us)
    if kind in ("dsec", "mvsec"):
        assert moved.truth_times_us(0).tolist() == [T_REF_US + late_us]


@pytest.mark.parametrize(("kind", "tolerance"), [("mvsec", 0.0), ("dsec", 0.01)])
def test_ground_truth_survives(ours, tmp_path, kind, tolerance):
    """DSEC's disparity, 4 px here, is rounded to 1/256 px."""
    found = open_recording(rewritten(ours, tmp_path / kind, kind))
    assert found.truth_times_us(0).tolist() == [T_REF_US]
    depth_m = found.truth_view_depth_m(0, T_REF_US)
    np.testing.assert_allclose(depth_m, DEPTH_M, atol=tolerance)
    refused("nearest time is 250000", found.truth_view_depth_m, 0, 7)


def test_a_tumvie_marker_off_the_camera_is_undone(ours, tmp_path):
    """Poses of a marker, with the hand-eye calibration, give the camera's own poses."""
    import json

    from eventsweep.emvs.formats.calibration_writers import pose_values
    from eventsweep.emvs.geometry import se3

    folder = rewritten(ours, tmp_path / "t", "tumvie")
    T_imu_marker = se3.from_quat_xyzw(np.array([0.1, -0.2, 0.05]), np.array([0, 0.6, 0, 0.8]))
    marker = {"value0": {"T_imu_marker": pose_values(T_imu_marker)}}
    (folder / "mocap-imu-calibrationA.json").write_text(json.dumps(marker))
    plain = Sequence.open(ours).trajectory
    tracked = plain.times(T_imu_marker)  # the IMU is the left camera here
    rows = np.column_stack([tracked.t_us, tracked.positions_m, tracked.quats_xyzw])
    text = "\n".join(f"{int(r[0])} " + " ".join(f"{v:.12f}" for v in r[1:]) for r in rows)
    (folder / "plane-vi_gt_data" / "mocap_data.txt").write_text("# t\n" + text)
    np.testing.assert_allclose(
        open_recording(folder).trajectory.positions_m, plain.positions_m, atol=1e-9
    )


def test_a_bag_needs_no_calibration_file(ours, tmp_path):
    folder = rewritten(ours, tmp_path / "bag", "rosbag1")
    assert {path.name for path in folder.iterdir()} == {"plane.bag", ".eventsweep.json"}
    assert open_recording(folder / "plane.bag").rig.baseline_m() == pytest.approx(0.1)


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
    ('[calibration]\nfile="a\\u0000b"', "calibration.file: String should match"),
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


def test_real_trajectories_parse_and_evaluate(shared_data):
    from eventsweep.emvs.data.poses import read_poses

    for path in sorted(shared_data.rglob("*.tum.txt")):
        poses = read_poses(path)
        middle = sum(poses.span_us) // 2
        assert np.isfinite(poses.at(middle)).all(), path


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
