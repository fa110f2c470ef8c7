"""Scores by a data set's own truth near a reference time: DSEC's disparity, MVSEC's depth."""

import json

import numpy as np
import pytest

import dataset_world as world
from dataset_world import rewritten
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.ground_truth import nearest_truth_us, truth_at
from eventsweep.eval.cli.main import main
from refusals import refused
from tiers import often

pytestmark = pytest.mark.usefixtures("blank_figures")

PAIRS = ["radtan dsec", "kb4 mvsec", "kb4 dsec"]
MAP = ("--map.min-depth-m", 1, "--map.max-depth-m", 4, "--map.planes", 40, "--method", "Alg1/H")


@pytest.fixture(scope="module", params=often([PAIRS[0]], PAIRS))
def pair(request, tmp_path_factory):
    model, kind = request.param.split()
    folder = tmp_path_factory.mktemp("truth")
    ours = world.write_sequence(folder / "ours", model)
    return ours, rewritten(ours, folder / kind, kind)


def run(*words) -> int:
    return main([*map(str, words), "--quiet"])


def scores(folder) -> dict[str, float]:
    rows = json.loads((folder / "results.json").read_text())["rows"]
    return {row["metric"]: row["value"] for row in rows if row["window"] == "all"}


def reference_s(path, t_us) -> float:
    """As `reference_s` counts: from the first event."""
    recording = open_recording(path)
    return (t_us - min(recording.event_span_us(k)[0] for k in range(2))) / 1e6


def scored(path, out, t_us, *words) -> int:
    made = run("map", path, "--out", out, *MAP, "--map.reference-s", reference_s(path, t_us))
    assert made == 0
    return run("score", out, *words)


def test_the_same_map_has_the_same_scores_by_the_data_sets_own_truth(pair, tmp_path):
    """DSEC's truth is of 1/256 px, on the pixels that rectification meets: nearly all of them."""
    for path, name in zip(pair, ("ours", "theirs"), strict=True):
        assert scored(path, tmp_path / name, 250_000) == 0
    one, two = scores(tmp_path / "ours"), scores(tmp_path / "theirs")
    assert two["truth_points"] > 0.75 * one["truth_points"]
    assert two["points"] > 0.75 * one["points"] > 100
    assert two["mean_error"] == pytest.approx(one["mean_error"], rel=0.1)
    assert two["abs_rel"] == pytest.approx(one["abs_rel"], rel=0.1)
    assert "outlier_points" in one
    assert "outlier_points" not in two  # causes need intensity and truth of all cameras
    assert two["baseline_focal"] == pytest.approx(one["baseline_focal"])


def test_truth_beside_the_reference_time_needs_a_tolerance(pair, tmp_path, capsys):
    _, theirs = pair
    assert scored(theirs, tmp_path / "off", 260_000) == 2
    said = capsys.readouterr().err
    assert "nearest is -10000 µs away (250000 µs)" in said
    assert len(said.strip().splitlines()) == 1
    assert run("score", tmp_path / "off", "--score.truth-tolerance-s", 0.02) == 0
    assert scores(tmp_path / "off")["points"] > 100
    assert run("report", tmp_path / "off") == 0


def test_truth_is_carried_by_the_poses(pair):
    """The plane's depth is known at any time, so carried truth is compared with it."""
    sequence, found, t_us = Sequence.open(pair[0]), open_recording(pair[1]), 230_000
    bearing = found.rig.cameras[0].undistorted().bearing_table()
    T_world_cam = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[0]
    expected = world.plane_depth_m(T_world_cam, bearing)
    got = truth_at(found, t_us, 20_000)
    known = np.isfinite(got)
    assert known.mean() > 0.6
    np.testing.assert_allclose(got[known], expected[known], rtol=0.01)


def test_the_nearest_truth_is_taken_within_the_tolerance_only(pair):
    found = open_recording(pair[1])
    for t_us, tolerance_us, nearest_us in ((250_000, 0, 250_000), (224_000, 24_000, 200_000)):
        assert nearest_truth_us(found, t_us, tolerance_us) == nearest_us
    refused("no ground truth within 23999 µs", nearest_truth_us, found, 224_000, 23_999)


def test_a_data_set_without_truth_is_described_and_says_what_has_some(pair, tmp_path, capsys):
    bag = rewritten(pair[0], tmp_path / "bag", "rosbag1")
    assert scored(bag, tmp_path / "map", 250_000) == 0
    (tmp_path / "mine").mkdir()
    assert main(["score", str(tmp_path / "map"), "--prediction", str(tmp_path / "mine")]) == 2
    assert "DSEC's disparity, MVSEC's depth, or `[truth]`" in capsys.readouterr().err
