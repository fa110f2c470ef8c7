"""The quick version of `interval_coverage.py`: fewer samples, the same bounds."""

from __future__ import annotations

import pytest

from interval_coverage import coverage, coverage_of_cases, skewed, table

QUICK = 1000


@pytest.mark.parametrize(("seeds", "windows"), [(5, 1), (5, 4), (8, 10)])
def test_from_five_seeds_on_intervals_hold_the_truth_as_often_as_they_say(seeds, windows):
    found = [coverage(seeds, windows, between, trials=QUICK) for between in (0.1, 0.9)]
    assert all(0.93 <= share <= 0.97 for share in found), found


def test_few_seeds_are_not_overconfident_either():
    assert all(coverage(seeds, 5, 0.5, trials=QUICK) > 0.92 for seeds in (2, 3))


def test_skewed_values_cost_a_few_percent():
    assert coverage(8, 10, 0.5, trials=QUICK, draw=skewed) > 0.90


@pytest.mark.parametrize("seeds", [2, 5])
def test_bands_over_fixed_cases_hold_the_truth_as_often_as_they_say(seeds):
    assert 0.93 <= coverage_of_cases(3, seeds, trials=QUICK) <= 0.98


def test_the_table_has_a_row_per_design():
    shown = table([(2, 1), (3, 2)], 250)
    assert "| 2 seeds × 1 windows | " in shown
    assert shown.count("\n") == 4
