"""A suite is frozen data; running it twice does nothing twice and gives the same numbers."""

import json
import math

import numpy as np
import pytest

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.utils.cache import Cache, default_cache, key_of
from eventsweep.eval.cli.main import main
from eventsweep.eval.gate.baseline import read_baseline
from eventsweep.eval.perturbations import PRESETS
from eventsweep.eval.results.results import SUITE_NAME, read_results
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.metric_versions import metric_versions
from eventsweep.eval.stages import map as stage
from eventsweep.eval.suite.definition import FOLDER, load, read
from eventsweep.eval.suite.plan import suite_jobs
from eventsweep.sim.rigs import rig as named_rig
from places import HAS_PLUGINS, ROOT
from point_world import fronto_parallel
from refusals import command_refused, line_of

pytestmark = pytest.mark.usefixtures("blank_figures")

TINY = """
name = "tiny"
summary = "one short case"
seeds = [0, 1]
spread_seeds = [0, 1]
metrics = ["points", "mean_error", "median_error", "events"]
speed_case = "wall"

[mappers.default]
methods = ["Alg1/H", "EMVS/cam0"]
planes = 30

[mappers.coarse]
methods = ["Alg1/H"]
planes = 10

[cases.wall]
scene = "planes"
rig = "rpg"
seconds = 0.04
windows = [{ start_s = 0.0, duration_s = 0.02 }, { start_s = 0.02, duration_s = 0.02 }]
mappers = ["default", "coarse"]
sim = { contrast_threshold_pos = 0.4, contrast_threshold_neg = 0.5 }

[subsets.one]
cases = ["wall"]
seeds = [0]
"""


def toml(folder, text=TINY):
    path = folder / "tiny.toml"
    path.write_text(text)
    return path


# The definition
def test_every_suite_can_be_run_and_names_find_suites_and_subsets(tmp_path):
    suites = {path.stem: read(path) for path in FOLDER.glob("*.toml")}
    assert len(suites) > 3
    for name, suite in suites.items():
        assert suite.name == name
        assert suite.spread_seeds[: len(suite.seeds)] == suite.seeds, name
        if HAS_PLUGINS or name.startswith("mvsec"):  # which have learned methods
            assert suite_jobs(suite, tuple(suite.cases), (0,)), name
        assert all(set(some.seeds) <= set(suite.spread_seeds) for some in suite.subsets.values())
    file = toml(tmp_path)
    assert load("quick")[0].name == load("suite-v5")[0].name == "suite-v5"
    named = {"quick": "quick", "suite-v5": "all", "suite-v5:quick": "quick"}
    named |= {f"{file}:one": "one", str(file): "all"}
    assert {name: load(name)[1] for name in named} == named


@pytest.mark.parametrize(("name", "words"), [
    ("suite-v4", "unknown suite 'suite-v4': choose one of quick, mvsec-table-v1"),
    ("quick:all", "unknown suite 'quick': choose one of mvsec-table-v1"),
    ("suite-v5:slow", "suite-v5 has no subset 'slow': choose one of all, quick"),
])  # fmt: skip
def test_a_name_that_is_none_gets_those_that_are(name, words):
    assert words in line_of(load, name)


FROZEN = {
    "suite-v5": "3967cc6cbe3f0a92", "suite-v3": "9642ad682037972f",
    "mvsec-table-v1": "1ea46b539308529d", "mvsec-table-v2": "e91f11c179769327",
    "mvsec-table-v3": "41781bd50fbcc35d",
}  # fmt: skip


@pytest.mark.parametrize("name", FROZEN)
def test_a_suite_is_frozen(name):
    """A changed definition is another suite: give it another name, and add its digest here."""
    assert load(name)[0].digest == FROZEN[name]


@pytest.mark.parametrize(("old", "new", "words"), [
    ("seeds = [0, 1]\nspread", "seeds = []\nspread", "seeds"),
    ('scene = "planes"', 'scen = "planes"', "cases.wall.scen"),
    ("sim = {", "sim = { model = { controller = 'x.py:go' }, ", "no file may name code to run"),
    ("planes = 30", "plane = 30", "plane"), ("planes = 30", "planes = 1", "planes"),
    ("duration_s = 0.02 }]", "duration_s = 0.03 }]", "the case has 0.04 s"),
    ('cases = ["wall"]', 'cases = ["hall"]', "no 'hall', choose from wall"),
    ('"default", "coarse"]', '"default", "fine"]', "no 'fine', choose from default, coarse"),
    ('"default", "coarse"]', f'"{"9" * 5000}"]', "no '999"),
    ("contrast_threshold_pos = 0.4", "contrast_threshold_pos = -1", "contrast_threshold_pos"),
    ('speed_case = "wall"', 'speed_case = "hall"', "no 'hall'"),
    ("planes = 10", 'device = "auto"', "mappers.coarse.device is 'auto'"),
    ("sim = {", 'imperfection = "moon"\nsim = {', "no imperfection 'moon': choose one of mvsec"),
    ("sim = {", "imperfection = { focal_percent = 'x' }\nsim = {", "focal_percent"),
    ("sim = {", "imperfection = { focal = 2 }\nsim = {", "focal"),
    ("[subsets.one]", "[subsets.one", "not TOML"),
])  # fmt: skip
def test_a_wrong_definition_is_one_line(tmp_path, old, new, words):
    assert old in TINY
    said = line_of(read, toml(tmp_path, TINY.replace(old, new)))
    assert words in said
    assert len(said) < 1000


@pytest.mark.parametrize(("old", "new", "words"), [
    ('scene = "planes"', 'scene = "plains"', "unknown scene 'plains'"),
    ('rig = "rpg"', 'rig = "gpr"', "gpr"), ('"EMVS/cam0"', '"EMVS/cam7"', "EMVS/cam7"),
    ("planes = 10", 'device = "abacus"', "unknown device 'abacus'"),
])  # fmt: skip
def test_what_does_not_exist_is_refused_before_the_first_job(tmp_path, old, new, words):
    suite = read(toml(tmp_path, TINY.replace(old, new)))
    assert words in line_of(suite_jobs, suite, ("wall",), (0,))


def test_a_mapper_is_told_wrong_geometry_of_the_same_sequence(tmp_path):
    """A preset is kept as its amounts, so that a suite's digest changes with them."""
    wrong = "imperfection = { stereo_yaw_deg = 1, pose_walk_mm = 9 }\nsim = {"
    exact = suite_jobs(read(toml(tmp_path)), ("wall",), (1,))[0]
    told = suite_jobs(read(toml(tmp_path, TINY.replace("sim = {", wrong))), ("wall",), (1,))[0]
    sequence, mapping = told.needs[:2]
    assert sequence.parameters == exact.needs[0].parameters
    assert "perturb" not in exact.needs[1].parameters
    assert mapping.parameters["perturb"] == {"stereo_yaw_deg": 1, "pose_walk_mm": 9}
    sound = fronto_parallel(2.0)
    recording = stage.as_perturbed(sound, mapping.parameters)
    turn = recording.rig.T_body_cam[1][:3, :3]
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) == pytest.approx(1)
    places_m = [one.trajectory.positions_m for one in (recording, sound)]
    assert not np.allclose(*places_m, atol=1e-4)
    assert stage.as_perturbed(sound, exact.needs[1].parameters) is sound
    named = read(toml(tmp_path, TINY.replace("sim = {", 'imperfection = "mvsec"\nsim = {')))
    assert named.cases["wall"].imperfection == PRESETS["mvsec"].model_dump(exclude_defaults=True)


@pytest.mark.parametrize(("more", "mappers", "times_s"), [
    ("", '"default", "coarse"]', [0.01, 0.03]),
    ('\nreference = "end"', '"default", "coarse"]', [0.01, 0.02, 0.03, 0.04]),
    ('\nreference = "end"', '"coarse"]', [0.02, 0.04]),
])  # fmt: skip
def test_truth_is_rendered_where_a_mapper_has_its_view(tmp_path, more, mappers, times_s):
    """In the middle of every window, or as it says."""
    text = TINY.replace("planes = 10", f"planes = 10{more}")
    suite = read(toml(tmp_path, text.replace('"default", "coarse"]', mappers)))
    assert suite.sim_of(suite.cases["wall"])["truth_times_s"] == times_s


def test_quick_executes_what_faults_hid_in():
    """A lens of each kind, a rig that is straight in nothing, and a view at the window's end.

    Networks and baselines too: what the ranking ranks must not worsen unseen.
    """
    suite, subset = load("quick")
    cases = [suite.cases[name] for name in suite.subset(subset).cases]
    rigs = [named_rig(case.rig) for case in cases]
    assert {one.model for rig in rigs for one in rig.cameras} == {"pinhole", "radtan", "kb4"}
    assert any(np.abs(rig.T_body_cam[1][:3]).min() > 0.01 for rig in rigs)
    mappers = [suite.mappers[name] for case in cases for name in case.mappers]
    assert "end" in {one.get("reference") for one in mappers}
    assert any(window.start_s > 0 for case in cases for window in case.windows)
    assert any(len(case.windows) > 1 for case in cases)
    mapped = {method for mapper in mappers for method in mapper["methods"]}
    assert mapped >= {"Focus/H", "Learned/H", "Learned/cam0", "DERD/H", "SGM/ts", "ESVO/window"}


def test_jobs_share_what_they_have_in_common_and_the_digest_sees_every_change(tmp_path):
    (job,) = suite_jobs(read(toml(tmp_path)), ("wall",), (0,))
    sequence, *maps = job.needs
    assert [one.name.split("/", 3)[-1] for one in maps] == [
        "default/w000", "default/w001", "coarse/w000", "coarse/w001",
    ]  # fmt: skip
    assert all(one.needs == (sequence,) for one in maps)
    changes = [
        ("planes = 30", "planes = 31"), ("seconds = 0.04", "seconds = 0.05"),
        ("neg = 0.5", "neg = 0.6"), ('rig = "rpg"', 'rig = "davis346"'),
        ("start_s = 0.02", "start_s = 0.01"),
        ("[cases.wall]", "[score]\nmax_truth_depth_m = 3\n[cases.wall]"),
    ]  # fmt: skip
    texts = [TINY, *(TINY.replace(*change) for change in changes)]
    digests = {read(toml(tmp_path, text)).digest_of("wall") for text in texts}
    assert len(digests) == len(texts)
    more = read(toml(tmp_path, TINY.replace("seeds = [0, 1]\n", "seeds = [0, 1, 2]\n", 1)))
    assert more.digest_of("wall") == read(toml(tmp_path)).digest_of("wall")


def test_metrics_have_versions_and_the_projects_baseline_is_of_its_suite():
    versions = metric_versions()
    assert versions == metric_versions()
    assert versions["mean_error"] != versions["median_error"]
    assert set(load("quick")[0].metrics) - set(versions) == {
        "events", "brighter_share", "voting_share", "votes_in_image_share", "dropped_tail",
    }  # fmt: skip
    # Every case of `quick`, with seeds to spare for the spread, and a reason.
    suite, subset = load("quick")
    baseline = read_baseline(ROOT / "reports" / "baseline.json")
    assert (baseline.name, baseline.seeds) == (suite.name, suite.spread_seeds)
    assert {one.case for one in baseline.series} == set(suite.subset(subset).cases)
    assert {one.metric for one in baseline.series} >= set(suite.metrics)
    assert all(math.isfinite(value) for one in baseline.series for value in one.values.values())
    assert baseline.history[-1].reason


def test_the_cache_is_where_the_user_says(monkeypatch, tmp_path):
    monkeypatch.delenv("EVENTSWEEP_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_cache() == tmp_path / "eventsweep"
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "own"))
    assert default_cache() == tmp_path / "own"


# A run
@pytest.fixture(scope="module")
def run(tmp_path_factory, jobs_in_this_process):
    """`eventsweep suite` on a cold cache: the definition, the cache and the result."""
    folder = tmp_path_factory.mktemp("suite")
    file, cache, out = toml(folder), folder / "cache", folder / "out"
    arguments = ["--out", str(out), "--cache", str(cache), "--workers", "1", "--quiet"]
    assert main(["suite", f"{file}:one", *arguments]) == 0
    return file, cache, out


def test_the_result_says_what_made_it_and_has_every_window_method_and_metric(run):
    file, cache, out = run
    result, suite = read_results(out), read(file)
    (sample,) = result.samples
    assert (result.suite, result.digest) == ("tiny", suite.digest)
    assert result.cases == {"wall": suite.digest_of("wall")}
    assert {"numpy", "mujoco", "eventsweep"} <= set(result.versions)
    assert (len(result.jobs), len(result.failures)) == (6, 0)
    (simulated,) = [job for job in result.jobs if job.name.startswith("simulate")]
    sequence = Sequence.open(Cache(cache).path_of(simulated.key) / "data" / "sequence")
    truth = sequence.manifest.files["cam0/truth.h5"].sha256
    assert (sample.sequence, sample.truth) == (sequence.manifest.digest(), truth)
    assert sample.sim["contrast_threshold_pos"] == 0.4
    assert sample.metrics == metric_versions()
    assert all(ratio > 0 for ratio in result.speed["wall"])
    rows = read_results(run[2]).rows
    places = {(row.window, row.method) for row in each(rows) if row.metric == "mean_error"}
    windows, methods = ("w000", "w001", "all"), ("Alg1/H", "EMVS/cam0", "Alg1/H coarse")
    assert places >= {(window, method) for window in windows for method in methods}
    (events,) = rows.loc[rows["metric"] == "events", "value"]
    assert events > 1000
    lines = (run[2] / "suite.csv").read_text().splitlines()
    assert lines[0] == "case,seed,window,method,metric,value,unit,direction"
    assert len(lines) == len(rows) + 1
    pictures = {path.name for path in (run[2] / "pictures").iterdir()}
    assert pictures > {"wall.png", "methods.json", "Alg1_H-best.webp", "Alg1_H-worst.webp"}


def test_running_again_does_nothing_again_and_keeps_what_there_is(run, tmp_path, capsys):
    file, cache, out = run
    arguments = ["--out", str(tmp_path), "--cache", str(cache), "--no-speed", "--quiet"]
    assert main(["suite", f"{file}:one", *arguments]) == 0
    again = read_results(tmp_path)
    assert all(job.found for job in again.jobs)
    assert again.samples == read_results(out).samples
    file, cache, out = run
    words = ["suite", f"{file}:one", "--out", out, "--cache", cache]
    assert "add --force" in command_refused(capsys, *words)


def test_so_far_writes_what_is_done_and_runs_nothing(run, tmp_path, capsys):
    file, cache, out = run
    words = ["suite", str(file), "--so-far", "--cache", str(cache), "--out"]
    assert main([*words, str(tmp_path / "part")]) == 1
    text = capsys.readouterr().out
    assert "0 done now, 0 failed, 6 not done yet" in text
    assert "wall: one seed" in text
    part = read_results(tmp_path / "part")
    numbers = read_results(out).rows.query("metric != 'cpu_time_ratio' and method != 'events'")
    there = part.rows.query("metric != 'cpu_time_ratio' and method != 'events'")
    assert there.equals(numbers)
    assert main(["report", str(tmp_path / "part"), "--quiet"]) == 0
    page = (tmp_path / "part" / "report.html").read_text()
    assert "6 of 12 jobs are not done yet" in page
    assert "--cost" in command_refused(capsys, *words, tmp_path / "other", "--cost")
    assert main([*words, str(tmp_path / "none"), "--case", "wall", "--seeds", "7"]) == 1
    assert "6 not done yet" in capsys.readouterr().out


@pytest.mark.slow
def test_a_suite_gates_itself(run, tmp_path, capsys):
    """Green against its own numbers; red, with the culprit, against better ones."""
    file, cache, _ = run
    baseline = tmp_path / "baseline.json"
    common = ["--suite", f"{file}:one", "--baseline", str(baseline), "--cache", str(cache)]
    assert main(["gate", *common, "--update", "--reason", "first", "--seeds", "0"]) == 0
    assert main(["gate", *common]) in (0, 1)  # its speed may differ while others work
    content = json.loads(baseline.read_text())
    for one in content["series"]:
        if (one["method"], one["metric"]) == ("Alg1/H", "mean_error"):
            one["values"] = {"0": one["values"]["0"] / 2}
    baseline.write_text(json.dumps(content))
    capsys.readouterr()
    assert main(["gate", *common]) == 1
    assert "worse" in capsys.readouterr().out


@pytest.mark.slow
def test_a_job_that_fails_is_told_and_others_go_on(run, tmp_path, capsys):
    """A window in which nothing moves has no events."""
    broken = TINY.replace("pos = 0.4", "pos = 9").replace("neg = 0.5", "neg = 9")
    more = broken[broken.index("[cases.wall]") : broken.index("[subsets")]
    still = more.replace("[cases.wall]", "[cases.still]")
    words = ["suite", toml(tmp_path, TINY.replace("[subsets", still + "[subsets"))]
    words += ["--out", tmp_path / "out", "--cache", run[1], "--seeds", "0", "--no-speed"]
    assert main([*map(str, words)]) == 1
    result = read_results(tmp_path / "out")
    assert [sample.case for sample in result.samples] == ["wall"]
    assert any("none of which can vote" in job.failure for job in result.failures)
    assert any(job.failure.startswith("not started") for job in result.failures)
    assert "failed" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema_version": 1}', '{"schema_version": 7}'])
def test_a_damaged_result_is_one_line(tmp_path, text):
    (tmp_path / SUITE_NAME).write_text(text)
    assert "run the suite again" in line_of(read_results, tmp_path)


def test_the_cache_says_its_size_and_shrinks(tmp_path, capsys):
    Cache(tmp_path).get(key_of("k1"), "k1", lambda out: (out / "a").write_bytes(bytes(1000)))
    asked, found = ["cache", "--cache", str(tmp_path)], []
    for prune in ([], ["--prune", "0"]):
        assert main([*asked, *prune, "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out)["bytes"])
    assert found[0] > 1000
    assert found[1] == 0
    command_refused(capsys, *asked, "--prune", "-1")


# The project's own baseline
