"""Events are compared one to one: none counts twice."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from one_to_one import agreement
from ray_events import crossings

EVENT = st.tuples(st.integers(0, 1), st.integers(0, 1), st.integers(0, 40), st.integers(0, 1))


def stream(rows):
    x, y, t_us, p = np.array(rows, int).reshape(-1, 4).T
    return SimpleNamespace(x=x, y=y, t_us=t_us, p=p)


SOME = [(3, 1, 100, 1), (3, 1, 5000, 0), (4, 1, 5000, 0)]


def test_a_stream_agrees_with_itself():
    same = agreement(stream(SOME), stream(SOME))
    assert (same.recall, same.precision, same.count_error, same.median_us) == (1, 1, 0, 0)


def test_a_duplicate_costs_precision_and_a_missing_one_recall():
    more = agreement(stream([*SOME, SOME[0]]), stream(SOME))
    fewer = agreement(stream(SOME[1:]), stream(SOME))
    assert (more.recall, more.precision) == (1, pytest.approx(3 / 4))
    assert (fewer.recall, fewer.precision) == (pytest.approx(2 / 3), 1)


@pytest.mark.parametrize("other", [(4, 1, 100, 1), (3, 2, 100, 1), (3, 1, 100, 0), (3, 1, 1101, 1)])
def test_another_pixel_polarity_or_time_is_no_partner(other):
    assert agreement(stream([other]), stream(SOME[:1])).matched == 0


@given(st.lists(EVENT, max_size=9), st.lists(EVENT, max_size=9), st.integers(0, 15))
def test_no_other_pairs_are_more(found, true, tolerance_us):
    can = [[f[:2] == t[:2] and f[3] == t[3] and abs(f[2] - t[2]) <= tolerance_us for f in found]
           for t in true]  # fmt: skip
    graph = csr_matrix(np.array(can, bool).reshape(len(true), len(found)))
    best = (maximum_bipartite_matching(graph) >= 0).sum() if found and true else 0
    assert agreement(stream(found), stream(true), tolerance_us).matched == best


def test_the_truths_comparator_passes_each_level_once():
    reference = np.zeros(3)
    first = crossings(np.zeros(3), np.array([0.5, -0.2, 0.1]), reference, 0.2, (0.0, 1.0))
    np.testing.assert_array_equal(first[0], [0, 0, 1])
    np.testing.assert_allclose(first[1], [0.4, 0.8, 1.0])
    np.testing.assert_array_equal(first[2], [1, 1, 0])
    np.testing.assert_allclose(reference, [0.4, -0.2, 0.0])
