"""The page of a check: what is wrong first, evidence and cures, nothing that runs from names."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from eventsweep.plugins.diagnose import check_page
from eventsweep.plugins.diagnose.check.findings import TIME, Finding, Report, Series
from report_data import WellFormed


def _report(name="rec"):
    curve = Series(np.array([1.0, 2.0]), np.array([0.0, 1.0]), "t, s", "v, m/s", (1.5, 1e9))
    image = Series(np.array([[0.0, 1.0], [np.nan, 2.0]]), y_label="events")
    findings = (
        Finding("fine", "good", 1.0, "m", "it is 1 m", series=image),
        Finding("odd", "doubtful", 2.0, "m", "it is 2 m", "may hurt", "", "stray"),
        Finding(
            "bad",
            "wrong",
            3.0,
            "m",
            "it is 3 m",
            "it hurts",
            "mend it by `calibrate`",
            "unit",
            curve,
        ),
    )
    return Report(name, findings, (("mapping", "there are no poses"),))


def test_what_is_wrong_comes_first_with_its_cure_and_the_summary_counts(tmp_path):
    text = check_page.write_check_page(tmp_path, _report()).read_text()
    WellFormed(text)
    assert (
        text.index('id="bad"')
        < text.index('id="odd"')
        < text.index('id="good"')
        < text.index("it is 1 m")
    )
    for words in ("it is 3 m", "it hurts", "mend it", "there are no poses", "<svg", "image/png"):
        assert words in text
    assert text.count("mend it by calibrate") == 2  # without a terminal's marks
    assert (text.count("<dt>Means"), text.count("<b>Cure: </b>")) == (2, 1)
    places = [text.index(said, text.index('id="bad"')) for said in
              ("unit</h2>", "mend it", "it hurts", "it is 3 m")]  # fmt: skip
    assert places == sorted(places), "what is wrong, the cure, what it means, the evidence"
    assert not re.search('(?:src|href)="http', text)
    assert json.loads((tmp_path / "check.json").read_text())["suspects"] == ["unit"]
    hostile = check_page.check_page_text(_report("<script>alert(1)</script>"))
    WellFormed(hostile)
    assert "<script>alert" not in hostile
    assert (
        check_page.summary(_report())
        == "Wrong: unit. Cure: mend it by `calibrate`. Doubtful: stray."
    )
    fine = Report("rec", _report().findings[:1])
    assert check_page.summary(fine) == "Nothing is wrong: 1 check."
    part = replace(fine, unchecked=_report().unchecked)
    assert check_page.summary(part) == "Nothing is wrong in what was checked: 1 check."


@pytest.mark.parametrize(
    ("first_s", "label"), [(0.25, TIME), (1.7e9, "time since 1700000000.000 s, s")]
)
def test_times_of_a_clock_are_shown_from_the_first_on(first_s, label):
    series = Series(np.ones(3), first_s + np.arange(3), TIME, "events per second")
    x, shown = check_page._since_zero(series)
    assert shown == label
    np.testing.assert_allclose(x, np.arange(3) + (first_s if label == TIME else 0))
    other = Series(np.ones(3), first_s + np.arange(3), "shift, px", "correlation")
    assert check_page._since_zero(other)[1] == "shift, px"
