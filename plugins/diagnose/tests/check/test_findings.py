"""Verdicts and reports: what is worst, what is named, what JSON holds."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.plugins.diagnose.check.findings import (
    VERDICTS,
    Finding,
    Report,
    Series,
    judged,
    worst,
)
from eventsweep.plugins.diagnose.check.limits import LIMITS, verdict_of

NUMBERS = st.floats(0, 1e9)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def test_a_larger_value_is_never_better_where_it_should_be_small(value, more, a, b):
    usual, possible = sorted((a, b))
    limits = (-math.inf, usual), (-math.inf, possible)
    ranks = [VERDICTS.index(verdict_of(v, *limits)) for v in (value, value + more)]
    assert ranks[0] <= ranks[1]
    mirrored = tuple((-high, -low) for low, high in limits)
    assert verdict_of(-value, *mirrored) == verdict_of(value, *limits)


@pytest.mark.parametrize("name", LIMITS)
def test_limits_are_nested_and_what_is_no_number_is_wrong(name):
    usual, possible = LIMITS[name].usual, LIMITS[name].possible
    assert possible[0] <= usual[0] <= usual[1] <= possible[1]
    assert LIMITS[name].verdict(math.nan) == "wrong"
    assert judged(name, None, "").verdict == "wrong"


def _finding(verdict, name="name", suspect=""):
    meaning = "" if verdict == "good" else "bad"
    return Finding(name, verdict, 1.5, "m", "it is 1.5 m", meaning, suspect=suspect)


def test_a_good_finding_means_nothing():
    good = judged("baseline", 0.1, "it is 0.1 m", suspect="never")
    assert (good.meaning, good.cure, good.suspect) == ("", "", "")


def test_a_report_names_what_is_wrong_once_and_in_order():
    findings = [_finding(v, n, s) for v, n, s in (
        ("good", "a", "x"), ("wrong", "b", "second"), ("doubtful", "c", "y"), ("wrong", "d", ""),
        ("wrong", "e", "second"))]  # fmt: skip
    report = Report("rec", tuple(findings))
    assert report.suspects == ("second", "d")
    assert report.verdict == "wrong"
    assert report.finding("c") is findings[2]
    assert report.finding("z") is None
    assert "1 good, 1 doubtful, 3 wrong" in repr(report)
    assert findings[1].line() == "b wrong: second: it is 1.5 m; bad"


def test_a_cause_is_named_before_what_is_odd():
    cause = replace(_finding("wrong", "m", "first"), cure="mend it")
    report = Report("rec", (_finding("wrong", "a", "odd"), cause))
    assert report.suspects == ("first", "odd")
    assert cause.line() == "m wrong: first: it is 1.5 m; mend it"


@pytest.mark.parametrize(
    ("verdict", "whole", "part"),
    [("good", "good", "unchecked"), ("doubtful", "doubtful", "doubtful"), ("wrong",) * 3],
)
def test_what_was_not_looked_at_is_not_called_good(verdict, whole, part):
    assert Report("rec", (_finding(verdict),)).verdict == whole
    assert Report("rec", (_finding(verdict),), (("mapping", "left out"),)).verdict == part


def test_nothing_looked_at_is_good():
    assert worst([]) == "good"


def test_json_is_plain_and_holds_no_nan():
    curve = Series(np.array([1.0, np.nan]), np.array([0.0, 1.0]), "t, s", "v, m/s")
    image = Series(np.zeros((2, 3)))
    findings = (Finding("a", "wrong", math.inf, "m", "far", series=curve),
                Finding("b", "good", 1.0, "m", "near", series=image))  # fmt: skip
    text = json.dumps(
        Report("rec", findings, (("mapping", "no poses"),)).to_json(), allow_nan=False
    )
    values = json.loads(text)
    assert values["findings"][0]["value"] is None
    assert values["findings"][0]["series"]["y"] == [1.0, None]
    assert values["findings"][1]["series"] is None
    assert values["unchecked"] == [{"name": "mapping", "reason": "no poses"}]
    assert values["verdict"] == "wrong"
