"""Recordings without poses open in every layout; only what needs poses refuses, in one line."""

import json

import numpy as np
import pytest

import dataset_world as world
from dataset_world import rewritten
from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.recording import has_poses
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.eval.cli.main import main
from refusals import command_refused, refused

# Where each layout keeps its poses
POSES = {
    "sequence": "poses.txt", "dsec": "poses.txt", "tumvie": "plane-vi_gt_data/mocap_data.txt",
    "mvsec": "plane_gt.hdf5", "npz": "poses.txt",
}  # fmt: skip


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    return world.write_sequence(tmp_path_factory.mktemp("poseless") / "ours", "kb4", steps=100)


def without_poses(ours, folder, kind):
    rewritten(ours, folder, kind)
    (folder / POSES[kind]).unlink()
    descriptor = folder / "recording.toml"
    if kind == "npz":
        text = descriptor.read_text()
        descriptor.write_text(text.replace('[poses]\nfile = "poses.txt"\n', ""))
        assert "poses" not in descriptor.read_text()
    return folder


@pytest.mark.parametrize("kind", POSES)
def test_every_layout_opens_without_poses_and_is_written_without(ours, tmp_path, kind):
    folder = without_poses(ours, tmp_path / "rec", kind)
    found, whole = open_recording(folder), Sequence.open(ours)
    assert not has_poses(found)
    assert "no poses" in repr(found)
    refused("has no poses.*trajectory.txt that `eventsweep track` writes", lambda: found.trajectory)
    for camera in range(2):
        np.testing.assert_array_equal(
            found.events(camera, 0, 1 << 40).x, whole.events(camera, 0, 1 << 40).x
        )
    assert "; no poses" in open_readable(folder).what
    for again in {"npz", "rosbag1", kind}:
        copy = rewritten(folder, tmp_path / f"as-{again}", again)
        assert not has_poses(open_recording(copy))


def test_the_event_camera_dataset_opens_without_poses(tmp_path):
    (tmp_path / "events.txt").write_text("0.1 1 2 1\n0.2 3 4 0\n")
    (tmp_path / "calib.txt").write_text("200 200 120 90 0 0 0 0 0")
    found = open_recording(tmp_path)
    assert len(found.events(0, 0, 10**6)) == 2
    # Events of one camera alone give no poses, so `track` is no cure.
    refused("has no poses .no groundtruth.txt.: name a file of them", lambda: found.trajectory)


def test_verbs_that_need_no_poses_do_without(ours, tmp_path, capsys):
    folder = without_poses(ours, tmp_path / "rec", "npz")
    assert main(["info", str(folder), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)["recording"]
    assert (facts["poses"], len(facts["cameras"])) == (0, 2)
    assert main(["info", str(folder)]) == 0
    assert "none" in capsys.readouterr().out
    assert main(["convert", str(folder), str(tmp_path / "rig.yaml"), "--to", "kalibr"]) == 0
    out, events = tmp_path / "m", tmp_path / "a.bag"
    assert main(["convert", str(folder), str(events), "--to", "rosbag1", "--quiet"]) == 0
    assert events.is_file()
    capsys.readouterr()
    for command in (
        ["map", str(folder), "--out", str(out)],
        ["convert", str(folder), str(out), "--to", "tum"],
        ["convert", str(folder), str(out), "--to", "nerfstudio"],
    ):
        assert "has no poses" in command_refused(capsys, *command)
        assert not out.exists()


def test_poses_found_are_named_in_a_recording_toml(ours, tmp_path):
    folder = without_poses(ours, tmp_path / "rec", "npz")
    write_tum(folder / "trajectory.txt", Sequence.open(ours).trajectory)
    with (folder / "recording.toml").open("a") as file:
        file.write('[poses]\nfile = "trajectory.txt"\n')
    assert has_poses(open_recording(folder))
    (folder / "trajectory.txt").write_text("1e18 0 0 0 0 0 0 1\n")
    refused("set poses.unit to 'ns'", open_recording, folder)


def test_convert_asks_for_another_name_than_one_of_its_sources(ours, tmp_path, capsys):
    folder = rewritten(ours, tmp_path / "rec", "npz")
    before = (folder / "poses.txt").read_bytes()
    for target in (folder / "poses.txt", folder):
        to = "tum" if target.suffix else "npz"
        words = command_refused(capsys, "convert", str(folder), str(target), "--to", to, "--force")
        assert "choose another name" in words
    assert (folder / "poses.txt").read_bytes() == before
    assert main(["convert", str(folder), str(folder / "new.txt"), "--to", "tum"]) == 0
