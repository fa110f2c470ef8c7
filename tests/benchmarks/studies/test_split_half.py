"""The split-half test says what is stable, and refuses what cannot be halved."""

import numpy as np
import pytest

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.ranking.entries import join
from ranking_entries import entry
from split_half import split_half, stability_text


def table(means, cases=4, seeds=5, spread=0.05):
    rng = np.random.default_rng(0)
    scales = 10.0 ** np.arange(cases)  # scenes of very different sizes
    return {
        method: [list(mean * scale * (1 + spread * rng.standard_normal(seeds))) for scale in scales]
        for method, mean in means.items()
    }


def test_clear_differences_are_stable():
    joined = join([entry("v1", {"a": 0.1, "b": 0.2, "c": 0.4})])
    text = stability_text(joined, "mean_error")
    assert "3 methods, 3 cases, 5 seeds halved in 10 ways" in text
    assert "3 of 3 couples do not tie" in text
    assert "same in both halves 100.0 %" in text
    assert "τ of the halves' orders is 1.00" in text


def test_equal_methods_tie():
    text = stability_text(join([entry("v1", {"a": 0.1, "b": 0.1}, spread=0.5)]), "mean_error")
    assert "0 of 1 couples do not tie by all seeds.\n" in text


@pytest.mark.parametrize(("seeds", "metric"), [(3, "mean_error"), (5, "beauty")])
def test_what_cannot_be_halved_is_one_line(seeds, metric):
    with pytest.raises(InputError, match=r"no metric beauty|needs the same number"):
        stability_text(join([entry("v1", {"a": 0.1, "b": 0.2}, seeds=seeds)]), metric)


def test_halves_keep_a_clear_order_and_turn_an_unclear_one():
    clear = split_half(table({"a": 1.0, "b": 1.5, "c": 2.5}), "lower")
    assert (clear.splits, clear.pairs, clear.kept, clear.agreement) == (10, 3, 1.0, 1.0)
    assert clear.turned == {}
    even = split_half(table({"a": 1.0, "b": 1.5}, seeds=4), "lower")
    assert even.splits == 3
    unclear = split_half(table({"a": 1.0, "b": 1.0, "c": 1.0, "d": 1.0}, spread=0.5), "lower")
    assert unclear.agreement < 0.8
    assert np.isnan(unclear.kept) or unclear.pairs


def test_a_couple_that_is_distinct_and_turns_is_named():
    values = {"a": [[1, 1, 1, 3]] * 3, "b": [[2, 2, 2, 2]] * 3, "c": [[9, 9, 9, 9]] * 3}
    found = split_half(values, "lower")
    assert found.pairs >= 2
    if ("a", "b") in found.turned:
        assert found.kept < 1
