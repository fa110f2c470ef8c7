"""The split-half test says what is stable, and refuses what cannot be halved."""

import pytest

from eventsweep.emvs.errors import InputError
from eventsweep.eval.ranking.entries import join
from ranking_entries import entry
from split_half import told


def test_clear_differences_are_stable():
    joined = join([entry("v1", {"a": 0.1, "b": 0.2, "c": 0.4})])
    text = told(joined, "mean_error")
    assert "3 methods, 3 cases, 5 seeds halved in 10 ways" in text
    assert "3 of 3 couples do not tie" in text
    assert "same in both halves 100.0 %" in text
    assert "τ of the halves' orders is 1.00" in text


def test_equal_methods_tie():
    text = told(join([entry("v1", {"a": 0.1, "b": 0.1}, spread=0.5)]), "mean_error")
    assert "0 of 1 couples do not tie by all seeds.\n" in text


@pytest.mark.parametrize(("seeds", "metric"), [(3, "mean_error"), (5, "beauty")])
def test_what_cannot_be_halved_is_one_line(seeds, metric):
    with pytest.raises(InputError, match=r"no metric beauty|needs the same number"):
        told(join([entry("v1", {"a": 0.1, "b": 0.2}, seeds=seeds)]), metric)
