"""From the files of EvSLAM, ESVO2, TUM-VIE and DSEC to a scored trajectory, by one command each."""

import json

import numpy as np
import pytest
import yaml

import dataset_files
import dataset_world
import line_world
from eventsweep.emvs.data.poses import read_poses, write_tum
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import read_results
from eventsweep.plugins.track import folder as track_folder
from refusals import command_refused

FAST = ["--planes", "40", "--map-s", "0.2", "--map-rate-hz", "8"]


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    """A pair that sways among edges, in our layout."""
    made, path = line_world.swaying(450_000), tmp_path_factory.mktemp("ours") / "swaying"
    with SequenceWriter(
        path, name="swaying", rig=made.rig, trajectory=made.trajectory, config={},
        depth_range_m=made.depth_range_m,
    ) as writer:  # fmt: skip
        for k, events in enumerate(made.streams):
            writer.append_events(k, events)
    return path


def evslam(ours, folder, truth="groundtruth/slider_fast.tum"):
    return [dataset_files.write_evslam(Sequence.open(ours), folder, truth) / "slider_fast.bag"]


def challenge(ours, folder):
    """As the challenge lays it out: poses with velocities."""
    return evslam(ours, folder, "gt/slider_fast_gt.txt")


def esvo2(ours, folder):
    bag = dataset_files.write_esvo2(Sequence.open(ours), folder / "hnu") / "hnu.bag"
    return [bag, "--truth", folder / "hnu_gt.txt"]


def tumvie(ours, folder):
    return [dataset_world.rewritten(ours, folder / "mocap-6dof", "tumvie")]


def dsec(ours, folder):
    return [dataset_world.rewritten(ours, folder / "zurich_city_04_a", "dsec")]


RECIPES = {"evslam": evslam, "challenge": challenge, "esvo2": esvo2, "tumvie": tumvie, "dsec": dsec}


def tracked(command, out, capsys):
    """The facts that a track prints."""
    depth = ["--min-depth-m", "0.5", "--max-depth-m", "4"]
    main(["track", *map(str, command), "--out", str(out), *FAST, *depth, "--json"])
    return json.loads(capsys.readouterr().out)


@pytest.fixture(scope="module")
def expected(ours, tmp_path_factory):
    """What is found of the recording in our own layout."""
    out = tmp_path_factory.mktemp("expected") / "out"
    main(["track", str(ours), "--out", str(out), *FAST, "--quiet"])
    return out


@pytest.mark.parametrize("layout", RECIPES)
def test_one_command_leads_from_a_publishers_files_to_scores(
    layout, ours, expected, tmp_path, capsys
):
    facts = tracked(RECIPES[layout](ours, tmp_path), tmp_path / "out", capsys)
    poses, same = (read_poses(out / "trajectory.txt") for out in (tmp_path / "out", expected))
    np.testing.assert_allclose(poses.positions_m, same.positions_m, atol=2e-4)
    values = facts["score"]["values"]
    assert 0 < values["ate_share"] < 2  # %
    assert values["scale_error"] < 2  # %
    assert 0.2 < values["way"] < 0.3
    assert values["time_covered"] > 95
    rows = read_results(tmp_path / "out").rows.set_index("metric")["value"]
    assert rows["ate_rmse"] == values["ate_rmse"]
    assert rows["rpe_translation_10pct"] > 0
    assert json.loads((tmp_path / "out/track.json").read_text())["score"] == facts["score"]
    page = (tmp_path / "out/report.html").read_text()
    assert "ATE" in page
    assert "results.json" in page


def test_the_truth_changes_the_scores_and_not_the_track(ours, expected, tmp_path, capsys):
    true = Sequence.open(ours).trajectory
    write_tum(tmp_path / "twice.txt", Trajectory(true.t_us, 2 * true.positions_m, true.quats_xyzw))
    facts = tracked([ours, "--truth", tmp_path / "twice.txt"], tmp_path / "out", capsys)
    for name in ("trajectory.txt", "covariances.txt", "cloud.ply"):
        assert (tmp_path / "out" / name).read_bytes() == (expected / name).read_bytes()
    assert 90 < facts["score"]["values"]["scale_error"] < 110


def test_dsec_without_poses_says_what_scores_need(ours, tmp_path, monkeypatch, capsys):
    truly = line_world.tracked_truly(Sequence.open(ours))
    monkeypatch.setattr(track_folder, "track", lambda *_, **__: truly)
    (folder,) = dsec(ours, tmp_path)
    (folder / "poses.txt").rename(tmp_path / "lidar.txt")
    command = ["track", str(folder), "--out"]
    assert main([*command, str(tmp_path / "a")]) == 0
    said = capsys.readouterr().out
    assert "not scored: no true poses (no poses.txt with T_world_cam of the left" in said
    assert "give --truth FILE" in said
    assert not (tmp_path / "a/results.json").exists()
    facts = json.loads((tmp_path / "a/track.json").read_text())
    assert facts["score"]["not_scored"].startswith("no true poses")
    assert main([*command, str(tmp_path / "b"), "--truth", str(tmp_path / "lidar.txt")]) == 0
    assert read_results(tmp_path / "b").rows["value"].iloc[0] < 1e-9
    again = next(line for line in capsys.readouterr().out.splitlines() if "--associate" in line)
    words = again.partition(": eventsweep ")[2].replace("[--associate ...]", "--associate nearest")
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 0


def test_a_truth_of_another_time_or_kind_is_refused_before_tracking(ours, tmp_path, capsys):
    true = Sequence.open(ours).trajectory
    late = Trajectory(true.t_us + 10**9, true.positions_m, true.quats_xyzw)
    write_tum(tmp_path / "late.txt", late)
    (tmp_path / "odd.txt").write_text("1 2 3\n")
    command = ["track", str(ours), "--out", str(tmp_path / "out"), "--truth"]
    line = command_refused(capsys, *command, str(tmp_path / "late.txt"))
    assert "late.txt: poses from 1000.0" in line
    assert "events' clock" in line
    assert "line 1: 3 numbers" in command_refused(capsys, *command, str(tmp_path / "odd.txt"))
    assert not (tmp_path / "out").exists()


def without(name):
    def change(folder):
        next(folder.rglob(name)).unlink()

    return change


def rewritten_yaml(name, edit):
    def change(folder):
        path = next(folder.rglob(name))
        values = yaml.safe_load(path.read_text())
        edit(values)
        path.write_text(yaml.safe_dump(values))

    return change


def cut(values):
    """ESVO2's own file for DSEC has nine of the twelve numbers."""
    values["T_right_left"]["data"] = values["T_right_left"]["data"][:9]


@pytest.mark.parametrize(("layout", "change", "line"), [
    ("evslam", without("calib_results_cam.txt"), "put a Kalibr camera chain beside the bag"),
    ("evslam", rewritten_yaml("calib_results_cam.txt", lambda v: v["cam1"].pop("intrinsics")),
     "cam1.intrinsics is missing"),
    ("evslam", rewritten_yaml("calib_results_cam.txt", lambda v: v["cam1"].pop("rostopic")),
     "choose the calibration's cameras"),
    ("esvo2", without("left.yaml"), "put a Kalibr camera chain beside the bag"),
    ("esvo2", rewritten_yaml("left.yaml", cut), "T_right_left"),
    ("tumvie", without("camera-calibration*.json"), "lacks the camera calibration"),
    ("dsec", without("cam_to_cam.yaml"), "lacks the calibration"),
])  # fmt: skip
def test_wrong_calibrations_are_refused_in_one_line(layout, change, line, ours, tmp_path, capsys):
    command = RECIPES[layout](ours, tmp_path)
    change(tmp_path)
    said = command_refused(capsys, "track", *map(str, command), "--out", str(tmp_path / "out"))
    assert line in said
    assert not (tmp_path / "out").exists()


def test_two_calibrations_of_evslam_need_a_choice(ours, tmp_path, capsys):
    (bag,) = evslam(ours, tmp_path)
    one = tmp_path / "calibration" / "calib_results_cam.txt"
    for name in ("drone", "others"):
        (one.parent / f"calib_results_cam_{name}.txt").write_text(one.read_text())
    one.unlink()
    said = command_refused(capsys, "track", str(bag), "--out", str(tmp_path / "out"))
    assert "2 candidates for the calibration" in said
    one.with_name("calib_results_cam_others.txt").unlink()
    assert len(open_recording(bag).rig) == 2
