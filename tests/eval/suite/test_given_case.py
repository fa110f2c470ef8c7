"""A case of a suite whose sequence is given: what it scores is what the simulated twin scores."""

import json
from dataclasses import replace

import numpy as np
import pytest

import eventsweep as es
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import read_results
from eventsweep.eval.results.table import POOLED
from refusals import command_refused
from small_suite import case, suite_text

pytestmark = pytest.mark.usefixtures("blank_figures")

SHIFT_US, SECONDS = 7_000_000, 0.04
THRESHOLDS = {"contrast_threshold_pos": 0.4, "contrast_threshold_neg": 0.5}
REAL = """[cases.real]
scene = "./real"
seconds = 0.04
windows = [{ start_s = 0.0, duration_s = 0.02 }, { start_s = 0.02, duration_s = 0.02 }]
"""
TEXT = suite_text(case("wall"), REAL, seeds=(0, 1))


def recorded(out):
    """The sequence of the case `wall` with seed 0 as a recording on a clock of its own."""
    config = es.SimConfig(duration_s=SECONDS, truth_times_s=(0.01, 0.03), **THRESHOLDS)
    es.simulate("planes", out.with_name("drawn"), config, seed=0, rig="rpg")
    drawn = es.open_recording(out.with_name("drawn"))
    first_us, last_us = drawn.manifest.span_us
    poses = replace(drawn.trajectory, t_us=drawn.trajectory.t_us + SHIFT_US)
    with SequenceWriter(
        out, name="real", rig=drawn.rig, trajectory=poses, renderer="none", config={},
        depth_range_m=drawn.manifest.depth_range_m,
        span_us=(first_us + SHIFT_US, last_us + SHIFT_US),
    ) as writer:  # fmt: skip
        for camera in range(len(drawn.rig)):
            x, y, t_us, p = drawn.events(camera, first_us, last_us).columns
            writer.append_events(camera, Events(x, y, t_us + SHIFT_US, p))
            for t in drawn.truth_times_us(camera).tolist():
                depth_m = drawn.truth_depth_m(camera, t)
                light = np.zeros(depth_m.shape, np.uint8)
                view = {"view_depth_m": drawn.truth_view_depth_m(camera, t)}
                writer.append_truth(camera, t + SHIFT_US, depth_m, light, view)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The suite's file and the recording beside it."""
    folder = tmp_path_factory.mktemp("given")
    recorded(folder / "real")
    (folder / "pair.toml").write_text(TEXT)
    return folder


def words(place, *more):
    given = ("suite", place / "pair.toml", "--cache", place / "cache", *more)
    return [str(word) for word in given]


def run(place, out, *more):
    quiet = "--workers", "1", "--no-speed", "--quiet"
    return main(words(place, "--out", out, *quiet, *more))


@pytest.mark.slow
def test_a_recording_scores_as_its_simulated_twin_and_enters_the_ranking(place, tmp_path, capsys):
    assert main(words(place, "--list-cases", "--json")) == 0
    listed = json.loads(capsys.readouterr().out)["sequences"]
    assert [(one["case"], one["seed"]) for one in listed] == [("wall", 0), ("real", 0), ("wall", 1)]
    times = [window["t_ref_us"] for window in listed[1]["windows"]]
    assert times == [SHIFT_US + 10_000, SHIFT_US + 30_000]
    theirs = tmp_path / "theirs"
    for number, window in enumerate(w for one in listed for w in one["windows"]):
        (theirs / window["file"]).parent.mkdir(parents=True, exist_ok=True)
        np.savez(theirs / window["file"], depth_m=np.full((180, 240), 2.0 + number / 100))
    assert run(place, tmp_path / "out", "--prediction", f"flat={theirs}") == 0
    rows = read_results(tmp_path / "out").rows
    rows = rows[(rows["window"] == POOLED) & (rows["seed"] == 0) & (rows["method"] != "events")]
    rows = rows[rows["metric"].isin(["points", "mean_error", "completeness"])]
    table = rows[rows["method"] == "Alg1/H"].pivot(index="metric", columns="case", values="value")
    np.testing.assert_allclose(table["real"], table["wall"], rtol=2e-3)
    assert "Given/flat" in set(rows[rows["case"] == "real"]["method"])
    assert main(["ranking", str(tmp_path / "out"), "--out", str(tmp_path / "p"), "--quiet"]) == 0
    text = (tmp_path / "p" / "ranking.json").read_text()
    assert json.loads(text)["entries"][0]["cases"]["real"]["scene"] == "real"
    assert str(place) not in text


def test_settings_of_the_simulator_are_refused(place, capsys):
    for line in ('rig = "rpg"', "sim = { duration_s = 1.0 }"):
        (place / "wrong.toml").write_text(TEXT + f"\n{line}\n")
        said = command_refused(capsys, "suite", str(place / "wrong.toml"), "--list-cases")
        assert "is for scenes, its sequence is given: remove it" in said


def test_a_recording_without_truth_or_one_that_changed_is_refused(place, tmp_path, capsys):
    bare = tmp_path / "real"
    recorded(bare)
    (tmp_path / "pair.toml").write_text(TEXT)
    events = bare / "cam0" / "events.h5"
    data = bytearray(events.read_bytes())
    data[len(data) // 2] ^= 1
    events.write_bytes(data)
    assert run(tmp_path, tmp_path / "out", "--case", "real") == 1
    assert "changed since it was made" in str(read_results(tmp_path / "out").failures)
    (bare / "poses.txt").unlink()
    said = command_refused(capsys, *words(tmp_path, "--list-cases"))
    assert "has no true poses or depth" in said


def test_it_is_not_archived(place, tmp_path, capsys):
    words = "archive", "make", place / "pair.toml", "--out", tmp_path / "frozen", "--quiet"
    said = command_refused(capsys, *map(str, words))
    assert "case real: its sequence is given, not drawn" in said
    assert not (tmp_path / "frozen").exists()
