"""The page of a check: what is wrong first, evidence and cures, nothing that runs from names."""

import json

import numpy as np

from eventsweep.emvs.check.findings import Finding, Report, Series
from eventsweep.eval.report.check_page import check_page_text, summary, write_check_page
from report_data import WellFormed


def _report(name="rec"):
    curve = Series(np.array([1.0, 2.0]), np.array([0.0, 1.0]), "t, s", "v, m/s", (1.5, 1e9))
    image = Series(np.array([[0.0, 1.0], [np.nan, 2.0]]), y_label="events")
    return Report(
        name,
        (
            Finding("fine", "good", 1.0, "m", "it is 1 m", series=image),
            Finding("odd", "doubtful", 2.0, "m", "it is 2 m", "may hurt", "look", "stray"),
            Finding("bad", "wrong", 3.0, "m", "it is 3 m", "it hurts", "mend it", "unit", curve),
        ),
        (("mapping", "there are no poses"),),
    )


def test_what_is_wrong_comes_first_with_its_cure(tmp_path):
    text = write_check_page(tmp_path, _report()).read_text()
    WellFormed(text)
    assert text.index('id="bad"') < text.index('id="odd"') < text.index('id="fine"')
    for words in ("it is 3 m", "it hurts", "mend it", "there are no poses", "<svg", "image/png"):
        assert words in text
    assert 'src="http' not in text
    assert 'href="http' not in text
    assert json.loads((tmp_path / "check.json").read_text())["suspects"] == ["unit"]


def test_names_are_escaped():
    text = check_page_text(_report("<script>alert(1)</script>"))
    WellFormed(text)
    assert "<script>alert" not in text


def test_the_summary_counts_and_names():
    assert summary(_report()) == "3 findings: 1 wrong (unit), 1 doubtful."
    assert summary(Report("rec", _report().findings[:1])) == "1 finding: nothing is wrong."
