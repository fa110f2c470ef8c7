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

from eventsweep.eval.cli.main import main
from eventsweep.eval.gate import report
from eventsweep.eval.gate.baseline import make_baseline, read_baseline, write_baseline
from eventsweep.eval.gate.compare import (
    DECIDING,
    WITHOUT_TRUTH,
    Choice,
    Judgement,
    Tolerances,
    compare,
    is_red,
)
from eventsweep.eval.gate.report import write_junit
from eventsweep.eval.results.results import Results, write_results
from eventsweep.eval.results.series import (
    SIGNED_ERRORS,
    SPEED_METHOD,
    SPEED_METRIC,
    Key,
    Measured,
    Origin,
    Series,
    read_measured,
)
from eventsweep.eval.results.table import tidy
from eventsweep.eval.scoring.metrics import PRIMARY_OF_GEOMETRIES
from eventsweep.eval.scoring.trajectories.metrics import KNOWN_METRICS, PRIMARY_OF_TRAJECTORIES
from places import ROOT
from refusals import command_refused, line_of
from score_rows import score_row

TOLERANCES = Tolerances()
BASELINE = ROOT / "reports" / "baseline.json"


def series(values, metric="mean_error", direction="lower", case="desk", unit="m", identity="i"):
    values = dict(enumerate(values)) if not isinstance(values, dict) else values
    return Series(
        case=case, method="Alg1/H", metric=metric, unit=unit, direction=direction,
        identity=identity, values=values,
    )  # fmt: skip


def measured(*found, seeds=(0, 1, 2), cases=("desk",), failures=None):
    return Measured("test", {one.key: one for one in found}, seeds, cases, failures or {}, {})


def verdict(base, now, **about):
    verdicts = compare({base.key: base}, measured(now, **about), TOLERANCES)
    return next(one for one in verdicts if one.key == base.key)


BASE = series([0.10, 0.12, 0.14, 0.11, 0.13])


# Verdicts
@pytest.mark.parametrize(("direction", "shift", "status"), [
    ("lower", 0.05, "worse"), ("lower", -0.05, "better"), ("higher", 0.05, "better"),
    ("higher", -0.05, "worse"), ("none", 0.05, "changed"), ("none", -0.05, "changed"),
    ("lower", 0.0, "same"), ("higher", 1e-4, "same"),
])  # fmt: skip
def test_direction_decides(direction, shift, status):
    base = BASE.model_copy(update={"direction": direction})
    now = base.model_copy(update={"values": {k: base.values[k] + shift for k in range(3)}})
    assert verdict(base, now).status == status


def test_equal_seeds_are_compared_one_by_one():
    """A shift that drowns in the spread between seeds is seen when seeds are the same."""
    shift = 0.3 * np.std(list(BASE.values.values()), ddof=1)
    for first, status in ((0, "worse"), (100, "same")):
        now = series({first + k: BASE.values[k] + shift for k in range(3)})
        assert verdict(BASE, now, seeds=tuple(now.values)).status == status
    one = verdict(BASE, series([0.10, 0.12, 0.14]))  # the baseline is that of its seeds
    assert (one.baseline, one.value) == (pytest.approx(0.12), pytest.approx(0.12))
    assert one.status == "same"


@pytest.mark.parametrize(("before", "now", "alike", "allowed"), [
    (Origin(sequence="a", recipe="r"), Origin(sequence="a", recipe="r"), "sequence", 1e-5),
    (Origin(sequence="a"), Origin(sequence="a", recipe="s"), "sequence", 1e-5),
    (Origin(sequence="a", recipe="r"), Origin(sequence="b", recipe="r"), "recipe", 1e-2),
    (Origin(sequence="a", recipe="r"), Origin(sequence="b", recipe="s"), "seeds", 2e-2),
    (Origin(), Origin(), "seeds", 2e-2),
])  # fmt: skip
@pytest.mark.parametrize("direction", ["lower", "higher"])
def test_the_more_is_the_same_the_less_may_change(before, now, alike, allowed, direction):
    """A change of a number is one in either direction; only a strict gate forbids the good one."""
    base = series([0.7], direction=direction).model_copy(update={"origins": {0: before}})
    for share in (0.9 * allowed, -0.9 * allowed, 1.1 * allowed, -1.1 * allowed):
        changed = series([0.7 * (1 + share)], direction=direction)
        current = measured(changed.model_copy(update={"origins": {0: now}}), seeds=(0,))
        (free,) = compare({base.key: base}, current, TOLERANCES)
        (strict,) = compare({base.key: base}, current, TOLERANCES, Choice(strict=True))
        good = (share < 0) == (direction == "lower")
        beyond = "better" if good else "worse"
        assert free.status == strict.status == (beyond if abs(share) > allowed else "same")
        assert free.alike == alike
        is_worse, is_other = free.status == "worse", free.status != "same"
        assert free.is_red == is_worse
        assert strict.is_red == (is_other if alike == "sequence" else is_worse)


def test_a_baseline_keeps_what_its_numbers_were_made_of(tmp_path):
    origins = {0: Origin(sequence="a", recipe="r"), 1: Origin(sequence="b")}
    numbers = series([1, 2]).model_copy(update={"origins": origins})
    speed = series([2.0], metric=SPEED_METRIC)  # of the same case, and of no sequence
    made = measured(numbers, speed, seeds=(0, 1))
    write_baseline(tmp_path / "b", make_baseline(made, "why", None))
    assert read_baseline(tmp_path / "b").by_key()[numbers.key].origins == origins


@pytest.mark.parametrize(("before", "now", "why"), [
    (Origin(sequence="a"), Origin(sequence="a"), "another way to score"),
    (Origin(sequence="a", recipe="r"), Origin(sequence="b", recipe="r"), "with the same settings"),
    (Origin(sequence="a", recipe="r"), Origin(sequence="b", recipe="s"), "another sequence"),
    (Origin(), Origin(sequence="b"), "another case, scene or metric"),
])  # fmt: skip
def test_what_cannot_be_compared_says_what_differs(before, now, why):
    base = series([1]).model_copy(update={"origins": {0: before}})
    other = series([1], identity="j").model_copy(update={"origins": {0: now}})
    (_, lost) = compare({base.key: base}, measured(other, seeds=(0,)), TOLERANCES)
    assert lost.status == "not comparable"
    assert why in lost.why


def test_what_is_undefined_or_missing_is_red():
    nan = series([0.1, math.nan, 0.14])
    assert verdict(BASE, nan).status == "failed"
    assert "seed 1" in verdict(BASE, nan).why
    assert verdict(BASE, series([0.10, 0.12])).status == "failed"
    (_, gone) = compare({BASE.key: BASE}, measured(), TOLERANCES)
    assert gone.status == "gone"
    (_, unrun) = compare({BASE.key: BASE}, measured(cases=("boxes",)), TOLERANCES)
    assert (unrun.status, unrun.why) == ("gone", "the case was not run")
    assert is_red([gone])
    (new,) = compare(None, measured(nan), TOLERANCES)
    assert new.status == "failed"


def test_what_is_new_is_not_red_and_a_failed_job_is():
    other = series([1, 1, 1], metric="points", direction="higher")
    verdicts = compare({BASE.key: BASE}, measured(BASE, other), TOLERANCES)
    assert [one.status for one in verdicts] == ["new", "same"]
    assert not is_red(verdicts)
    (first,) = compare(None, measured(BASE), TOLERANCES)
    assert (first.status, first.value) == ("new", pytest.approx(0.12))
    assert not is_red([first])
    failures = {"map/desk/seed0/default/w000": "its worker died"}
    verdicts = compare({BASE.key: BASE}, measured(failures=failures), TOLERANCES)
    assert [one.status for one in verdicts] == ["failed", "failed"]
    assert "its worker died" in " ".join(one.why for one in verdicts)


# What decides, and what was compared at all

ALL = Choice()


def judged(*changes, choice=ALL, identity="i"):
    """Verdicts where each (metric, direction) of a baseline of 1 has become its value."""
    base, now = [], []
    for metric, direction, value in changes:
        about = {"metric": metric, "direction": direction}
        base.append(series([1, 1, 1], **about))
        now.append(series([value] * 3, **about, identity=identity))
    return compare({one.key: one for one in base}, measured(*now), TOLERANCES, choice)


def test_a_gate_that_compared_nothing_is_red():
    """All of another sequence, nothing run, or nothing that decides: none of them is green."""
    changes = [(metric, "lower", 1) for metric in ("points", "mean_error", "cause_noise")]
    strange = judged(*changes, identity="other")
    assert [one.status for one in strange] == ["failed", *["not comparable"] * 3]
    assert strange[0].why.startswith("none of the 2 numbers that decide could be compared: desk")
    assert is_red(strange)
    descriptive = judged(("cause_noise", "none", 1))
    assert is_red(descriptive)
    assert "the baseline has no deciding number of mean_error" in descriptive[0].why
    assert is_red(compare({}, measured(BASE), TOLERANCES))


@pytest.mark.parametrize(("status", "lost"), [
    ("not comparable", {"identity": "other"}), ("gone", None),
    ("failed", {"values": {0: 1, 1: math.nan, 2: 1}}),
])  # fmt: skip
def test_fewer_numbers_than_the_baseline_asks_for_are_red(status, lost):
    other = series([1, 1, 1], metric="points", direction="higher")
    found = [other.model_copy(update=lost)] if lost else []
    verdicts = compare({BASE.key: BASE, other.key: other}, measured(BASE, *found), TOLERANCES)
    assert [one.status for one in verdicts] == [status, "same"]
    assert is_red(verdicts)


@pytest.mark.parametrize("lost", [True, False])
def test_what_decides_nothing_may_be_lost_unless_strict(lost):
    other = series([1, 1, 1], metric="cause_noise", direction="none")
    found = [] if lost else [other.model_copy(update={"identity": "other"})]
    changed = [other.model_copy(update={"values": dict.fromkeys(range(3), 2)})]
    known = {BASE.key: BASE, other.key: other}
    for now, strict, red in ((found, False, False), (found, True, True), (changed, True, False)):
        choice = Choice(strict=strict)
        assert is_red(compare(known, measured(BASE, *now), TOLERANCES, choice)) == red


def test_what_decides_is_green_or_red_whatever_descriptive_numbers_say():
    """Finer planes: metrics in cells double, causes shift, a tail grows; the error falls."""
    verdicts = judged(
        ("median_error", "lower", 0.97), ("mean_error", "lower", 1), ("mean_cells", "lower", 2),
        ("cause_other", "none", 1.3), ("mean_error_top_1pct", "lower", 1.1),
    )  # fmt: skip
    assert not is_red(verdicts)
    assert [(one.key.metric, one.status, one.decides) for one in verdicts] == [
        ("median_error", "better", True), ("mean_error", "same", True),
        ("cause_other", "changed", False), ("mean_cells", "worse", False),
        ("mean_error_top_1pct", "worse", False),
    ]  # fmt: skip
    assert report.summary(verdicts) == (
        "gate: green (1 better, 1 same; not deciding: 1 changed, 2 worse). 1 number is better by "
        "more than is allowed: if that is intended, write it with --update. Compared: 5 of other "
        "sequences with the same seeds"
    )
    rows = [row[0] for row in report.lines(verdicts)]
    assert rows == ["better", "(changed)", "(worse)", "(worse)"]
    chosen = judged(("mean_cells", "lower", 2), choice=Choice(metrics=("mean_cells",)))
    assert is_red(chosen)
    verdicts = judged(
        ("median_error", "lower", 0.5), ("mean_error", "lower", 2), ("mean_cells", "lower", 9)
    )
    assert report.summary(verdicts).startswith(
        "gate: red (1 worse, 1 better; not deciding: 1 worse); decided by mean_error (1); "
        "first: desk Alg1/H mean_error worse: 200 cm against 100 cm"
    )


def test_where_every_number_decides_the_telling_ones_are_named_first():
    """With --strict a fault changes a hundred numbers; the summary stays one that is read."""
    minor = [(f"recall_{k}cm", "higher", 0.1) for k in range(20)]
    verdicts = judged(*minor, ("points", "higher", 0.5), choice=Choice(strict=True))
    verdicts = [replace(one, is_red=True, decides=True) for one in verdicts]
    said = report.summary(verdicts)
    assert "; decided by points (1), recall_" in said
    assert f" and {21 - report.MOST_METRICS} more; first: desk Alg1/H points worse" in said
    assert report.lines(verdicts)[0][3] == "points"


def test_other_events_are_red_and_said_loudly():
    """Nobody can say whether the depth of other events is better."""
    events = series([1000] * 3, metric="events", direction="none")
    events = events.model_copy(update={"method": "events"})
    now = events.model_copy(update={"values": dict.fromkeys(range(3), 1100)})
    known = {BASE.key: BASE, events.key: events}
    better = BASE.model_copy(update={"values": dict.fromkeys(BASE.values, 0.01)})
    verdicts = compare(known, measured(better, now), TOLERANCES)
    assert [one.status for one in verdicts] == ["changed", "better"]
    assert is_red(verdicts)
    assert "THE INPUT CHANGED (desk)" in report.summary(verdicts)
    only_depth = Choice(metrics=("mean_error",))
    assert not is_red(compare(known, measured(better, now), TOLERANCES, only_depth))
    same = {"origins": {k: Origin(sequence="a") for k in range(5)}}
    known = {key: numbers.model_copy(update=same) for key, numbers in known.items()}
    verdicts = compare(known, measured(now.model_copy(update=same)), TOLERANCES)
    said = report.summary(verdicts)
    assert "THE MAPPER TOOK OTHER EVENTS (desk) of the same sequence" in said
    assert "THE INPUT CHANGED" not in said


def test_every_direction_of_the_projects_primary_numbers_is_known():
    """Only the input and signed errors have none: of all else, more or less is better."""
    known = read_baseline(BASELINE).series
    trajectories = set(PRIMARY_OF_TRAJECTORIES)
    elsewhere = {*trajectories, *PRIMARY_OF_GEOMETRIES, *WITHOUT_TRUTH}
    assert {one.metric for one in known} >= set(DECIDING) - elsewhere
    assert "none" not in {KNOWN_METRICS[name].direction for name in trajectories}
    undirected = {one.metric for one in known if one.metric in DECIDING and one.direction == "none"}
    assert undirected == {"events", "brighter_share", *SIGNED_ERRORS}


@pytest.mark.parametrize(("part", "choice"), [
    ({"case": "boxes"}, {"cases": ("desk",)}), ({"method": "Alg1/G"}, {"methods": ("Alg1/H",)}),
])  # fmt: skip
def test_a_chosen_part_is_all_that_is_asked_for(part, choice):
    """Another case that was not run is gone, unless it was not asked for."""
    other = BASE.model_copy(update=part)
    known = {BASE.key: BASE, other.key: other}
    assert is_red(compare(known, measured(BASE), TOLERANCES))
    verdicts = compare(known, measured(BASE), TOLERANCES, Choice(**choice))
    assert [one.status for one in verdicts] == ["same"]
    assert not is_red(verdicts)


@pytest.mark.parametrize("what", ["case", "method", "metric"])
def test_a_name_that_the_baseline_does_not_have_is_refused(what):
    said = line_of(Choice(**{f"{what}s": ("a",)}).check, {BASE.key: BASE})
    assert f"has no {what} 'a': choose from " in said
    Choice(cases=("desk",), methods=("Alg1/H",), metrics=("mean_error",)).check({BASE.key: BASE})


def test_speed_counts_by_its_best_and_one_seed_has_a_tolerance_of_its_own():
    speed = {"method": SPEED_METHOD, "metric": SPEED_METRIC, "unit": "x"}
    base = series([2.0, 2.2, 9.0]).model_copy(update=speed)
    cases = {2.0: "same", 2.9: "same", 3.1: "worse", 1.4: "same", 1.3: "better"}
    for best, status in cases.items():
        now = base.model_copy(update={"values": {0: 50.0, 1: best}})
        assert verdict(base, now).status == status
    base = series([0.10])
    assert verdict(base, series([0.1015]), seeds=(0,)).status == "same"
    assert verdict(base, series([0.103]), seeds=(0,)).status == "worse"


def test_speed_on_another_processor_is_new_and_of_another_case_not_comparable():
    speed = {"method": SPEED_METHOD, "metric": SPEED_METRIC, "unit": "x"}
    base, slow = (series([value]).model_copy(update=speed) for value in (2.0, 9.0))

    def judged(before, now):
        return verdict(
            *(
                one.model_copy(update={"identity": identity})
                for one, identity in ((base, before), (slow, now))
            )
        )

    assert judged("i on A", "i on A").status == "worse"
    for before, told in (("i on B", "the baseline on B"), ("i", "on an unnamed processor")):
        other = judged(before, "i on A")
        assert (other.status, other.value, other.is_red) == ("new", 9.0, False)
        assert other.why.startswith("timed on A, ")
        assert told in other.why
    assert judged("i on A", "j on B").status == "not comparable"


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
    assert verdict(base, base, seeds=seeds).status == "same"


def test_unchanged_code_stays_green_with_other_seeds():
    """A hundred runs with other seeds of 40 numbers with a spread of 30 %: at most one is red."""
    rng, red = np.random.default_rng(7), 0
    choice = Choice(metrics=tuple(f"m{k}" for k in range(40)))
    for _ in range(100):
        base = [series(rng.normal(1, 0.3, 8), metric=f"m{k}") for k in range(40)]
        found = [
            one.model_copy(update={"values": dict(enumerate(rng.normal(1, 0.3, 3), 100))})
            for one in base
        ]
        about = measured(*found, seeds=(100, 101, 102))
        red += is_red(compare({one.key: one for one in base}, about, TOLERANCES, choice))
    assert red <= 1


def test_the_error_rate_is_the_share_of_false_alarms():
    """Law: of one number with a normal spread, unchanged code is called different so often."""
    rng, often = np.random.default_rng(2), replace(TOLERANCES, error_rate=0.2)
    alarms = 0
    for values in rng.normal(1, 0.3, (3000, 8)):
        before, now = values[:5], values[5:]
        other = measured(series(dict(enumerate(now, 100))), seeds=(100, 101, 102))
        base = series(before)
        alarms += compare({base.key: base}, other, often)[0].status != "same"
    assert alarms / 3000 == pytest.approx(0.2, abs=0.03)


@pytest.mark.slow
def test_any_three_seeds_of_the_project_are_green_against_its_others():
    """Real numbers of unbroken code, heavy tails and all: 56 splits of the baseline's seeds."""
    known = [one for one in read_baseline(BASELINE).series if one.metric != SPEED_METRIC]
    cases = tuple({one.case for one in known})
    everything = Choice(metrics=tuple({one.metric for one in known}), strict=True)
    for three in combinations(range(8), 3):
        others, found = (
            [one.model_copy(update={"values": {k: one.values[k] for k in part}}) for one in known]
            for part in (sorted({*range(8)} - {*three}), three)
        )
        about = measured(*found, seeds=three, cases=cases)
        verdicts = compare({one.key: one for one in others}, about, TOLERANCES, everything)
        assert [one for one in verdicts if one.is_red] == []


# Files
def test_a_baseline_says_why_and_keeps_its_history(tmp_path):
    path = tmp_path / "b.json"
    first = make_baseline(measured(BASE), "at first", None)
    write_baseline(path, first)
    assert read_baseline(path) == first
    second = make_baseline(measured(BASE), "finer \n planes", read_baseline(path))
    assert [change.reason for change in second.history] == ["at first", "finer planes"]


@pytest.mark.parametrize(("about", "reason"), [
    (measured(BASE), "  "), (measured(BASE, failures={"map/desk": "died"}), "why"),
    (measured(series([0.1, math.nan, 0.1])), "why"), (measured(series([0.1, 0.1])), "why"),
    (measured(), "why"),
])  # fmt: skip
def test_no_baseline_of_what_is_incomplete(about, reason):
    assert "baseline" in line_of(make_baseline, about, reason, None)


@pytest.mark.parametrize("text", [
    "", "{", "[]", '{"schema_version": 99}', '{"schema_version": 1}', "\x00", "null",
    '{"schema_version": 1, "name": "n", "seeds": [0], "history": [], "versions": {}, "series": []}',
])  # fmt: skip
def test_a_damaged_baseline_is_one_line(tmp_path, text):
    (tmp_path / "b.json").write_text(text)
    said = line_of(read_baseline, tmp_path / "b.json")
    assert said.startswith("baseline ")
    assert "--update" in said


VERDICTS = [
    Judgement(Key("desk", "Alg1/H", "mean_error"), "worse", "m", 0.1, 0.2, 0.01),
    Judgement(Key("desk", "a|b <&>\x00", "bad"), "failed", "%", why="undefined (NaN) for seed 1"),
    Judgement(Key("desk", "Alg1/A", "points"), "not comparable", why="another scene"),
    Judgement(Key("desk", "Alg1/G", "bad"), "better", "%", 3.0, 2.0, 0.5),
    Judgement(Key("desk", "Alg1/min", "bad"), "same", "%", 3.0, 3.0, 0.5),
]
VERDICTS = list(map(Choice(metrics=("mean_error", "bad")).weighed, VERDICTS))


def test_junit_has_a_case_for_each_number(tmp_path):
    write_junit(tmp_path / "j.xml", VERDICTS)
    suite = xml.parse(tmp_path / "j.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("5", "2", "1")
    assert len(suite.findall("testcase")) == 5
    failures = suite.findall("testcase/failure")
    assert [one.get("type") for one in failures] == ["worse", "failed"]
    assert "20 cm against 10 cm, ± 1 cm allowed" in failures[0].get("message")
    content = json.loads(report.as_json(VERDICTS), parse_constant=pytest.fail)  # without NaN
    assert [one["status"] for one in content] == [one.status for one in VERDICTS]


def test_the_table_names_the_culprit_first_and_leaves_out_what_is_the_same():
    text = report.markdown(VERDICTS, "title")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert "worse | desk | Alg1/H | mean_error | 10 cm | 20 cm | +10 | ± 1 |" in rows[2]
    assert "a\\|b" in text
    assert "Alg1/min" not in text
    assert report.summary(VERDICTS).startswith("gate: red (1 worse, 1 failed")
    many = [replace(VERDICTS[0], key=Key("c", "m", str(k))) for k in range(99)]
    assert "and 74 more" in report.markdown(many, "title")
    assert "brackets" in text


# The command
def results(folder, error=0.1, sequence="s", versions=None, case="room", seed=0):
    rows = tuple(
        score_row(case, "all", "mine", metric, value, "m", "lower")
        for metric, value in (("mean_error", error), ("median_error", error / 2))
    )
    folder.mkdir()
    metrics = versions or {}
    write_results(
        folder,
        Results.from_dataframe(
            tidy(rows),
            configuration={"score": {}},
            seed=seed,
            sequences={case: sequence},
            metrics=metrics,
        ),
    )
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
    assert set(read_measured(tmp_path / "first").series) == {
        Key("room", "mine", "mean_error"), Key("room", "mine", "median_error"),
    }  # fmt: skip
    same, worse = results(tmp_path / "same"), results(tmp_path / "worse", 0.2)
    assert gate("--baseline", held, "--result", same) == 0
    files = ("--junit", tmp_path / "j.xml", "--markdown", tmp_path / "m.md")
    assert gate("--baseline", held, "--result", worse, *files) == 1
    assert "first: room mine" in capsys.readouterr().out
    assert xml.parse(tmp_path / "j.xml").getroot()[0].get("failures") == "2"
    assert (tmp_path / "m.md").read_text() in step.read_text()
    assert step.read_text().count("### ") == 2


@pytest.mark.parametrize("strict", [(), ("--strict",)])
def test_results_of_another_sequence_or_undefined_ones_are_red(held, tmp_path, capsys, strict):
    other = results(tmp_path / "other", 0.2, sequence="t")
    assert gate("--baseline", held, "--result", other, *strict) == 1
    assert "none of the 2 numbers that decide could be compared" in capsys.readouterr().out
    undefined = results(tmp_path / "nan", math.nan)
    assert gate("--baseline", held, "--result", undefined, *strict) == 1
    assert "mean_error is gone, missing or undefined (NaN)" in capsys.readouterr().out


def test_several_results_are_one_baseline(tmp_path, capsys):
    path, room = tmp_path / "both.json", results(tmp_path / "room")
    hall = results(tmp_path / "hall", case="hall", sequence="t")
    both = ("--baseline", path, "--result", room, "--result")
    assert gate(*both, hall, "--update", "--reason", "first") == 0
    assert gate(*both, hall, "--strict") == 0
    assert {one.sequence for of in read_baseline(path).origins.values() for one in of.values()} == {
        "s", "t",
    }  # fmt: skip
    assert gate(*both, results(tmp_path / "worse", 0.2, case="hall", sequence="t")) == 1
    assert gate("--baseline", path, "--result", room) == 1
    assert "hall mine mean_error gone: the case was not run" in capsys.readouterr().out
    assert "two results of case room" in command_refused(capsys, "gate", *both, room)
    seeds = results(tmp_path / "seeds", case="hall", seed=1)
    assert "results of seeds [0] and [1]" in command_refused(capsys, "gate", *both, seeds)


@pytest.mark.parametrize(("flags", "code"), [
    ("", 1), ("--metric median_error", 1), ("--tolerance 0.09", 1), ("--tolerance 0.11", 0),
    ("--metric mean_error --metric median_error", 1),
    ("--case room --method mine --tolerance 0.11", 0),
])  # fmt: skip
def test_metrics_and_tolerance_can_be_chosen(held, tmp_path, capsys, flags, code):
    worse = results(tmp_path / "worse", 0.11)
    assert gate("--baseline", held, "--result", worse, *flags.split()) == code
    median = "decided by median_error (1)" in capsys.readouterr().out
    assert median == (flags == "--metric median_error")


def test_another_metric_is_not_comparable_and_a_repeated_update_adds_nothing(
    held, tmp_path, capsys
):
    other = results(tmp_path / "other", 0.2, versions={"mean_error": "v2"})
    assert gate("--baseline", held, "--result", other, "--json") == 1
    found = {one["metric"]: one["status"] for one in json.loads(capsys.readouterr().out)}
    assert found == {"mean_error": "not comparable", "median_error": "worse"}
    # As after a kill between the file and the report.
    before = held.read_bytes()
    again = ("--baseline", held, "--result", results(tmp_path / "again"), "--update", "--reason")
    assert gate(*again, "first") == 0
    assert held.read_bytes() == before
    assert gate(*again, "second") == 0
    assert [one.reason for one in read_baseline(held).history] == ["first", "second"]


@pytest.mark.parametrize(("flags", "words"), [
    ("--update", "--update needs --reason"), ("--reason x", "--reason without --update"),
    ("--result r.json --seeds 1", "--result runs nothing"), ("--seeds a", "needs numbers"),
    ("--seeds 1,1", "without repeats"), ("--seeds 5-3", "at least one"),
    ("--suite nosuch", "unknown suite 'nosuch'"), ("--result nosuch", "no such file"),
    ("--workers 0 --suite mvsec-table-v1", "--workers 0"), ("--tolerance -0.1", "--tolerance -0.1"),
    ("--tolerance nan", "--tolerance nan"), ("--case hall", "no case 'hall': choose from room"),
    ("--method other", "no method 'other': choose from mine"),
    ("--metric points", "no metric 'points': choose from mean_error, median_error"),
    ("--update --reason x --case room", "--update writes a whole baseline"),
])  # fmt: skip
def test_wrong_flags_are_one_line(held, flags, words, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("EVENTSWEEP_CACHE", str(tmp_path / "cache"))
    assert words in command_refused(capsys, "gate", "--baseline", held, *flags.split())
