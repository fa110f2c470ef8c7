"""Ranks: places in every case and seed, ties where seeds do not tell."""

import numpy as np
import pytest

from eventsweep.eval.scoring.standings import lead_words, places, standings


def table(means, cases=4, seeds=5, spread=0.05):
    rng = np.random.default_rng(0)
    scales = 10.0 ** np.arange(cases)  # scenes of very different sizes
    return {
        method: [list(mean * scale * (1 + spread * rng.standard_normal(seeds))) for scale in scales]
        for method, mean in means.items()
    }


def test_who_is_clearly_better_is_ahead_and_missing_values_do_not_help():
    found = standings(table({"b": 1.0, "c": 1.001, "a": 0.5, "d": 2.0}), "lower")
    ranks = {one.method: one.rank for one in found}
    assert (ranks, found[0].place, found[-1].place) == ({"a": 1, "b": 2, "c": 2, "d": 4}, 1.0, 4.0)
    assert lead_words(found, 5) == "a is first."
    tied = standings(table({"b": 1.0, "c": 1.001}), "lower")
    assert lead_words(tied, 5).endswith("do not differ significantly: they share the first rank.")
    means = {"a": 0.5, "b": 1.0, "d": 2.0}
    lower, higher = (standings(table(means), better) for better in ("lower", "higher"))
    assert [one.method for one in lower] == ["a", "b", "d"]
    assert [one.method for one in higher] == ["d", "b", "a"]
    found = standings(table({"a": 1.0, "b": 9.0}, seeds=1), "lower")
    assert [(one.method, one.rank) for one in found] == [("a", 1), ("b", 1)]
    assert lead_words(found, 1).endswith("in this one a is placed first.")
    # A method that leaves out what is hard is last there, and drops nobody's case.
    values = table({"a": 1.0, "b": 2.0})
    values["sparse"] = [[0.5] * 5, *([np.nan] * 5 for _ in range(3))]
    found = {one.method: one for one in standings(values, "lower")}
    assert (found["sparse"].place, found["a"].rank) == (pytest.approx((1 + 3 * 3) / 4), 1)
    assert found["sparse"].rank > found["a"].rank
    assert np.isnan(found["sparse"].values[1])


def test_places_are_by_hand_and_a_large_scene_weighs_no_more_than_a_small_one():
    """Equal values share the middle; who has none is last."""
    found = places({"a": [[1, 2]], "b": [[1, np.nan]], "c": [[3, 1]]}, "lower")
    np.testing.assert_array_equal(found[0], [[1.5, 2], [1.5, 3], [3, 1]])
    # A mean over scenes would be that of the last: b would be first.
    values = {"a": [[1, 1.1], [1, 1.1], [200, 210]], "b": [[2, 2.1], [2, 2.1], [100, 110]]}
    assert [one.method for one in standings(values, "lower")] == ["a", "b"]


def test_ranks_never_fall_along_mean_places():
    rng = np.random.default_rng(3)
    for _ in range(30):
        values = {str(k): rng.lognormal(0.1 * k, 0.5, (3, 3)).tolist() for k in range(8)}
        found = standings(values, "lower")
        ranks, means = [one.rank for one in found], [one.place for one in found]
        assert (ranks, means) == (sorted(ranks), sorted(means))


def test_no_difference_is_rarely_taken_for_one():
    """Of sets of methods that do not differ, about one in twenty holds any that are told apart."""
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(200):
        values = {str(k): rng.lognormal(0, 0.3, (4, 5)).tolist() for k in range(5)}
        wrong += any(one.rank > 1 for one in standings(values, "lower"))
    assert wrong <= 20
