"""`eventsweep score GEOMETRY --truth SEQUENCE`: tables, a folder, refusals, gate and compare."""

import json
import re

import numpy as np
import pytest

import eventsweep as es
from eventsweep.eval.cli.main import main
from eventsweep.eval.scoring.metrics import PRIMARY_OF_GEOMETRIES
from eventsweep.plugins.geometry.config import DEPTH_SUFFIXES
from eventsweep.plugins.geometry.ply import read_ply, write_points
from refusals import command_refused, untouched
from report_data import WellFormed
from room_world import ply_text, splat_bytes, write_sequence

CELL = ("--cell-m", "0.05")


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A sequence, its truth, a cloud 1 cm beside it, one of another scale, splats, poses."""
    folder = tmp_path_factory.mktemp("world")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("EVENTSWEEP_CACHE", str(folder / "cache"))
        write_sequence(folder / "seq")
        es.write_tum("poses.txt", es.Sequence("seq").trajectory)
        words = ("score", "seq/cam0.ply", "--truth", "seq", "--out", "truth", *CELL)
        (folder / "seq" / "cam0.ply").write_text(ply_text([[0, 0, 3.0]]))
        assert main([*words, "--write-truth", "--quiet"]) == 0
        truth = read_ply(folder / "truth" / "truth.ply").vertices
    places, normals = (np.column_stack([truth[f"{n}{axis}"] for axis in "xyz"]) for n in ("", "n"))
    for name, points in (
        ("truth", places), ("off", places + 0.01 * normals), ("large", 2 * places),
        ("away", places + 50.0),
    ):  # fmt: skip
        write_points(folder / f"{name}.ply", {a: points[:, k] for k, a in enumerate("xyz")})
    (folder / "splats.ply").write_bytes(splat_bytes(places, np.full(len(places), 3.0)))
    return folder


@pytest.fixture
def here(world, tmp_path, monkeypatch):
    """The working directory is another, in which the world's files are links."""
    for path in world.iterdir():
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(world / "cache"))
    return tmp_path


def run(*words):
    return main([str(word) for word in words])


def value(results, method, metric):
    rows = results.rows[(results.rows.method == method) & (results.rows.metric == metric)]
    (found,) = rows["value"]
    return found


def test_it_prints_tables_without_a_folder(here, capsys):
    before = {path.name for path in here.iterdir()}
    assert run("score", "truth.ply", "mine=off.ply", "--truth", "seq", *CELL) == 0
    out = capsys.readouterr().out
    assert "room, all surfaces" in out
    assert "mine, by class of surface" in out
    assert re.search(r"truth +│ +0.00 │ +0.00 │ +100.00 │", out)
    assert re.search(r"mine +│ +(?:0.9\d|1.00) │", out)
    assert "one per cell of 5 cm" in out
    assert {path.name for path in here.iterdir()} == before


def test_a_folder_holds_results_and_a_page_with_pictures(here):
    assert run("score", "<b>=off.ply", "splats.ply", "--truth", "seq", "--out", "out", *CELL) == 0
    names = {path.name for path in (here / "out").iterdir()}
    assert names == {"results.json", "results.csv", "report.html", ".eventsweep.json"}
    text = (here / "out" / "report.html").read_text("utf-8")
    WellFormed(text)
    assert text.count("<svg") == 4
    assert text.count("distance, cm") == 4
    leads = re.findall(r'<p class="lead">(.*?)</p>', text)
    assert [lead.split(":")[0] for lead in leads] == ["_b_", "splats"]
    assert re.search(r"accuracy [\d.]+ cm, completion [\d.]+ cm, .*F1 5 cm [\d.]+ %\.", leads[1])
    assert text.index("lead") < text.index("<table")
    assert "x, m" in text
    assert "row, px" in text
    assert not re.search(r'(?:src|href)="http', text)
    results = es.read_results("out")
    assert 0.009 < value(results, "_b_", "accuracy") <= 0.0101
    assert value(results, "splats", "surface_f1_1cm") > 99.9
    assert results.sequences == {"room": es.Sequence("seq").manifest.digest()}
    for row in results.rows.itertuples():
        metric = es.METRICS[row.metric.removeprefix(f"{row.region}_")]
        assert (row.unit, row.direction) == (metric.unit, metric.direction)


def test_a_scale_is_found_and_printed(here, capsys):
    assert run("score", "large.ply", "--truth", "seq", "--align", "sim3", "--json", *CELL) == 0
    printed = capsys.readouterr()
    results = json.loads(printed.out)
    found = {row["metric"]: row["value"] for row in results["rows"]}
    assert found["scale"] == pytest.approx(0.5, rel=1e-6)
    assert found["accuracy"] < 1e-5
    assert "2 times as large as the truth" in printed.err
    assert results["configuration"]["score"]["align"] == "sim3"


@pytest.mark.parametrize(("words", "said"), [
    ("truth.ply", "the flags of geometries are for geometries: add --truth"),
    ("poses.txt --truth poses.txt --out out", "name one, or leave out the flags of geometries"),
    ("truth.ply --truth seq --out out --offset-s 1", "--offset-s is for trajectories"),
    ("truth.ply --truth seq --out out --prediction x", "--prediction is for maps"),
    ("truth.ply --truth seq --write-truth", "add --out"),
    ("truth.ply truth.ply --truth seq", "two geometries are called truth"),
    ("truth.ply poses.txt --truth seq", "geometries of kind .txt are not read"),
    ("scan.las --truth seq", "geometries of kind .las are not read"),
    ("none.ply --truth seq", "none.ply: cannot be read (No such file"),
    ("truth.ply --truth poses.txt", "against the folder of a sequence"),
    ("truth.ply --truth nowhere", "nowhere: no such folder"),
    ("away.ply --truth seq --out out", "away.ply: no point lies where the truth is"),
    ("away.ply --truth seq --out out", "say --align 'sim3'"),
    ("truth.ply --truth seq --out seq", "add --force|choose another"),
    ("truth.ply --truth seq --least-opacity 2", "--least-opacity"),
    ("truth.ply --truth seq --align free", "--align"),
])  # fmt: skip
def test_what_cannot_be_scored_is_refused_in_one_line_and_leaves_nothing(here, capsys, words, said):
    with untouched(here):
        assert re.search(said.replace("(", r"\("), command_refused(
            capsys, "score", *words.split(), "--cell-m", "0.05", "--quiet"
        ))  # fmt: skip


def test_the_gate_and_compare_take_geometries(here, capsys):
    """A worse cloud of the same name is red; the same one is green."""
    for name in ("truth", "off"):
        words = ("score", f"mine={name}.ply", "--truth", "seq", "--out", f"of_{name}", *CELL)
        assert run(*words, "--quiet") == 0
    baseline = ("gate", "--baseline", "baseline.json", "--result")
    assert run(*baseline, "of_truth", "--update", "--reason", "first", "--quiet") == 0
    assert run(*baseline, "of_truth", "--quiet") == 0
    capsys.readouterr()
    assert run(*baseline, "of_off", "--json") == 1
    verdicts = {one["metric"]: one for one in json.loads(capsys.readouterr().out)}
    assert {name for name, one in verdicts.items() if one["decides"]} == {*PRIMARY_OF_GEOMETRIES}
    assert verdicts["accuracy"]["status"] == verdicts["completion"]["status"] == "worse"
    assert run("compare", "of_truth", "of_off", "--out", "compared") == 0
    text = (here / "compared" / "compare.html").read_text("utf-8")
    assert "worse here" in text
    assert "surface F1 5 cm" in text


@pytest.mark.parametrize("suffix", DEPTH_SUFFIXES)
def test_depth_maps_are_sent_to_where_they_are_scored(here, capsys, suffix):
    (here / f"depth{suffix}").write_bytes(b"")
    said = command_refused(capsys, "score", f"mine=depth{suffix}", "--truth", "seq")
    assert "--prediction NAME=DIR" in said
    assert ".pfm" not in said.partition("DIR/")[2]  # predictions have no such format
