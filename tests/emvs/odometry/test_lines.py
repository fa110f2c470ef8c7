"""Line fields: a straight line of points gives that line, and nothing gives none."""

from __future__ import annotations

import numpy as np
import pytest

from eventsweep.emvs.odometry.lines import DepthField, LineField
from eventsweep.emvs.odometry.lines_kernels import line_at

WIDTH, HEIGHT = 120, 90


def on_line(angle, rho=0.5, noise=0.0):
    """(N, 3) points on a line through (61.3, 44.6), half a pixel apart, and its normal."""
    along = np.array([np.cos(angle), np.sin(angle)])
    share = np.arange(-40, 40, 0.5)[:, None]
    rng = np.random.default_rng(3)
    normal = np.array([-along[1], along[0]])
    uv = [61.3, 44.6] + share * along + noise * rng.normal(size=(len(share), 1)) * normal
    inside = (uv >= 0).all(axis=1) & (uv[:, 0] <= WIDTH - 1) & (uv[:, 1] <= HEIGHT - 1)
    uv = uv[inside]
    return np.c_[uv, np.full(len(uv), rho)], normal


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, np.pi / 2, 2.0, 3.0])
def test_a_straight_line_of_points_returns_that_line(angle, level):
    points, normal = on_line(angle)
    field = LineField(WIDTH, HEIGHT, level)
    field.fill(points, len(points))
    for u, v in ((61.3, 44.6), (61.9, 45.4)):
        weight, n_u, n_v, c, rho = line_at(field.moments, field.cell_px, field.least, u, v)
        assert weight > 0.8
        assert abs(abs(np.dot([n_u, n_v], normal)) - 1) < 1e-4
        assert abs(n_u * 61.3 + n_v * 44.6 - c) < 0.02
        assert rho == pytest.approx(0.5, rel=1e-4)


def test_a_heap_of_points_is_no_line_and_far_from_all_there_is_none():
    rng = np.random.default_rng(0)
    heap = np.c_[rng.uniform(20, 100, (6000, 2)), np.ones(6000)]
    field = LineField(WIDTH, HEIGHT, 0)
    field.fill(heap, len(heap))
    assert line_at(field.moments, 1.0, field.least, 60.0, 60.0)[0] < 0.3
    assert line_at(field.moments, 1.0, field.least, 5.0, 5.0)[0] == 0


def test_a_field_forgets_what_was_in_it():
    points, _ = on_line(0.3)
    field, fresh = LineField(WIDTH, HEIGHT, 0), LineField(WIDTH, HEIGHT, 0)
    field.fill(on_line(2.0)[0], 20)
    field.fill(points, len(points))
    fresh.fill(points, len(points))
    np.testing.assert_array_equal(field.moments, fresh.moments)


def test_depth_is_that_of_the_points_around_and_their_mean_elsewhere():
    points = np.array([[20.0, 20.0, 2.0], [100.0, 70.0, 0.5]])
    field = DepthField(WIDTH, HEIGHT)
    field.fill(points, 2)
    cell = field.cell_px
    assert field.rho[int(20 / cell), int(20 / cell)] == pytest.approx(2.0, rel=0.01)
    assert field.rho[int(70 / cell), int(100 / cell)] == pytest.approx(0.5, rel=0.01)
    assert field.rho[0, -1] == pytest.approx(1.25, rel=0.01)
