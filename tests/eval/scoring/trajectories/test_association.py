"""Which pose belongs to which: every rule against a slow twin, at the borders, and by law."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import naive_trajectories as naive
from eventsweep.eval.scoring.trajectories.association import (
    associate,
    covered,
    nearest,
    one_to_one,
)
from made_trajectories import made, on_clock, part, room

# Few values, so that times meet and differences tie.
times = st.lists(st.integers(0, 60), min_size=1, max_size=25, unique=True).map(sorted)
wide_times = st.lists(st.integers(-(10**6), 10**6), min_size=1, max_size=40, unique=True).map(
    sorted
)


def as_pairs(found):
    return list(zip(*(index.tolist() for index in found), strict=True))


@pytest.mark.parametrize("rule", [one_to_one, nearest])
@pytest.mark.parametrize("drawn", [times, wide_times], ids=["dense", "wide"])
def test_each_rule_equals_its_slow_twin(rule, drawn):
    @given(drawn, drawn, st.one_of(st.integers(0, 8), st.integers(0, 10**6)))
    def check(truth, estimate, most):
        truth_us, estimate_us = np.array(truth), np.array(estimate)
        expected = getattr(naive, rule.__name__)(truth_us, estimate_us, most)
        assert as_pairs(rule(truth_us, estimate_us, most)) == expected

    check()


@given(times, times, st.integers(0, 8))
def test_one_to_one_uses_no_pose_twice_and_leaves_no_two_that_would_fit(truth, estimate, most):
    pairs = as_pairs(one_to_one(np.array(truth), np.array(estimate), most))
    of_truth, of_estimate = {i for i, _ in pairs}, {j for _, j in pairs}
    assert len(of_truth) == len(of_estimate) == len(pairs)
    left = [
        (i, j)
        for i, g in enumerate(truth) if i not in of_truth
        for j, e in enumerate(estimate) if j not in of_estimate and abs(g - e) <= most
    ]  # fmt: skip
    assert left == []


def test_a_long_chain_of_ever_closer_neighbours_is_taken_from_its_end():
    """Each pair that is taken decides on the next one."""
    steps = np.arange(20_000, 0, -1)
    times_us = np.concatenate([[0], np.cumsum(steps)])
    truth_us, estimate_us = times_us[::2], times_us[1::2]
    of_truth, of_estimate = one_to_one(truth_us, estimate_us, 20_000)
    np.testing.assert_array_equal(of_truth, of_estimate + 1)


def test_the_nearest_of_the_shorter_trajectory_and_the_earlier_of_equals():
    assert as_pairs(one_to_one(np.array([5]), np.array([0, 10]), 5)) == [(0, 0)]
    assert as_pairs(one_to_one(np.array([0, 10]), np.array([5]), 5)) == [(0, 0)]
    assert as_pairs(nearest(np.array([0, 10]), np.array([5]), 5)) == [(0, 0)]
    # Two true poses share one estimate, or two estimates one true pose: never a longer one.
    few, many = np.array([0, 1000]), np.array([0, 10, 20, 30, 1000])
    assert as_pairs(nearest(many, few, 100)) == [(0, 0), (4, 1)]
    assert as_pairs(nearest(few, many, 100)) == [(0, 0), (1, 4)]
    assert as_pairs(nearest(np.array([0, 9, 500]), np.array([4, 5]), 100)) == [(0, 0), (1, 1)]


@pytest.mark.parametrize("rule", [one_to_one, nearest])
def test_the_largest_difference_is_included(rule):
    truth_us, estimate_us = np.array([0, 100]), np.array([20, 121])
    assert as_pairs(rule(truth_us, estimate_us, 20)) == [(0, 0)]
    assert as_pairs(rule(truth_us, estimate_us, 19)) == []


@pytest.mark.parametrize("rule", ["one-to-one", "nearest", "interpolate"])
def test_an_offset_is_added_to_the_estimate(rule):
    truth = room(2.0)
    late = on_clock(truth, shift_us=-123_456)
    matched = associate(truth, late, rule, 0, offset_us=123_456)
    assert len(matched) == len(truth)
    assert not matched.late_us.any()
    np.testing.assert_allclose(matched.T_odom_body, matched.T_world_body, atol=1e-12)


def test_interpolation_takes_the_truth_at_every_estimate_but_never_across_a_gap():
    truth = room(2.0, rate_hz=20)
    estimate = room(2.0, rate_hz=500)
    matched = associate(truth, estimate, "interpolate", 0)
    assert len(matched) == len(estimate)
    np.testing.assert_allclose(matched.T_world_body, truth.at(matched.t_us), atol=1e-12)
    whole = room(3.0)
    truth = part(whole, np.r_[10:100, 180:290])
    known = covered(truth, whole.t_us)
    expected = np.zeros(len(whole), bool)
    expected[10:100] = expected[180:290] = True
    np.testing.assert_array_equal(known, expected)
    # A single pose covers its own instant.
    alone = made([1.0], [[0, 0, 0]], Rotation.identity(1))
    np.testing.assert_array_equal(covered(alone, np.array([999_999, 1_000_000])), [False, True])
