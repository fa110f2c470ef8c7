"""Planes are filled exactly from any three points or more; a fold lies where its points are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.errors import InputError
from plane_filling import filled


def plane(a, b, c, shape=(20, 30)):
    """Depth of a plane: its inverse is linear in pixels."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 1 / (c + a * x + b * y)


@given(
    a=st.floats(-0.005, 0.005), b=st.floats(-0.005, 0.005), c=st.floats(0.3, 2),
    seed=st.integers(0, 999),
)  # fmt: skip
def test_a_plane_is_found_from_any_of_its_points(a, b, c, seed):
    depth_m = plane(a, b, c)
    mask = np.random.default_rng(seed).random(depth_m.shape) < 0.05
    mask[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    np.testing.assert_allclose(filled(depth_m, mask), depth_m, rtol=1e-6)


def test_what_is_known_stays_and_outside_the_nearest_point_counts():
    depth_m, mask = np.full((9, 9), np.nan), np.zeros((9, 9), np.bool_)
    for at, depth in (((2, 2), 1.0), ((2, 6), 2.0), ((6, 2), 4.0)):
        depth_m[at], mask[at] = depth, True
    found = filled(depth_m, mask)
    np.testing.assert_allclose(found[mask], depth_m[mask], rtol=1e-6)
    assert found[0, 8] == pytest.approx(2.0)
    assert found[2, 4] == pytest.approx(1 / ((1 / 1 + 1 / 2) / 2))


def test_points_that_span_no_triangle_are_refused():
    mask = np.zeros((5, 5), np.bool_)
    mask[2, :] = True
    with pytest.raises(InputError, match="span no triangle"):
        filled(np.ones((5, 5)), mask)
