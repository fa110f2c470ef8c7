"""The main job at real size: what the paper promises must come out of scenes that we know."""

import base64
import csv
import json
import re
import shutil
import zlib

import cv2
import numpy as np
import pytest

from blank_pictures import drawn_figures
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import read_map
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.eval.cli.main import main
from eventsweep.eval.numbers import thousands
from eventsweep.eval.results.results import read_results
from eventsweep.eval.results.table import EVENTS, RIG, each
from eventsweep.eval.scoring.metrics import METRICS
from refusals import command_refused

pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture(scope="session")
def desk_run(tmp_path_factory):
    """`eventsweep run desk` as the README says, cut to its first 0.2 s."""
    out = tmp_path_factory.mktemp("desk") / "run"
    assert main(["run", "desk", "--seconds", "0.2", "--out", str(out), "--quiet"]) == 0
    return out


@pytest.fixture(scope="session")
def planes_sequence(tmp_path_factory):
    path = tmp_path_factory.mktemp("planes") / "sequence"
    assert main(["simulate", "planes", "--out", str(path), "--quiet"]) == 0
    return Sequence.open(path)


def value(run, method: str, metric: str) -> float:
    rows = list(each(read_results(run).rows))
    (row,) = [r for r in rows if (r.window, r.method, r.metric) == ("all", method, metric)]
    return row.value


@pytest.mark.parametrize("metric", ["mean_error", "bad_published"])
def test_harmonic_fusion_beats_each_camera_and_max_and_is_no_toy(desk_run, metric):
    """Enough points, most of them right: half within 3 cm in a scene that reaches to 4 m."""
    others = ("EMVS/cam0", "EMVS/cam1", "Alg1/max")
    best = min(value(desk_run, other, metric) for other in others)
    assert value(desk_run, "Alg1/H", metric) < best
    assert value(desk_run, "Alg1/H", "points") > 2000
    assert value(desk_run, "Alg1/H", "median_error") < 0.03


def test_every_documented_file_is_there_and_results_say_where_they_come_from(desk_run):
    window = desk_run / "desk" / "map" / "w000"
    for method in ("Alg1-H", "Alg1-max", "EMVS-cam1"):
        with np.load(window / method / "depth.npz", allow_pickle=False) as arrays:
            needed = {"depth_m", "confidence", "mask", "t_us", "T_world_rv", "camera"}
            assert needed <= set(arrays.files)
            assert arrays["depth_m"].shape == arrays["mask"].shape == (260, 346)
            assert json.loads(str(arrays["camera"]))["width_px"] == 346
        assert (window / method / "cloud.ply").read_bytes()[:3] == b"ply"
    page = (desk_run / "report.html").read_text(encoding="utf-8")
    assert not re.findall(r"""(?:src|href)=["']?https?:|url\(https?:|@import""", page)
    assert (desk_run / "overview.png").read_bytes()[:4] == b"\x89PNG"
    links = [one for one in re.findall(r'href="([^"]*)"', page) if one[:1] != "#"]
    links = [one for one in links if not one.startswith("data:")]
    numbers = ["results.json", "results.csv", "config.toml", "desk/map/map.json"]
    assert links == [*numbers, "overview.png"]
    assert all((desk_run / link).is_file() for link in links)
    results = read_results(desk_run)
    sequence = Sequence.open(desk_run / "desk" / "sequence")
    assert results.sequences == {"desk": sequence.manifest.digest()}
    assert (results.seed, results.configuration["desk"]["map"]["planes"]) == (0, 100)
    assert {"python", "numpy", "numba", "mujoco", "eventsweep"} <= set(results.versions)
    found = {row.metric for row in each(results.rows) if row.method == "Alg1/H"}
    assert {metric.name for metric in METRICS} <= found
    assert {row.metric for row in each(results.rows) if row.method not in (RIG, EVENTS)} <= set(
        results.metrics
    )
    assert value(desk_run, RIG, "baseline") == pytest.approx(sequence.rig.baseline_m())
    assert 0.02 < value(desk_run, RIG, "lateral_travel") < 1
    with (desk_run / "results.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == [
        "case", "seed", "window", "method", "metric", "value", "unit", "direction",
        "region", "support", "low", "high",
    ]  # fmt: skip
    assert len(table) == len(results.rows)
    sequence = Sequence.open(desk_run / "desk" / "sequence")
    left, right = (sequence.events(camera, 0, 100_000) for camera in (0, 1))
    assert len(left) > 10_000
    assert len(right) > 10_000
    n = min(len(left), len(right))
    assert np.mean((left.x[:n] == right.x[:n]) & (left.y[:n] == right.y[:n])) < 0.1


@pytest.mark.slow
def test_the_configuration_that_was_used_makes_the_same_results(desk_run, tmp_path):
    """config.toml is enough to run again: same maps, number by number."""
    config = str(desk_run / "config.toml")
    sequence = str(desk_run / "desk" / "sequence")
    assert main(["map", sequence, "--out", str(tmp_path / "m"), "--config", config, "--quiet"]) == 0
    first = read_map(desk_run / "desk" / "map").windows[0].depth_map("Alg1/H")
    again = read_map(tmp_path / "m").windows[0].depth_map("Alg1/H")
    assert np.array_equal(first.depth_m, again.depth_m)
    assert np.array_equal(first.mask, again.mask)


@pytest.mark.slow
@pytest.mark.parametrize(("interpolate", "share"), [(True, 0.25), (False, 0.5)])
def test_planes_are_found_within_a_part_of_a_plane_step(planes_sequence, interpolate, share):
    """Median error in inverse depth, in steps between two depth planes."""
    result = map_window(planes_sequence, MapperConfig(interpolate=interpolate))
    truth_m = planes_sequence.truth_depth_m(0, result.window.t_ref_us)
    step = abs(float(result.view.rho[1] - result.view.rho[0]))
    found = result.depth_maps["Alg1/H"]
    assert found.points > 2000
    steps = np.abs(1 / found.depth_m - 1 / truth_m)[found.mask] / step
    assert np.median(steps) <= share


def test_a_prediction_that_copies_ours_gets_our_score_and_an_incomplete_one_none(
    desk_run, tmp_path, capsys
):
    copy, given = shutil.copytree(desk_run, tmp_path / "run"), tmp_path / "theirs"
    given.mkdir()
    ours = read_map(copy / "desk" / "map").windows[0].depth_map("Alg1/H")
    np.save(given / f"{ours.t_us}.npy", np.where(ours.mask, ours.depth_m, np.nan))
    asked = ["score", str(copy), "--prediction", str(given), "--quiet"]
    assert main(asked) == 0
    for name in ("points", "mean_error", "median_error", "bad_published", "cause_occlusion"):
        assert value(copy, "Alg1/H", name) == value(copy, "Given/theirs", name)
    (given / f"{ours.t_us}.npy").rename(given / "7.npy")
    before = (copy / "results.json").read_bytes()
    command_refused(capsys, *asked)
    assert (copy / "results.json").read_bytes() == before


@pytest.mark.slow
def test_a_prediction_is_a_method_like_any_other(desk_run, tmp_path):
    """Of a few pixels only: what is said of the map's own methods stays as it was."""
    copy, given = shutil.copytree(desk_run, tmp_path / "run"), tmp_path / "theirs"
    given.mkdir()
    ours = read_map(copy / "desk" / "map").windows[0].depth_map("EMVS/cam0")
    mask = ours.mask & (np.indices(ours.mask.shape).sum(0) % 9 == 0)
    np.save(given / f"{ours.t_us}.npy", np.where(mask, ours.depth_m, np.nan))
    alone = cv2.imread(str(copy / "overview.png"))

    assert main(["score", str(copy), "--prediction", str(given), "--quiet"]) == 0
    with drawn_figures():
        assert main(["report", str(copy), "--quiet"]) == 0

    assert value(copy, "Given/theirs", "points") <= mask.sum()
    for name in ("common_points", "common_mean_error", "shared_mean_error"):
        methods = ("Alg1/max", "EMVS/cam0") if name.startswith("shared") else ("Alg1/H",)
        assert [value(copy, m, name) for m in methods] == [
            value(desk_run, m, name) for m in methods
        ]
    page = (copy / "report.html").read_text()
    for kind in ("Depth [m]", "Error |e − g| [cm]"):
        assert f'alt="{kind} of Given/theirs' in page
    (window,) = re.findall(r'<script type="application/json">(.*?)</script>', page)
    shown = json.loads(window)["methods"][-1]
    bits = np.frombuffer(zlib.decompress(base64.b64decode(shown["mask"])), np.uint8)
    np.testing.assert_array_equal(np.unpackbits(bits, bitorder="little")[: mask.size], mask.ravel())
    both = value(copy, "Given/theirs", "shared_points")
    assert f"Given/theirs beside Alg1/H, on the {thousands(both)} px that both report" in page
    assert cv2.imread(str(copy / "overview.png")).shape[1] > alone.shape[1]
    assert strangers(copy) == []

    assert main(["score", str(copy), "--quiet"]) == 0
    assert not (copy / "predictions").exists()
