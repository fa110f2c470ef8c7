"""The table of what methods cost: every line is a call that works, and a ratio to one of them."""

from __future__ import annotations

import re

import numpy as np
import pytest

import cost_methods
from cost_methods import ASKED, MethodsEffort, costs, main, table
from eventsweep.emvs.methods import methods_by_name

TINY = MethodsEffort(events=2000, planes=4, rounds=1)


def test_every_line_asks_for_methods_that_exist():
    assert all(methods_by_name(names, 2) for names in ASKED.values())


def test_every_call_is_measured():
    seconds = costs(TINY, (32, 24), [("Alg1/H",), ("Alg2/AtHc@2", "Focus/H")])
    assert seconds.shape == (2,)
    assert (seconds > 0).all()


def test_ratios_are_to_the_base():
    text = table({"small": np.array([1.0, 2.0]), "large": np.array([9.0, 3.0])}, ["a", "b"], 1)
    assert text.splitlines()[2:] == ["| a | × 0.50 | × 3.00 |", "| b | 2.00 s | 3.00 s |"]


@pytest.mark.slow
def test_the_command_fills_the_page(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cost_methods, "SENSORS", {"tiny": (32, 24)})
    needed = ("`Alg1/H`", "`Focus/H`", "`Learned/H`", cost_methods.EIGHT, cost_methods.ALL)
    monkeypatch.setattr(cost_methods, "ASKED", {name: ASKED[name] for name in needed})
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- costs: begin -->\nold\n<!-- costs: end -->\nz\n")
    asked = ["--events", "2000", "--planes", "4", "--rounds", "1", "--page", str(page)]
    assert main(asked) == 0
    text = page.read_text()
    assert "old" not in text
    assert "2 000 events each, 4 planes" in text
    assert "µs for each" in text
    peaks = [float(mb) for mb in re.findall(r"(\d+) MB", text)]
    assert len(peaks) == 3
    assert min(peaks) > 50
    page.write_text("no marks")
    assert main(asked) == 2
    assert "costs: begin" in capsys.readouterr().err
