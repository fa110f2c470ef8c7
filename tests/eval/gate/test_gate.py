"""The gate: green on what is unchanged, red on what is worse, and it names the culprit."""

import json
import math
from dataclasses import replace
from itertools import combinations
from xml.etree import ElementTree as xml

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emvs.errors import InputError
from eval.cli.main import main
from eval.gate import report
from eval.gate.baseline import make_baseline, read_baseline, write_baseline
from eval.gate.compare import RED, Tolerances, Verdict, compare, is_red
from eval.gate.report import write_junit
from eval.scoring.results import Results, Row, write_results
from eval.suite.series import SPEED_METHOD, SPEED_METRIC, Key, Measured, Series, read_measured
from places import ROOT

TOLERANCES = Tolerances()
BASELINE = ROOT / "reports" / "baseline.json"


def series(values, metric="mean_error", better="lower", case="desk", unit="m", identity="i"):
    values = dict(enumerate(values)) if not isinstance(values, dict) else values
    return Series(
        case=case, method="Alg1/H", metric=metric, unit=unit, better=better, identity=identity,
        values=values,
    )  # fmt: skip


def measured(*found, seeds=(0, 1, 2), cases=("desk",), failures=None):
    return Measured("test", {one.key: one for one in found}, seeds, cases, failures or {}, {})


def verdict(base, now, **about):
    (one,) = compare({base.key: base}, measured(now, **about), TOLERANCES)
    return one


BASE = series([0.10, 0.12, 0.14, 0.11, 0.13])


# Verdicts


@pytest.mark.parametrize(
    ("better", "shift", "status"),
    [
        ("lower", 0.05, "worse"),
        ("lower", -0.05, "better"),
        ("higher", 0.05, "better"),
        ("higher", -0.05, "worse"),
        ("none", 0.05, "worse"),
        ("none", -0.05, "worse"),
        ("lower", 0.0, "same"),
        ("higher", 1e-4, "same"),
    ],
)
def test_direction_decides(better, shift, status):
    base = BASE.model_copy(update={"better": better})
    now = base.model_copy(update={"values": {k: base.values[k] + shift for k in range(3)}})
    assert verdict(base, now).status == status


def test_equal_seeds_are_compared_one_by_one():
    """A shift that drowns in the spread between seeds is seen when seeds are the same."""
    shift = 0.3 * np.std(list(BASE.values.values()), ddof=1)
    same_seeds = series({k: BASE.values[k] + shift for k in range(3)})
    other_seeds = series({100 + k: BASE.values[k] + shift for k in range(3)})
    assert verdict(BASE, same_seeds).status == "worse"
    assert verdict(BASE, other_seeds, seeds=(100, 101, 102)).status == "same"


def test_the_baseline_of_a_comparison_is_that_of_its_seeds():
    one = verdict(BASE, series([0.10, 0.12, 0.14]))
    assert (one.baseline, one.value) == (pytest.approx(0.12), pytest.approx(0.12))
    assert one.status == "same"


def test_what_is_undefined_or_missing_is_red():
    nan = series([0.1, math.nan, 0.14])
    assert verdict(BASE, nan).status == "failed"
    assert "seed 1" in verdict(BASE, nan).why
    assert verdict(BASE, series([0.10, 0.12])).status == "failed"
    (gone,) = compare({BASE.key: BASE}, measured(), TOLERANCES)
    assert gone.status == "gone"
    (unrun,) = compare({BASE.key: BASE}, measured(cases=("boxes",)), TOLERANCES)
    assert (unrun.status, unrun.why) == ("gone", "the case was not run")
    assert is_red([gone])
    (new,) = compare({}, measured(nan), TOLERANCES)
    assert new.status == "failed"


def test_a_failed_job_is_red_and_named():
    failures = {"map/desk/seed0/default/w000": "its worker died"}
    verdicts = compare({BASE.key: BASE}, measured(failures=failures), TOLERANCES)
    assert [one.status for one in verdicts] == ["failed", "failed"]
    assert "its worker died" in " ".join(one.why for one in verdicts)


def test_another_scene_or_metric_is_not_comparable_and_not_red():
    one = verdict(BASE, series([9, 9, 9], identity="other"))
    assert one.status == "not comparable"
    assert not is_red([one])


def test_what_is_new_is_told_and_not_red():
    (one,) = compare({}, measured(BASE), TOLERANCES)
    assert (one.status, one.value) == ("new", pytest.approx(0.12))
    assert not is_red([one])


def test_speed_counts_by_its_best_and_by_a_factor():
    base = Series(
        case="desk", method=SPEED_METHOD, metric=SPEED_METRIC, unit="x", better="lower",
        identity="i", values={0: 2.0, 1: 2.2, 2: 9.0},
    )  # fmt: skip
    cases = {2.0: "same", 2.9: "same", 3.1: "worse", 1.4: "same", 1.3: "better"}
    for best, status in cases.items():
        now = base.model_copy(update={"values": {0: 50.0, 1: best}})
        assert verdict(base, now).status == status


def test_one_seed_alone_has_a_tolerance_of_its_own():
    base = series([0.10])
    assert verdict(base, series([0.1015]), seeds=(0,)).status == "same"
    assert verdict(base, series([0.103]), seeds=(0,)).status == "worse"


values = st.floats(0.01, 10)


@given(st.lists(values, min_size=3, max_size=8), st.floats(-0.5, 0.5))
def test_both_ways_alike(before, shift):
    """What is worse one way is better the other way, and a looser gate finds no more."""
    base = series(before)
    up, down = (series([value + s for value in before]) for s in (shift, -shift))
    seeds = tuple(range(len(before)))
    one, other = verdict(base, up, seeds=seeds), verdict(base, down, seeds=seeds)
    mirror = {"worse": "better", "better": "worse", "same": "same"}
    assert one.status == mirror[other.status]
    loose = replace(TOLERANCES, paired=1.0, relative=0.5)
    (loosely,) = compare({base.key: base}, measured(up, seeds=seeds), loose)
    assert loosely.status in ("same", one.status)


@given(st.lists(values, min_size=3, max_size=8))
def test_a_result_is_the_same_as_itself(before):
    base = series(before)
    assert verdict(base, base, seeds=tuple(range(len(before)))).status == "same"


def test_unchanged_code_stays_green_with_other_seeds():
    """A hundred runs with other seeds of 40 numbers with a spread of 30 %: at most one is red."""
    rng = np.random.default_rng(7)
    red = 0
    for _ in range(100):
        base = {
            one.key: one
            for one in (series(rng.normal(1, 0.3, 8), metric=f"m{k}") for k in range(40))
        }
        found = [
            one.model_copy(update={"values": dict(enumerate(rng.normal(1, 0.3, 3), 100))})
            for one in base.values()
        ]
        red += is_red(compare(base, measured(*found, seeds=(100, 101, 102)), TOLERANCES))
    assert red <= 1


def test_any_three_seeds_of_the_project_are_green_against_its_others():
    """Real numbers of unbroken code, heavy tails and all: 56 splits of the baseline's seeds."""
    known = [one for one in read_baseline(BASELINE).series if one.metric != SPEED_METRIC]
    cases = tuple({one.case for one in known})
    for three in combinations(range(8), 3):
        others = {
            one.key: one.model_copy(update={"values": part(one, set(range(8)) - set(three))})
            for one in known
        }
        found = [one.model_copy(update={"values": part(one, set(three))}) for one in known]
        verdicts = compare(others, measured(*found, seeds=three, cases=cases), TOLERANCES)
        assert [one for one in verdicts if one.status in RED] == []


def part(one, seeds):
    return {seed: one.values[seed] for seed in sorted(seeds)}


# Files


def test_a_baseline_says_why_and_keeps_its_history(tmp_path):
    path = tmp_path / "b.json"
    first = make_baseline(measured(BASE), "at first", None)
    write_baseline(path, first)
    assert read_baseline(path) == first
    second = make_baseline(measured(BASE), "finer \n planes", read_baseline(path))
    assert [change.reason for change in second.history] == ["at first", "finer planes"]


@pytest.mark.parametrize(
    ("about", "reason"),
    [
        (measured(BASE), "  "),
        (measured(BASE, failures={"map/desk": "died"}), "why"),
        (measured(series([0.1, math.nan, 0.1])), "why"),
        (measured(series([0.1, 0.1])), "why"),
        (measured(), "why"),
    ],
)
def test_no_baseline_of_what_is_incomplete(about, reason):
    with pytest.raises(InputError, match=r"baseline"):
        make_baseline(about, reason, None)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"schema_version": 99}', '{"schema_version": 1}', "\x00", "null"]
)
def test_a_damaged_baseline_is_one_line(tmp_path, text):
    path = tmp_path / "b.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"^baseline .*--update") as caught:
        read_baseline(path)
    assert "\n" not in str(caught.value)


VERDICTS = [
    Verdict(Key("desk", "Alg1/H", "mean_error"), "worse", "m", 0.1, 0.2, 0.01),
    Verdict(Key("desk", "a|b <&>\x00", "bad"), "failed", "%", why="undefined (NaN) for seed 1"),
    Verdict(Key("desk", "Alg1/A", "bad"), "not comparable", "%", why="another scene"),
    Verdict(Key("desk", "Alg1/G", "bad"), "better", "%", 3.0, 2.0, 0.5),
    Verdict(Key("desk", "Alg1/min", "bad"), "same", "%", 3.0, 3.0, 0.5),
]


def test_junit_has_a_case_for_each_number(tmp_path):
    write_junit(tmp_path / "j.xml", VERDICTS)
    suite = xml.parse(tmp_path / "j.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("5", "2", "1")
    assert len(suite.findall("testcase")) == 5
    failures = suite.findall("testcase/failure")
    assert [one.get("type") for one in failures] == ["worse", "failed"]
    assert "0.2 m against 0.1 m, ± 0.01 m allowed" in failures[0].get("message")


def test_the_table_names_the_culprit_first_and_leaves_out_what_is_the_same():
    text = report.markdown(VERDICTS, "title")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert "worse | desk | Alg1/H | mean_error | 0.1 m | 0.2 m | +0.1 | ± 0.01 |" in rows[2]
    assert "a\\|b" in text
    assert "Alg1/min" not in text
    assert report.summary(VERDICTS).startswith("gate: red (1 worse, 1 failed")
    many = [replace(VERDICTS[0], key=Key("c", "m", str(k))) for k in range(99)]
    assert "and 74 more" in report.markdown(many, "title")


def test_verdicts_as_json_have_no_nan():
    content = json.loads(report.as_json(VERDICTS), parse_constant=pytest.fail)
    assert [one["status"] for one in content] == [one.status for one in VERDICTS]


# The command


def results(folder, error=0.1, sequence="s", versions=None):
    rows = tuple(
        Row("room", "all", "mine", metric, value, "m", "lower")
        for metric, value in (("mean_error", error), ("median_error", error / 2))
    )
    folder.mkdir()
    metrics = versions or {}
    write_results(folder, Results(rows, {"score": {}}, 0, {"room": sequence}, metrics=metrics))
    return str(folder / "results.json")


def gate(*arguments):
    return main(["gate", *map(str, arguments)])


@pytest.fixture
def held(tmp_path):
    """A baseline of somebody's own mapper, from results of his."""
    path = tmp_path / "baseline.json"
    mine = results(tmp_path / "first")
    arguments = ("--update", "--reason", "first")
    assert gate("--baseline", path, "--result", mine, *arguments) == 0
    return path


def test_own_results_are_gated(held, tmp_path, monkeypatch, capsys):
    step = tmp_path / "step.md"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    same, worse = results(tmp_path / "same"), results(tmp_path / "worse", 0.2)
    assert gate("--baseline", held, "--result", same) == 0
    files = ("--junit", tmp_path / "j.xml", "--markdown", tmp_path / "m.md")
    assert gate("--baseline", held, "--result", worse, *files) == 1
    assert "first: room mine" in capsys.readouterr().out
    assert xml.parse(tmp_path / "j.xml").getroot()[0].get("failures") == "2"
    assert (tmp_path / "m.md").read_text() in step.read_text()
    assert step.read_text().count("### ") == 2


def test_another_sequence_is_not_comparable_unless_strict(held, tmp_path):
    other = results(tmp_path / "other", 0.2, sequence="t")
    assert gate("--baseline", held, "--result", other) == 0
    assert gate("--baseline", held, "--result", other, "--strict") == 1


def test_a_metric_that_computes_something_else_is_not_comparable(held, tmp_path, capsys):
    other = results(tmp_path / "other", 0.2, versions={"mean_error": "v2"})
    assert gate("--baseline", held, "--result", other, "--json") == 1
    found = {one["metric"]: one["status"] for one in json.loads(capsys.readouterr().out)}
    assert found == {"mean_error": "not comparable", "median_error": "worse"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--update"], "--update needs --reason"),
        (["--reason", "x"], "--reason without --update"),
        (["--result", "r.json", "--seeds", "1"], "--result runs nothing"),
        (["--seeds", "a"], "needs numbers"),
        (["--seeds", "1,1"], "each once"),
        (["--seeds", "5-3"], "at least one"),
        (["--suite", "nosuch"], "no subset 'nosuch'"),
        (["--result", "nosuch"], "no such file"),
        (["--workers", "0"], "--workers 0"),
    ],
)
def test_wrong_flags_are_one_line(held, arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    assert gate("--baseline", held, *arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_red_means_exactly_these():
    assert RED == ("worse", "failed", "gone")


def test_what_becomes_undefined_in_own_results_is_red(held, tmp_path, capsys):
    assert gate("--baseline", held, "--result", results(tmp_path / "nan", math.nan)) == 1
    assert "gone: missing or undefined (NaN)" in capsys.readouterr().out


def test_a_results_file_is_read_by_what_it_is(held, tmp_path):
    found = read_measured(tmp_path / "first")
    assert set(found.series) == {
        Key("room", "mine", "mean_error"),
        Key("room", "mine", "median_error"),
    }
