"""Maps on poses that were found: given the true poses, they and their scores are the true ones."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import RecordingInfo, read_map
from eventsweep.emvs.maps.sliding import map_windows
from eventsweep.emvs.windows import Window
from eventsweep.eval.cli.main import main
from eventsweep.eval.found_poses import method_on_own_poses
from eventsweep.eval.own_poses import map_on_poses
from eventsweep.eval.progress import Silent
from eventsweep.eval.report.ranking import findings
from eventsweep.eval.results.results import read_results
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.trajectories.own_poses import own_estimates, pose_rows
from eventsweep.eval.studies.curves import POSE_METRICS
from eventsweep.eval.studies.definitions import study_named
from eventsweep.eval.studies.run import run_study
from eventsweep.plugins.ranking.entries import entry_of
from in_process import in_process
from line_world import tracked_truly
from refusals import command_refused
from small_pair import small_sequence
from small_suite import case, suite_text

pytestmark = pytest.mark.usefixtures("blank_figures")

CONFIG = MapperConfig(methods=("Alg1/H", "EMVS/cam0"), planes=8, window_s=0.04, stride_s=0.02)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """A recording, its map of sliding windows, and those windows."""
    folder = tmp_path_factory.mktemp("mapped")
    recording = open_recording(small_sequence(folder / "sequence"))
    about = RecordingInfo.of(recording, folder / "sequence", folder / "map")
    map_windows(recording, folder / "map", CONFIG, about)
    stored = read_map(folder / "map")
    windows = {w.name: Window(w.t0_us, w.t1_us, w.t_ref_us, (0, 0)) for w in stored.info.windows}
    return recording, stored, windows, about


def on(poses, mapped, out):
    recording, stored, windows, about = mapped
    map_on_poses(recording, poses, windows, CONFIG, out, about)
    own = read_map(out)
    return own, list(own_estimates(own, stored.windows))


def test_on_the_true_poses_maps_are_the_same_bits(mapped, tmp_path):
    recording, stored, *_ = mapped
    own, estimates = on(recording.trajectory, mapped, tmp_path / "own")
    assert not own.info.skipped
    assert len(estimates) == len(stored.windows) == 4
    for window, own in zip(stored.windows, estimates, strict=True):
        for method in CONFIG.methods:
            true, mine = window.depth_map(method), own[method_on_own_poses(method)]
            np.testing.assert_array_equal(true.mask, mine.mask)
            np.testing.assert_array_equal(true.depth_m, mine.depth_m)


def test_windows_of_one_reference_time_keep_their_own_maps(mapped, tmp_path):
    """A short window inside a long one, about the same view."""
    recording, _, windows, about = mapped
    whole = windows["w001"]
    middle_us = (whole.t1_us - whole.t0_us) // 4
    short = replace(whole, t0_us=whole.t0_us + middle_us, t1_us=whole.t1_us - middle_us)
    both = {"w000": short, "w001": whole}
    map_on_poses(recording, recording.trajectory, both, CONFIG, tmp_path / "own", about)
    own = read_map(tmp_path / "own")
    found = list(own_estimates(own, own.windows))
    for window, estimates in zip(own.windows, found, strict=True):
        mine = estimates[method_on_own_poses("Alg1/H")]
        np.testing.assert_array_equal(mine.depth_m, window.depth_map("Alg1/H").depth_m)
    first, second = (np.asarray(one[method_on_own_poses("Alg1/H")].confidence) for one in found)
    assert not np.array_equal(first, second)


def test_another_world_changes_no_depth(mapped, tmp_path):
    """Found poses begin at the origin: views, and depths in them, do not depend on that."""
    recording, stored, *_ = mapped
    true = recording.trajectory
    elsewhere = se3.exp([3.0, -2, 1, 0.4, -0.2, 2.0]) @ true.at(true.t_us)
    _, estimates = on(Trajectory.from_matrices(true.t_us, elsewhere), mapped, tmp_path / "own")
    for window, own in zip(stored.windows, estimates, strict=True):
        mine, map_ = own["Alg1/H track"], window.depth_map("Alg1/H")
        both = mine.mask & map_.mask
        assert both.sum() > 0.9 * max(mine.mask.sum(), map_.mask.sum()) > 0
        close = np.isclose(mine.depth_m[both], map_.depth_m[both], rtol=1e-3)
        assert close.mean() > 0.9  # rounding may turn equal votes around


def test_a_window_without_poses_is_an_empty_map_and_one_with_some_uses_those(mapped, tmp_path):
    recording, stored, *_ = mapped
    true = recording.trajectory
    late = Trajectory(true.t_us[3:], true.positions_m[3:], true.quats_xyzw[3:])
    own, estimates = on(late, mapped, tmp_path / "own")
    (skipped,) = own.info.skipped
    assert "no pose at the reference time, 20000 µs" in skipped.reason
    assert not any(depth_map.mask.any() for depth_map in estimates[0].values())
    assert own.info.windows[0].t0_us == true.t_us[3]
    assert own.info.windows[0].t_ref_us == stored.info.windows[1].t_ref_us
    np.testing.assert_array_equal(
        estimates[-1]["Alg1/H track"].depth_m, stored.windows[-1].depth_map("Alg1/H").depth_m
    )


@pytest.mark.parametrize("reason", ["tracking could not start", None])
def test_no_poses_are_a_score_of_nothing_covered(mapped, tmp_path, reason):
    """Also where there are too few of them."""
    recording, stored, *_ = mapped
    true = recording.trajectory
    poses = reason or Trajectory(true.t_us[:1], true.positions_m[:1], true.quats_xyzw[:1])
    rows, notes = pose_rows("room", true, poses)
    values = {row.metric: row.value for row in each(rows)}
    assert values.pop("time_covered") == 0
    assert {"ate_rmse", "drift", "way"} <= set(values)
    assert all(math.isnan(value) for value in values.values())
    assert len(notes) == 1
    own, estimates = on(reason or "none", mapped, tmp_path / "own")
    assert len(own.info.skipped) == len(stored.windows)
    assert not any(depth_map.mask.any() for window in estimates for depth_map in window.values())


def no_place(*_arguments, **_settings):
    raise InputError("tracking could not start: too dark")


def values_of(rows, method, window="all"):
    chosen = rows[(rows["method"] == method) & (rows["window"] == window)]
    return dict(zip(chosen["metric"], chosen["value"], strict=True))


def run_with(tracker, out):
    """`run planes --poses track`, with a tracker of ours."""
    flags = ["--rig", "rpg", "--seconds", "0.06", "--method", "Alg1/H", "--map.planes", "20"]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("eventsweep.plugins.track.folder.track", tracker)
        command = ["run", "planes", "--poses", "track", "--out", str(out), *flags, "--quiet"]
        assert main(command) == 0
    return out


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return run_with(tracked_truly, tmp_path_factory.mktemp("run") / "out")


def test_a_run_scores_poses_and_maps_beside_the_true_ones_and_again_alike(run):
    results = read_results(run)
    true, own = (values_of(results.rows, name) for name in ("Alg1/H", "Alg1/H track"))
    assert own["points"] == pytest.approx(true["points"], rel=0.02)
    assert own["median_error"] == pytest.approx(true["median_error"], rel=0.05)
    poses = values_of(results.rows, "track")
    assert poses["ate_rmse"] < 1e-6
    assert poses["time_covered"] > 99
    assert {"ate_rmse", "mean_error"} <= set(results.metrics)
    assert results.configuration["planes"]["track"]["skipped"] == 0
    page = (run / "report.html").read_text("utf-8")
    assert "Alg1/H track" in page
    assert 'href="planes/track/report.html"' in page
    assert any("Poses found from events" in line for line in findings(results.rows, "mean_error"))
    before = read_results(run).rows
    assert main(["score", str(run), "--quiet"]) == 0
    assert read_results(run).rows.equals(before)


@pytest.mark.slow
def test_a_tracker_that_finds_nothing_ends_no_run_and_is_counted(tmp_path):
    results = read_results(run_with(no_place, tmp_path / "out"))
    rows = results.rows
    assert values_of(rows, "track")["time_covered"] == 0
    assert values_of(rows, "Alg1/H track")["points"] == 0
    assert values_of(rows, "Alg1/H")["points"] > 0
    note = results.configuration["planes"]["track"]["notes"]
    assert note == ["tracking could not start: too dark"]


def test_a_mapper_called_track_would_be_mistaken_for_poses(tmp_path, capsys):
    text = suite_text(case("wall", track=True, mappers=["track"]), mappers={"track": {}})
    (tmp_path / "s.toml").write_text(text)
    said = command_refused(capsys, "suite", tmp_path / "s.toml", "--out", tmp_path / "o")
    assert "no mapper may be called 'track'" in said


@pytest.mark.slow
@pytest.mark.parametrize("tracker", [tracked_truly, no_place])
def test_a_suite_may_ask_for_poses_of_its_own(tmp_path, monkeypatch, jobs_in_this_process, tracker):
    monkeypatch.setattr("eventsweep.plugins.track.tracker.track_poses", tracker)
    mappers = {
        name: {"methods": ["Alg1/H"], "planes": planes}
        for name, planes in (("default", 12), ("few", 6))
    }
    text = suite_text(case("wall", track=True, mappers=list(mappers)), mappers=mappers)
    (tmp_path / "s.toml").write_text(text)
    flags = ["--cache", str(tmp_path / "cache"), "--workers", "1", "--quiet"]
    assert main(["suite", str(tmp_path / "s.toml"), "--out", str(tmp_path / "o"), *flags]) == 0
    result = read_results(tmp_path / "o")
    rows, tracks = result.rows, tracker is tracked_truly
    assert values_of(rows, "track")["time_covered"] == pytest.approx(100 * tracks, abs=1)
    for method, own in (("Alg1/H", "Alg1/H track"), ("Alg1/H few", "Alg1/H track few")):
        true, mine = (values_of(rows, name)["points"] for name in (method, own))
        assert mine == (pytest.approx(true, rel=0.05) if tracks else 0)
    assert "ate_rmse" in result.samples[0].metrics
    ranked = entry_of(result, "here")
    assert ranked.poses["track"]["time_covered"]["wall"] == pytest.approx([100 * tracks], abs=1)
    assert ranked.units["time_covered"] == ("%", "higher")
    assert ranked.units["ate_share"] == ("%", "lower")
    assert ranked.versions_of_metrics["ate_share"]
    assert "track" not in ranked.values
    assert main(["report", str(tmp_path / "o"), "--quiet"]) == 0


@pytest.mark.slow
def test_a_study_may_ask_for_poses_of_its_own(tmp_path, monkeypatch):
    """Its errors are those of the calibration that the tracker is given, too."""
    extrinsics = []

    def asked(recording, *_rest):
        extrinsics.append(recording.rig.T_body_cam[1])
        return tracked_truly(recording)

    monkeypatch.setattr("eventsweep.plugins.track.tracker.track_poses", asked)
    study = study_named("stereo-yaw")
    study = replace(study, amounts=study.amounts[:2])
    workers = partial(in_process, 1, tmp_path)
    result = run_study(study, ["Alg1/H"], ["planes"], [0], workers, Silent(), 0.16, track=True)
    assert not result.failures
    names = {(curve.metric, curve.method) for curve in result.curves}
    assert {(metric, "track") for metric in POSE_METRICS} <= names
    assert ("mean_error", "Alg1/H track") in names
    assert not np.allclose(extrinsics[0], extrinsics[1])
    covered = next(curve for curve in result.curves if curve.metric == "time_covered")
    assert covered.mean.min() > 99
