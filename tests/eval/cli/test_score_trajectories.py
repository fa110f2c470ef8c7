"""`eventsweep score --truth`: a folder with results and a page, refusals, gate and compare."""

import json
import re
from unittest import mock

import numpy as np
import pytest

import eventsweep as es
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.eval.cli.main import main
from eventsweep.eval.report.trajectory_page import write_scores
from made_trajectories import moved, noisy, part, room
from point_world import pinhole, stereo_rig
from refusals import command_refused, untouched
from report_data import WellFormed

TRUTH = room(6.0, 50)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """True poses, a good estimate, a tracker's folder with a gap, and one of another clock."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tracked").mkdir()
    good = moved(noisy(TRUTH, sigma_m=0.002))
    es.write_tum("gt.txt", TRUTH)
    es.write_tum("good.txt", good)
    es.write_tum("tracked/trajectory.txt", part(moved(noisy(TRUTH), 5), np.r_[0:90, 150:280]))
    es.write_tum("far.txt", es.Trajectory(good.t_us + 10**12, good.positions_m, good.quats_xyzw))
    return tmp_path


def run(*words):
    return main([str(word) for word in words])


def test_several_estimates_are_scored_into_a_folder(files, capsys):
    words = ("score", "good.txt", "tracked", "again=good.txt", "--truth", "gt.txt", "--out", "out")
    assert run(*words) == 0
    printed = capsys.readouterr()
    assert "gt: Estimates are aligned with the truth by a rigid motion" in printed.out.replace(
        "\n", " "
    )
    assert {path.name for path in (files / "out").iterdir()} == {
        "results.json", "results.csv", "report.html", ".eventsweep.json",
    }  # fmt: skip
    rows = es.read_results("out").to_dataframe()
    assert list(rows["method"].unique()) == ["good", "tracked", "again"]
    ates = rows[rows.metric == "ate_rmse"].set_index("method")["value"]
    assert ates["good"] == ates["again"] < ates["tracked"]
    expected = es.score_trajectory("good.txt", "gt.txt").to_results("gt", "good").to_dataframe()
    assert rows[rows.method == "good"].reset_index(drop=True).equals(expected)
    for row in rows.itertuples():
        metric = es.METRICS[row.metric]
        assert (row.unit, row.direction) == (metric.unit, metric.direction)
    assert "--force" in command_refused(capsys, *words)
    assert run(*words, "--force", "--align", "sim3", "--case", "room", "--json") == 0
    assert json.loads(capsys.readouterr().out)["configuration"]["score"]["align"] == "sim3"
    assert set(es.read_results("out").rows["case"]) == {"room"}


def test_a_header_says_the_unit_and_a_flag_may_not_contradict(files, capsys):
    """Written in ns with `qw` first, the estimate scores as it did in TUM's columns."""
    rows = [
        f"{t_us}000,{','.join(map(repr, [*map(float, place), float(q[3]), *map(float, q[:3])]))}"
        for t_us, place, q in zip(TRUTH.t_us, TRUTH.positions_m, TRUTH.quats_xyzw, strict=True)
    ]
    text = "\n".join(["#timestamp [ns],x,y,z,qw,qx,qy,qz", *rows, rows[-1]])
    (files / "ns.csv").write_text(text, encoding="utf-8-sig")
    words = ("score", "ns.csv", "--truth", "gt.txt", "--json", "--out", "out")
    assert run(*words) == 0
    assert "poses repeat the time before them" in capsys.readouterr().out
    assert run(*words, "--unit", "ns", "--force") == 0
    capsys.readouterr()
    for flag in (("--unit", "s"), ("--unit", "us")):
        assert "leave the setting out" in command_refused(capsys, *words, "--force", *flag)
    words = ("score", "good.txt", "--truth", "ns.csv", "--truth-unit", "ms", "--out", "other")
    assert "leave the setting out" in command_refused(capsys, *words)


def test_the_page_shows_paths_errors_and_boxes_and_needs_no_network(files):
    run("score", "good.txt", "<b>=tracked", "--truth", "gt.txt", "--out", "out")
    text = (files / "out" / "report.html").read_text("utf-8")
    WellFormed(text)
    assert text.count("<svg") == 3
    for name in ("path-above", "path-side", "errors-translation", "errors-rotation"):
        assert [f'id="{name}-{k}"' in text for k in (0, 1)] == [True, True]
    assert "<b>=" not in text
    assert "_b_" in text
    assert not re.search(r'(?:src|href)="http', text)
    # Where the track was lost, the path and the errors are interrupted.
    drawn = re.search(r'<g id="path-above-1">\s*<path d="([^"]*)"', text)[1]
    assert drawn.count("M") == 2


def test_a_page_without_relative_errors_has_its_figures(files):
    """Of a truth that does not move, or of steps longer than all of the way."""
    still = es.Trajectory(TRUTH.t_us, 0 * TRUTH.positions_m, TRUTH.quats_xyzw)
    es.write_tum("still.txt", still)
    assert run("score", "good.txt", "tracked", "--truth", "still.txt", "--out", "out") == 0
    longer = ("--rpe-distances-m", "1e6", "--rpe-times-s", "1e6", "--rpe-angles-deg", "1e6")
    assert run("score", "good.txt", "--truth", "gt.txt", "--out", "out2", *longer) == 0
    for out in ("out", "out2"):
        assert (files / out / "report.html").read_text("utf-8").count("<svg") == 3


def test_poses_of_a_recording_are_a_truth(files):
    rig = stereo_rig(pinhole(12, 9, 10.0), 0.1)
    with SequenceWriter(files / "seq", name="world", rig=rig, trajectory=TRUTH, config={}):
        pass
    assert run("score", "good.txt", "--truth", "seq", "--out", "out", "--quiet") == 0
    assert set(es.read_results("out").rows["case"]) == {"world"}
    by_path = es.score_trajectory("good.txt", "seq").values
    assert by_path == es.score_trajectory(es.read_poses("good.txt"), es.Sequence("seq")).values


def test_poses_that_were_found_are_no_cure_for_a_truth_without_any(files, capsys):
    rig = stereo_rig(pinhole(12, 9, 10.0), 0.1)
    with SequenceWriter(files / "seq", name="world", rig=rig, trajectory=TRUTH, config={}):
        pass
    (files / "seq" / "poses.txt").unlink()
    with untouched(files):
        said = command_refused(capsys, "score", "good.txt", "--truth", "seq", "--out", "out")
    assert "seq: has no true poses: name a file of them" in said
    assert "eventsweep track" not in said


@pytest.mark.parametrize(("words", "said"), [
    ("good.txt --truth gt.txt", "add --out"), ("good.txt --out out", "add --truth"),
    ("good.txt --align sim3", "add --truth"), ("good.txt tracked", "trajectories need --truth"),
    ("good.txt good.txt --truth gt.txt --out out", "two estimates are called good"),
    ("=good.txt --truth gt.txt --out out", "needs NAME=FILE"),
    ("far.txt --truth gt.txt --out out", "add --offset-s, such as -1000000"),
    (". --truth gt.txt --out out", "a folder without trajectory.txt"),
    ("none.txt --truth gt.txt --out out", "No such file"),
    ("good.txt --truth none --out out", "No such file"),
    ("good.txt --truth tracked --out out", "not recognised as a recording"),
    ("good.txt --truth gt.txt --out out --prediction x", "--prediction is for maps"),
    ("good.txt --truth gt.txt --out out --score.border-px 3", "--score. is for maps"),
    ("good.txt --truth gt.txt --out out --max-difference-s -1", "--max-difference-s is '-1'"),
    ("good.txt --truth gt.txt --out out --associate evo", "one-to-one"),
])  # fmt: skip
def test_what_cannot_be_scored_is_refused_in_one_line_and_leaves_nothing(
    files, capsys, words, said
):
    with untouched(files):
        assert said in command_refused(capsys, "score", *words.split())


def test_an_interrupt_leaves_nothing(files, monkeypatch):
    page = "eventsweep.eval.report.trajectory_page.page_text"
    monkeypatch.setattr(page, mock.Mock(side_effect=KeyboardInterrupt))
    with untouched(files):
        assert run("score", "good.txt", "--truth", "gt.txt", "--out", "a/out") == 130


@pytest.mark.slow
def test_the_gate_and_compare_take_trajectories(files, capsys):
    """A worse estimate is red and named; the same one is green; another truth is no comparison."""
    worse = noisy(es.read_poses("good.txt"), seed=8, sigma_m=0.01)
    es.write_tum("worse.txt", worse)
    for name in ("good", "worse"):
        write_scores([f"mine={name}.txt"], files / "gt.txt", files / name, es.TrajectoryConfig())
    baseline = ("gate", "--baseline", "baseline.json", "--result")
    assert run(*baseline, "good", "--update", "--reason", "first", "--quiet") == 0
    assert run(*baseline, "good", "--quiet") == 0
    capsys.readouterr()
    assert run(*baseline, "worse", "--json") == 1
    verdicts = {one["metric"]: one for one in json.loads(capsys.readouterr().out)}
    deciding = {name for name, one in verdicts.items() if one["decides"]}
    assert deciding == {"ate_rmse", "ate_rotation_rmse", "drift", "time_covered"}
    assert verdicts["ate_rmse"]["status"] == verdicts["drift"]["status"] == "worse"
    assert verdicts["time_covered"]["status"] == "same"
    assert run("compare", "good", "worse", "--out", "compared") == 0
    text = (files / "compared" / "compare.html").read_text("utf-8")
    assert "ATE rotation" in text
    assert "worse here" in text
    es.write_tum("gt.txt", moved(TRUTH, 9))
    write_scores(["mine=good.txt"], files / "gt.txt", files / "other", es.TrajectoryConfig())
    assert run(*baseline, "other", "--json") == 1
    assert "not comparable" in capsys.readouterr().out
