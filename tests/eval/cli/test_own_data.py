"""Data of one's own that cannot be used: one clear line of the command, and nothing is left."""

import json
import re

import numpy as np
import pytest

import rover
from dataset_world import TRUTH_US, rewritten, write_sequence
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.maps.folder import read_map
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import read_results
from refusals import command_refused, untouched

pytestmark = pytest.mark.usefixtures("blank_figures")

MAP = ("--map.min-depth-m", "1", "--map.max-depth-m", "4", "--map.reference-s", "0.25",
       "--map.planes", "10", "--method", "Alg1/H", "--quiet")  # fmt: skip


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("words", "message"), [
    (["--mount", "tail"], "nothing is called 'tail' in the model: choose from camera:flat"),
    (["--mount", "body:tail"], "nothing is called 'body:tail'"),
    (["--rig", "model:left,rear"], "nothing is called 'camera:rear'"),
    (["--rig", "model:blind"], "'blind' of the model has a resolution of 1 x 1: give it"),
    (["--rig", "model:flat"], "'flat' of the model has a resolution of 64 x 0: give it"),
])  # fmt: skip
def test_a_model_without_what_is_named_is_refused(here, capsys, words, message):
    flat = '<camera name="flat" xyaxes="0 -1 0 0 0 1" resolution="64 0"/><site name="eye"'
    rover.write(here, rover.MJCF.replace('<site name="eye"', flat))
    arguments = ["simulate", "rover.xml", "--out", "o", "--motion", "dynamics", *words]
    with untouched(here):
        assert message in command_refused(capsys, *arguments)


def test_a_calibration_of_a_camera_of_zero_size_is_refused(here, capsys):
    rover.write(here)
    short = ("--seconds", "0.005", "--sim.sampling", "fast", "--quiet")
    assert main(["simulate", "planes", "--rig", "oblique", "--out", "seq", *short]) == 0
    text = (here / "seq" / "rig.json").read_text()
    (here / "rig.json").write_text(re.sub(r'"width_px": \d+', '"width_px": 0', text, count=1))
    arguments = ["simulate", "rover.xml", "--out", "o", "--motion", "walk", "--rig", "rig.json"]
    with untouched(here):
        line = command_refused(capsys, *arguments)
    assert "rig.json" in line
    assert "must be at least 1" in line


@pytest.mark.parametrize(("columns", "message"), [
    ({}, "columns none; needs x, y, one of p"),
    ({"a": [1, 2], "b": [3, 4]}, "columns a, b; needs x, y, one of p"),
    ({"x": [1], "y": [1], "p": [1]}, "columns p, x, y; needs x, y, one of p"),
])  # fmt: skip
def test_a_parquet_without_columns_of_events_is_refused(here, capsys, columns, message):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pyarrow.table(columns), here / "n.parquet")
    for arguments in (["info", "n.parquet"], ["convert", "n.parquet", "o", "--to", "npz"]):
        with untouched(here):
            assert message in command_refused(capsys, *arguments)


@pytest.mark.parametrize(("spoil", "message"), [
    (lambda depth_m: depth_m[:-1], "give maps of the first camera's size"),
    (lambda depth_m: depth_m * 1000, "set unit_m in [truth] (0.001 for millimetres)"),
    (lambda depth_m: depth_m / 1000, "set unit_m in [truth] (0.001 for millimetres)"),
], ids=["size", "millimetres", "kilometres"])  # fmt: skip
def test_truth_of_another_size_or_unit_is_refused(here, capsys, spoil, message):
    ours = write_sequence(here / "plane", "kb4")
    out = rewritten(ours, here / "recording", "npz")
    assert main(["map", str(out), "--out", "map", *MAP]) == 0
    with (out / "recording.toml").open("a", encoding="utf-8") as file:
        file.write('\n[truth]\ndepth = "d*.npy"\ntimes = "times.txt"\n')
    (out / "times.txt").write_text("".join(f"{1e-6 * t_us:.6f}\n" for t_us in TRUTH_US))
    camera = Sequence.open(ours).rig.cameras[0]
    for k in range(len(TRUTH_US)):
        np.save(out / f"d{k}.npy", spoil(np.full((camera.height_px, camera.width_px), 2.0)))
    with untouched(here):
        said = command_refused(capsys, "score", "map", "--score.truth-tolerance-s", "0.001")
    assert message in said


def test_maps_of_a_recording_without_truth_are_described_and_gated(here, capsys):
    """Events that the mapper lost are seen where no error is known."""
    rewritten(write_sequence(here / "plane", "kb4"), here / "recording", "npz")
    gate = ["gate", "--baseline", "base.json", "--result", "map"]
    assert main(["map", "recording", "--out", "map", *MAP]) == 0
    assert main(["score", "map"]) == 0
    assert "no ground truth" in capsys.readouterr().out
    rows = read_results("map").rows.set_index(["method", "metric"])["value"]
    stored = read_map("map").windows[0]
    assert rows["Alg1/H", "reported"] == stored.info.points["Alg1/H"] > 0
    depth_map = stored.depth_map("Alg1/H")
    assert rows["Alg1/H", "median_depth"] == np.median(depth_map.depth_m[depth_map.mask])
    assert rows["events", "events"] == sum(c["events"] for c in stored.info.counts.values())
    assert main([*gate, "--update", "--reason", "first", "--quiet"]) == 0
    assert main([*gate, "--quiet"]) == 0
    assert main(["map", "recording", "--out", "map", *MAP, "--map.start-s", "0.1", "--force"]) == 0
    assert main(["score", "map", "--quiet"]) == 0
    assert main([*gate, "--json"]) == 1
    verdicts = json.loads(capsys.readouterr().out)
    assert ("events", "changed") in {(v["metric"], v["status"]) for v in verdicts}
