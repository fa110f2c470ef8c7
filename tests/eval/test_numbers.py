"""Numbers as people read them, alike wherever they are printed."""

import math
import re

import pytest

from eventsweep.emvs.errors import significant
from eventsweep.eval.cli.main import main
from eventsweep.eval.numbers import display_unit, displayed, in_display_unit, thousands
from small_pair import small_sequence

pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.mark.parametrize(("value", "unit", "text"), [
    (1234567.0, "px", "1,234,567"), (0.0123, "m", "1.23"), (12.3, "m", "1,230.00"),
    (4.5, "%", "4.50"), (0.0625, "m", "6.25"), (math.nan, "px", "–"), (math.nan, "%", "–"),
    (math.nan, "m", "–"),
])  # fmt: skip
def test_counts_have_commas_and_metres_are_read_in_centimetres(value, unit, text):
    assert displayed(value, unit) == text


def test_units_follow_their_values():
    assert [display_unit(unit) for unit in ("m", "px", "%", "")] == ["cm", "px", "%", ""]
    assert in_display_unit(0.25, "m") == 25
    assert in_display_unit(0.25, "%") == 0.25
    assert thousands(12345.4) == "12,345"


@pytest.mark.parametrize(
    ("value", "text"), [(0.0123456, "0.01235"), (12.3456, "12.35"), (12345.6, "12,346"), (0, "0")]
)
def test_significant_digits_never_cut_what_stands_before_the_point(value, text):
    assert significant(value) == text


def test_every_verb_sets_thousands_apart_alike(tmp_path, capsys):
    sequence, out = str(small_sequence(tmp_path / "seq")), str(tmp_path / "map")
    for words in (["info", sequence], ["map", sequence, "--out", out], ["score", out]):
        assert main(words) == 0
        told = capsys.readouterr()
        text = told.out + told.err
        assert "\u202f" not in text
        assert not re.search(r"\b\d{1,3} \d{3} events", text)
        assert not re.search(r"\b4000\b", text), words  # events of each camera
    assert main(["info", sequence]) == 0
    assert "4,000" in capsys.readouterr().out
