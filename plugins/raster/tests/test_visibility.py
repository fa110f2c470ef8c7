"""Which columns of a row lie inside a triangle, whatever its edges."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.plugins.raster import visibility_kernels as kernels


@given(
    st.lists(st.tuples(*[st.floats(-1e300, 1e300)] * 3), min_size=1, max_size=6),
    st.integers(0, 2000), st.floats(-0.5, 0.5), st.integers(0, 30), st.integers(0, 30),
)  # fmt: skip
def test_a_row_of_a_triangle_stays_in_the_picture_however_far_its_edges_reach(
    planes, y, x0, low, wide
):
    crossing, edges = np.empty((6, 3)), np.zeros((6, 3))
    edges[: len(planes)] = planes
    kernels._crossings(edges, len(planes), crossing)
    first, last = kernels._span(crossing, len(planes), y, x0, float(low), float(low + wide))
    assert first > last or (low <= first and last <= low + wide)


def test_edges_that_are_almost_level_or_far_away_cut_a_row_where_they_should():
    edges = np.array([[1e-20, 1.0, 200.0], [1.0, 0.0, -3.5], [-1e-20, 1e-3, 1.0]])
    crossing = np.empty((6, 3))
    kernels._crossings(edges, 3, crossing)
    assert kernels._span(crossing, 3, 100, 0.0, 0.0, 9.0) == (4, 9)
    edges[0] = 1e-20, -1.0, -200.0  # the row lies outside, by 300 / 1e-20 columns
    kernels._crossings(edges, 3, crossing)
    first, last = kernels._span(crossing, 3, 100, 0.0, 0.0, 9.0)
    assert first > last
