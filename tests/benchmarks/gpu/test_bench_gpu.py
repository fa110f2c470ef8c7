"""The GPU's benchmark, tried on the CPU in its place."""

import json
from dataclasses import replace

import numpy as np
import pytest

import bench_gpu
from bench_gpu import QUICK, VOLUMES, apart, faults, same
from cost_stream import MovingEdges
from eventsweep.emvs.mapper import map_window

TRIAL = ["--quick", "--device", "cpu"]
RECORDING, CONFIG = MovingEdges((24, 18), 400), replace(QUICK, planes=4).config("cpu")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("gpu") / "report.json"
    assert bench_gpu.main([*TRIAL, "--out", str(path)]) == 0
    return json.loads(path.read_text())


def test_the_report_says_what_was_measured_and_on_what(report):
    assert report["wrong"] == []
    assert "numba" in report["machine"]
    calls = report["whole"]["calls"]
    assert list(calls) == ["gpu", "cpu"]
    gpu = calls["gpu"]  # the CPU stood in for it, so nothing can differ
    assert (gpu["volume"], gpu["argmax"], gpu["counted"]) == (0, 1, 0)
    said = bench_gpu.text(report)
    assert said.startswith("A trial: these figures mean nothing. No GPU")
    assert said.count("\n| GPU ") == 1


def test_every_renderer_is_drawn_or_says_why_not(report):
    drawn = report["frames"]["drawn"]
    assert [one["kind"] for one in drawn] == ["classic", "float", "kernels", "shader"]
    assert all((one["per_s"] is None) != one["drawn_by"].startswith("mujoco") for one in drawn)


@pytest.mark.parametrize(("took_s", "held"), [(0.0999, "yes"), (0.1001, "**no**")])
def test_a_page_gets_the_tables_of_a_report(report, tmp_path, took_s, held):
    made = json.loads(json.dumps(report)) | {"quick": False, "device": "cuda"}
    made["whole"]["calls"]["gpu"]["median_s"] = took_s
    source, page = tmp_path / "report.json", tmp_path / "page.md"
    source.write_text(json.dumps(made))
    page.write_text("before\n<!-- gpu: begin -->\nold\n<!-- gpu: end -->\nafter\n")
    assert bench_gpu.main(["--from", str(source), "--page", str(page)]) == 0
    line = next(line for line in page.read_text().splitlines() if line.startswith("| GPU "))
    assert f"| {1e3 * took_s:.4g} ms | {held} |" in line
    assert "old" not in page.read_text()


def test_a_trial_stays_off_the_page(report, tmp_path, capsys):
    source, page = tmp_path / "report.json", tmp_path / "page.md"
    source.write_text(json.dumps(report))
    page.write_text("<!-- gpu: begin -->\n<!-- gpu: end -->\n")
    assert bench_gpu.main(["--from", str(source), "--page", str(page)]) == 2
    assert "trial" in capsys.readouterr().err
    assert page.read_text() == "<!-- gpu: begin -->\n<!-- gpu: end -->\n"


@pytest.mark.parametrize("text", ["", "[]", '{"schema_version": 99}'])
def test_what_is_no_report_is_refused(tmp_path, text):
    (tmp_path / "report.json").write_text(text)
    assert bench_gpu.main(["--from", str(tmp_path / "report.json")]) == 2


def test_a_part_that_fails_is_wrong_and_leaves_the_others(tmp_path, monkeypatch):
    def breaks(*_):
        raise RuntimeError("the card is gone")

    monkeypatch.setitem(bench_gpu.PARTS, "whole", breaks)
    monkeypatch.setitem(bench_gpu.PARTS, "frames", lambda *_: {"drawn": []})
    path = tmp_path / "report.json"
    assert bench_gpu.main([*TRIAL, "--out", str(path)]) == 1
    found = json.loads(path.read_text())
    assert found["wrong"] == ["whole: RuntimeError: the card is gone"]
    assert found["frames"] == {"drawn": []}


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    folders = [tmp_path_factory.mktemp(name) for name in ("ours", "theirs")]
    saved = CONFIG.model_copy(update={"methods": VOLUMES, "save_dsi": True})
    for folder in folders:
        map_window(RECORDING, saved, dsi_dir=folder)
    return map_window(RECORDING, CONFIG), *folders


@pytest.mark.parametrize("value", [0.01, np.nan, np.inf])
def test_one_wrong_voxel_is_found(mapped, value):
    result, ours, theirs = mapped
    assert list(faults(apart(result, result, ours, theirs) | {"repeats": True})) == []
    path = ours / "EMVS-cam1.npy"
    right = np.load(path)
    wrong = right.copy()
    wrong[2, 3, 4] += np.float32(value * right.max())
    np.save(path, wrong)
    off = apart(result, result, ours, theirs) | {"repeats": True}
    np.save(path, right)
    assert len(list(faults(off))) == 1


def test_maxima_in_other_planes_are_found(mapped):
    result, ours, theirs = mapped
    one = result.depth_maps["Alg1/G"]
    moved = one.argmax.copy()
    moved[0, 0] += 1
    maps = {**result.depth_maps, "Alg1/G": replace(one, argmax=moved)}
    found = apart(replace(result, depth_maps=maps), result, ours, theirs)
    assert found["argmax"] == 1 - 1 / moved.size
    found["repeats"] = True
    assert list(faults(found)) == ["the argmax is equal in 99.769% of pixels only"]
    assert not same(replace(result, depth_maps=maps), result)
    assert list(faults(found | {"argmax": 1, "repeats": False})) == [
        "votes gave other bits in another call"
    ]
