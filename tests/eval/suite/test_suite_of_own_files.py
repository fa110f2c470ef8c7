"""Suites of one's own: models, rigs, sensors and predictions that lie beside the suite's file."""

import shutil

import numpy as np
import pytest

import rover
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import read_results
from eventsweep.eval.suite.definition import load
from refusals import command_refused

SUITE = """
name = "mine-v1"
summary = "a robot of my own"
seeds = [0, 1]
spread_seeds = [0, 1]
metrics = ["points", "mean_error"]
predictions = {{ mine = "depths" }}

[sim]
sampling = "fast"

[mappers.default]
methods = ["Alg1/H", "EMVS/cam0"]
planes = 20

[cases.robot]
scene = "rover.xml"
rig = {rig}
seconds = 0.04
windows = [{{ start_s = 0.0, duration_s = 0.04 }}]
sim.model = {{ motion = "dynamics", mount = "camera:left" }}
"""


def written(folder, rig='"model:left,right"'):
    folder.mkdir()
    rover.write(folder)
    (folder / "mine.toml").write_text(SUITE.format(rig=rig))
    for seed in (0, 1):
        place = folder / "depths" / "robot" / f"seed{seed}"
        place.mkdir(parents=True)
        np.savez(place / "20000.npz", depth_m=np.full((48, 64), 2.0 + seed, np.float32))
    return folder


def test_a_model_and_depths_of_ones_own_end_in_a_table(tmp_path, monkeypatch):
    """From another folder than the suite's, and again after it was moved: the same numbers."""
    written(tmp_path / "a")
    monkeypatch.chdir(tmp_path)
    words = ["--no-speed", "--workers", "1", "--quiet", "--cache", "cache"]
    assert main(["suite", "a/mine.toml", "--out", "o", "--table", "t.tex", *words]) == 0
    text = (tmp_path / "t.tex").read_text()
    assert "Given/mine & " in text
    assert "Alg1/H & " in text
    result = read_results("o")
    assert {sample.seed for sample in result.samples} == {0, 1}
    assert set(result.rows["method"]) >= {"Given/mine", "Alg1/H"}
    shutil.move("a", "b")
    first, moved = result.digest, load("b/mine.toml")[0]
    assert moved.digest == first
    assert moved.digest_of("robot") == result.cases["robot"]


@pytest.mark.parametrize("edit", ["rover.xml", "rig.json"])
def test_another_file_of_the_same_name_is_another_suite(tmp_path, edit):
    folder = written(tmp_path / "a", '"rig.json"')
    (folder / "rig.json").write_text("{}")
    before = load(f"{folder}/mine.toml")[0]
    digests = before.digest, before.digest_of("robot")
    (folder / edit).write_text((folder / edit).read_text() + "\n")
    after = load(f"{folder}/mine.toml")[0]
    assert after.digest != digests[0]
    assert after.digest_of("robot") != digests[1]


def test_a_file_that_is_not_there_is_refused_before_anything_runs(tmp_path, capsys):
    folder = written(tmp_path / "a")
    (folder / "rover.xml").unlink()
    words = ["suite", str(folder / "mine.toml"), "--out", str(tmp_path / "o")]
    assert "rover.xml" in command_refused(capsys, *words)
    assert not (tmp_path / "o").exists()
