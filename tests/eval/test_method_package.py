"""A whole method in a package outside the repository, as documented: mapped, scored, in a suite."""

import csv

import numpy as np
import pytest

from eventsweep.emvs import methods
from eventsweep.emvs.maps.folder import read_map
from eventsweep.eval.results.results import read_results
from packages import documented, install, run_with
from places import ROOT
from refusals import command_refused
from small_pair import small_sequence
from small_suite import case, suite_text

SUITE = suite_text(
    case("wall", [(0.0, 0.02)], 0.02, rig="oblique", sim={"sampling": "fast"}),
    name="mine",
    mappers={"default": {"methods": ["Chance/middle"], "planes": 21}},
)


PAGE, HEADING = ROOT / "docs" / "methods.md", "### Without a volume, in a package of your own"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder of packages with that one in it, as an installer leaves it."""
    folder = tmp_path_factory.mktemp("site")
    install(folder, *documented(PAGE, HEADING))
    return folder


def done(site, folder, *words):
    over = run_with(site, folder, *words)
    assert over.returncode == 0, over.stderr
    return over.stdout


@pytest.mark.slow
def test_it_is_mapped_without_a_volume_and_scored(site, tmp_path):
    small_sequence(tmp_path / "seq")
    assert "Chance/middle" in done(site, tmp_path, "list", "methods")
    done(site, tmp_path, "map", "seq", "--out", "maps", "--method", "Chance/middle", "--quiet")
    (window,) = read_map(tmp_path / "maps").windows
    assert window.info.methods == ("Chance/middle",)
    assert window.slices.values["Chance/middle"].shape[0] == 0
    depth_map = window.depth_map("Chance/middle")
    middle_m = 1 / depth_map.rho[len(depth_map.rho) // 2]
    np.testing.assert_array_equal(depth_map.depth_m, np.float32(middle_m))
    assert 0 < depth_map.points < depth_map.mask.size
    done(site, tmp_path, "score", "maps", "--quiet")
    with (tmp_path / "maps" / "results.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == "Chance/middle"]
    (error,) = [row for row in rows if row["metric"] == "mean_error" and row["window"] == "all"]
    assert float(error["value"]) > 0


@pytest.mark.slow
def test_it_runs_in_a_suite_and_an_edit_maps_again(site, tmp_path):
    (tmp_path / "mine.toml").write_text(SUITE)
    words = ("mine.toml", "--cache", "cache", "--workers", "1", "--no-speed", "--quiet")
    found = []
    for out in ("first", "same", "edited"):
        if out == "edited":
            module = site / "chance" / "eventsweep.py"
            module.write_text(module.read_text().replace("len(view.rho) // 2", "1"))
        done(site, tmp_path, "suite", *words, "--out", out)
        result = read_results(tmp_path / out)
        assert set(result.rows["method"]) == {"Chance/middle", "events"}
        found.append({job.name.split("/")[0]: job.found for job in result.jobs})
    assert [one["simulate"] for one in found] == [False, True, True]
    assert [one["map"] for one in found] == [False, True, False]
    assert [one["score"] for one in found] == [False, True, False]


SPOILT = {
    "size": ("np.full(shape, 1 /", "np.full((3, 4), 1 /", "(3, 4)"),
    "NaN": ("1 / view.rho[plane])", "np.nan)", "not finite and positive"),
    "negative": ("1 / view.rho[plane])", "-1.0)", "not finite and positive"),
    "nothing": ("    return es.DepthMap(", "    es.DepthMap(", "what Chance/middle gives is None"),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_what_is_no_depth_map_of_the_view_is_one_line(tmp_path, monkeypatch, capsys, kind):
    old, new, words = SPOILT[kind]
    sequence, out = small_sequence(tmp_path / "seq"), tmp_path / "maps"
    _, module = documented(PAGE, HEADING)
    assert old in module
    methods.load(ours=True)
    monkeypatch.setattr(methods, "_registered", dict(methods._registered))
    names = {}
    exec(compile(module.replace(old, new), "chance", "exec"), names)
    names["register_methods"]()
    asked = ["map", sequence, "--out", out, "--method", "Chance/middle", "--quiet"]
    line = command_refused(capsys, *asked)
    assert "Chance/middle" in line
    assert words in line
    assert not out.exists()
