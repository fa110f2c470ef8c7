"""Bootstrap, paired tests and ranks: against slow twins, by hand, and by law."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import naive_scoring
from eventsweep.eval.scoring.significance import (
    holm,
    interval,
    intervals,
    resampling_weights,
    stratified_interval,
    stratified_p,
)
from refusals import line_of

numbers = st.floats(-10, 10)
whole = st.integers(-50, 50)
group_lists = st.lists(st.lists(numbers, min_size=1, max_size=5), min_size=1, max_size=4)


@given(group_lists)
def test_bootstrap_is_the_mean_of_what_was_drawn(groups):
    sizes = [len(group) for group in groups]
    drawn = resampling_weights(sizes, 20, seed=3)
    np.testing.assert_allclose(drawn.sum(axis=1), 1)
    expected = naive_scoring.bootstrap_means(groups, 20, 3)
    np.testing.assert_allclose(drawn @ np.concatenate(groups), expected, atol=1e-12)


several_seeds = group_lists.filter(lambda groups: len(groups) > 1)


@given(several_seeds)
def test_interval_is_the_resampled_one_as_wide_as_seeds_differ(groups):
    expected = naive_scoring.interval(groups, 50, 3, 0.9)
    found = interval(groups, level=0.9, resamples=50, seed=3)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@given(several_seeds, numbers, st.floats(0.1, 10))
def test_interval_holds_the_mean_and_moves_and_grows_with_the_values(groups, shift, factor):
    low, high = interval(groups, resamples=50)
    mean = np.mean([np.mean(group) for group in groups])
    assert low - 1e-9 <= mean <= high + 1e-9
    changed = [factor * np.array(group) + shift for group in groups]
    expected = factor * low + shift, factor * high + shift
    np.testing.assert_allclose(interval(changed, resamples=50), expected, atol=1e-7)


@pytest.mark.slow
def test_interval_covers_the_truth_about_as_often_as_it_says():
    """Seeds differ (sd 1) more than windows (sd 0.5): an interval over windows alone fails."""
    rng = np.random.default_rng(0)
    both = alone = 0
    for _ in range(200):
        groups = [rng.normal(rng.normal(0, 1), 0.5, 8) for _ in range(12)]
        low, high = interval(groups, resamples=200)
        both += low <= 0 <= high
        low, high = interval(list(np.concatenate(groups)[:, None].T), resamples=200)
        alone += low <= 0 <= high
    assert 182 <= both <= 198
    assert alone < 140


def test_same_seed_same_interval_and_one_value_has_none():
    values = [np.arange(5.0), np.arange(3.0)]
    assert interval(values) == interval(values)
    assert interval(values) != interval(values, seed=1)
    assert np.isnan(interval([[1.0]])).all()
    assert np.isnan(interval([[1.0], [np.nan]])).all()
    low, high = intervals(np.array([[1.0, np.nan], [1.0, 2.0]]), [1, 1])
    assert low[0] == high[0] == 1
    assert np.isnan(low[1])


@pytest.mark.parametrize("windows", [1, 2, 40])
def test_one_seed_has_no_interval_however_many_its_windows(windows):
    assert np.isnan(interval([np.arange(float(windows))])).all()
    assert np.isnan(stratified_interval([np.array([1.0, 2.0]), np.array([3.0])])).all()
    assert np.isnan(stratified_interval([])).all()


@given(st.lists(st.lists(numbers, min_size=2, max_size=5), min_size=1, max_size=4))
def test_a_band_over_strata_follows_welch(groups):
    expected = naive_scoring.welch_interval(groups, 0.95)
    np.testing.assert_allclose(stratified_interval(groups), expected, rtol=1e-6, atol=1e-9)


def test_one_stratum_is_students_t_and_the_paired_t_test():
    values = [3.0, 5.0, 4.0, 8.0]
    expected = stats.t.interval(0.95, 3, np.mean(values), stats.sem(values))
    np.testing.assert_allclose(stratified_interval([values]), expected)
    first, other = [3.0, 5.0, 4.0, 8.0], [2.0, 5.5, 3.0, 6.0]
    differences = np.subtract(other, first)
    assert stratified_p([differences]) == pytest.approx(stats.ttest_rel(other, first).pvalue)
    assert stratified_p([np.zeros(3)]) == 1
    assert stratified_p([np.full(3, 0.5)]) == 0
    assert np.isnan(stratified_p([np.array([0.5])]))
    assert np.isnan(stratified_p([np.array([0.5, np.nan])]))


@given(st.lists(st.lists(numbers, min_size=2, max_size=5), min_size=1, max_size=4))
def test_p_is_where_the_interval_ends_at_zero(groups):
    p = stratified_p(groups)
    if not 1e-6 < p < 1 - 1e-6:
        return
    low, high = stratified_interval(groups, level=1 - p)
    assert min(abs(low), abs(high)) <= 1e-6 * max(abs(low), abs(high))


@pytest.mark.parametrize(("sizes", "options", "message"), [
    ([3], {}, "3"), ([2, 0], {}, "one or more"), ([2], {"level": 1.0}, "level"),
    ([2], {"resamples": 0}, "resamples"), ([1, 1], {"resamples": 19}, "20 or more"),
])  # fmt: skip
def test_impossible_bootstraps_are_refused(sizes, options, message):
    assert message in line_of(intervals, np.ones((2, 1)), sizes, **options)


@given(st.lists(st.floats(0, 1), max_size=8))
def test_holm_is_step_down_and_never_makes_surer(p):
    got = holm(p)
    np.testing.assert_allclose(got, naive_scoring.holm(p))
    assert all(raw <= corrected <= 1 for raw, corrected in zip(p, got, strict=True))
    order = np.argsort(p, kind="stable")
    assert (np.diff(np.array(got)[order]) >= 0).all()


def test_holm_by_hand():
    # 3 x 0.01, 2 x 0.03, and 0.04 raised to the one before.
    assert holm([0.03, 0.01, 0.04]) == pytest.approx([0.06, 0.03, 0.06])
    assert holm([0.01, float("nan")])[0] == pytest.approx(0.01)
