"""What a data set lacks, or holds damaged, is never passed over: one line says file and place."""

import struct
import subprocess
import sys
from itertools import pairwise

import h5py
import numpy as np
import pytest
import yaml

import dataset_files
import dataset_world as world
from dataset_world import rewritten
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.eval.cli.main import main
from refusals import refused


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("missing")
    return Sequence.open(world.write_sequence(folder / "ours", "kb4", steps=100))


TOPICS = {"info": "/cam0/camera_info", "poses": "/cam0/pose"}
KINDS = {"info": "sensor_msgs/msg/CameraInfo", "poses": "geometry_msgs/msg/PoseStamped"}


def bag_of(sequence, path, absent=None, damage=b"", damaged=None):
    """ESIM's topics of one camera, of which one of `info` and `poses` is absent or damaged."""
    with dataset_files.Bag(path) as bag:
        bag.events("/cam0/events", dataset_files.everything(sequence, 0), (96, 64))
        if "info" not in (absent, damaged):
            bag.camera_info(TOPICS["info"], sequence.rig.cameras[0], 0)
        if "poses" not in (absent, damaged):
            T_world_cam = dataset_files.T_world_cam(sequence, 0)
            bag.poses(TOPICS["poses"], sequence.trajectory.t_us, T_world_cam)
        if damaged is not None:
            bag.raw(TOPICS[damaged], KINDS[damaged], 0, damage)
    return path


@pytest.mark.parametrize("damage", [b"", b"\xff" * 20, bytes(400)])
@pytest.mark.parametrize("piece", ["info", "poses"])
def test_damaged_pieces_of_a_bag_are_refused_and_named(sequence, tmp_path, capsys, piece, damage):
    path = bag_of(sequence, tmp_path / "a.bag", damaged=piece, damage=damage)
    assert main(["info", str(path)]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    assert str(path) in said
    assert TOPICS[piece] in said
    out = tmp_path / "b.npz"
    assert main(["convert", str(path), str(out), "--to", "npz", "--quiet"]) == 2
    assert not out.exists()


@pytest.mark.parametrize(
    ("absent", "why"),
    [("info", "no calibration: no topic /cam0/camera_info"), ("poses", "no poses: no pose topic")],
)
def test_a_bag_without_a_piece_says_so_and_gives_the_others(sequence, tmp_path, absent, why):
    found = open_readable(bag_of(sequence, tmp_path / "a.bag", absent))
    assert why in found.what
    if absent == "info":
        assert found.recording is None
        refused(r"a\.bag", open_recording, tmp_path / "a.bag")
    else:
        assert found.recording.rig.cameras[0] == sequence.rig.cameras[0]
        refused("has no poses", lambda: found.recording.trajectory)


def test_a_choice_of_poses_is_named(sequence, tmp_path):
    with dataset_files.Bag(tmp_path / "a.bag") as bag:
        bag.events("/dvs/events", dataset_files.everything(sequence, 0), (96, 64))
        bag.camera_info("/dvs/camera_info", sequence.rig.cameras[0], 0)
        for topic in ("/head", "/hand"):
            bag.poses(topic, sequence.trajectory.t_us, dataset_files.T_world_cam(sequence, 0))
    assert "poses in /head, /hand: choose one" in open_readable(tmp_path / "a.bag").what


@pytest.mark.parametrize(("own_poses", "words"), [
    # `camera_info` of each camera alone says nothing about the other.
    (False, r"all cameras in the same place.*/cam0/pose, /cam1/pose"),
    (True, r"/cam1/pose: moves by 0\.25"),
])  # fmt: skip
def test_cameras_in_one_place_or_that_move_apart_are_refused(sequence, tmp_path, own_poses, words):
    t_us = sequence.trajectory.t_us
    with dataset_files.Bag(tmp_path / "a.bag") as bag:
        if not own_poses:
            bag.poses("/mocap", t_us, dataset_files.T_world_cam(sequence, 0))
        for k, camera in enumerate(sequence.rig.cameras):
            bag.camera_info(f"/cam{k}/camera_info", camera, 0)
            bag.events(f"/cam{k}/events", dataset_files.everything(sequence, k), (96, 64))
            if own_poses:
                T = dataset_files.T_world_cam(sequence, k)
                T[:, 0, 3] += k * 0.01 * np.arange(len(T))
                bag.poses(f"/cam{k}/pose", t_us, T)
    refused(words, open_recording, tmp_path / "a.bag")


@pytest.mark.parametrize(("file", "group", "words"), [
    ("gt", "left/pose", "lacks davis/left/pose"),
    ("gt", "left/pose_ts", "lacks davis/left/pose_ts"),
    ("gt", "left/depth_image_raw", "depth_image_raw is missing"),
    ("gt", "left/depth_image_raw_ts", "depth_image_raw_ts is missing"),
    ("data", "left/events", "no stream 'davis/left'"),
    ("data", "right/events", "no stream 'davis/right'"),
])  # fmt: skip
def test_groups_that_mvsec_lacks_are_named(sequence, tmp_path, file, group, words):
    folder = rewritten(sequence.path, tmp_path / "m", "mvsec")
    path = next(folder.glob(f"*_{file}.hdf5"))
    with h5py.File(path, "r+") as opened:
        del opened[f"davis/{group}"]
    named = [words, path] if file == "gt" else words
    refused(named, lambda: open_recording(folder).events("right" in group, 0, 1000))


@pytest.mark.parametrize(("gone", "message"), [
    ("disparity/timestamps.txt", "but not disparity/timestamps.txt"),
    ("disparity/event/000002.png", "3 times for 2 disparity images"),
    ("events/right/events.h5", "lacks the right events"),
    ("calibration/cam_to_cam.yaml", "lacks the calibration"),
    ("poses.txt", "has no poses"),
])  # fmt: skip
def test_files_that_dsec_lacks_are_named(sequence, tmp_path, gone, message):
    folder = rewritten(sequence.path, tmp_path / "d", "dsec")
    (folder / gone).unlink()
    asked = "trajectory" if gone == "poses.txt" else "truth_any_time"
    refused(
        message, lambda: (getattr(found := open_recording(folder), asked), found.truth_times_us(0))
    )


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_dsecs_rectify_map_must_be_the_calibrations(sequence, tmp_path):
    folder = rewritten(sequence.path, tmp_path / "d", "dsec")
    signalling = np.array([0x7FA00000], np.uint32).view(np.float32)  # warns as it is converted
    for change, off in ((lambda was: was + 2, "2"), (lambda _: np.repeat(signalling, 2), "nan")):
        with h5py.File(folder / "events/left/rectify_map.h5", "r+") as file:
            assert file["rectify_map"].shape == (64, 96, 2)
            file["rectify_map"][16, 32] = change(file["rectify_map"][16, 32])
        refused(f"row 16, column 32 lies {off} px from", open_recording, folder)


def many_times_more():
    """Anchors that stand for nine of the one before, eight times over."""
    lines = ["a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in pairwise("abcdefghi")]
    return "\n".join([*lines, "cam0: *i"])


@pytest.mark.parametrize(("text", "words"), [
    (many_times_more(), "more than 100000 values"), ("[" * 5000, "not valid JSON or YAML"),
    (yaml.safe_dump({"cam0": {"camera_model": "x" * 10_000}}), "a text of 10000 characters"),
], ids=["many", "deep", "long"])  # fmt: skip
def test_yaml_that_stands_for_more_than_memory_holds_is_refused(tmp_path, text, words):
    (tmp_path / "c.yaml").write_text(text)
    refused(words, read_rig, tmp_path / "c.yaml")


def test_a_filter_without_its_parameters_is_refused(sequence, tmp_path):
    """Blosc does not count its parameters before it reads them: that would end the process."""
    folder = rewritten(sequence.path, tmp_path / "t", "tumvie")
    path = next(folder.glob("*events_left.h5"))
    data = path.read_bytes()
    at = data.index(struct.pack("<H", 32001)) + 6  # behind identifier, length of name and flags
    assert struct.unpack_from("<H", data, at) == (7,)
    path.write_bytes(data[:at] + bytes(2) + data[at + 2 :])
    refused(
        ["filter 32001 with 0 parameters, needs 4", path],
        lambda: open_recording(folder).events(0, 0, 10**6),
    )


CONVERT = """
import resource, sys
from eventsweep.eval.cli.main import main
most = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
raise SystemExit(main(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mvsec", "dsec"])
def test_a_full_disk_is_one_line_and_leaves_nothing(sequence, tmp_path, kind):
    """The disk ends at several places, in events as in maps, poses and ground truth."""
    out, words = tmp_path / "out", ("convert", sequence.path, tmp_path / "out", "--to", kind)
    whole = rewritten(sequence.path, tmp_path / "whole", kind)
    sizes = sorted({path.stat().st_size for path in whole.rglob("*") if path.is_file()})
    for most in (sizes[-1] - 1, sizes[len(sizes) // 2] - 1):
        done = subprocess.run(
            [sys.executable, "-c", CONVERT, str(most), *map(str, words), "--quiet"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 2, done.stderr
        assert len(done.stderr.strip().splitlines()) == 1, done.stderr
        assert "File too large" in done.stderr
        assert [path.name for path in tmp_path.iterdir()] == ["whole"]
    assert not out.exists()
