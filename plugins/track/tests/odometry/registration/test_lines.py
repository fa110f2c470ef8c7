"""Line fields: a straight line of points gives that line, and nothing gives none."""

import numpy as np
import pytest

from eventsweep.plugins.track.odometry.registration.lines_kernels import line_at
from eventsweep.plugins.track.odometry.registration.residuals_kernels import DRIFTS
from eventsweep.plugins.track.odometry.registration.views import DepthFields, LineFields

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


def field_of(points, levels=3):
    fields = LineFields([(WIDTH, HEIGHT)], levels)
    fields.begin()
    fields.fill(0, points, len(points), levels)
    return fields


def line(fields, level, u, v, image=0):
    sums, _, *arrays = fields.field
    return line_at(fields.places[image, level], sums, *arrays, u, v)


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize(
    "angle", [0.0, 1e-4, 0.3, np.pi / 4, np.pi / 2, np.pi / 2 + 1e-4, 2.0, 3.0]
)
def test_a_straight_line_of_points_returns_that_line(angle, level):
    points, normal = on_line(angle)
    fields = field_of(points)
    for u, v in ((61.3, 44.6), (61.9, 45.4)):
        weight, n_u, n_v, off, rho, _ = line(fields, level, u, v)
        assert weight > 0.8
        assert abs(abs(np.dot([n_u, n_v], normal)) - 1) < 1e-4
        assert abs(off - np.dot([n_u, n_v], [u - 61.3, v - 44.6])) < 0.02
        assert rho == pytest.approx(0.5, rel=1e-4)


def naive(points, level, u, v):
    """Twin: the covariance of all points within three cells, each weighted by its cell."""
    cell_px = 1 << level
    cells = np.floor(points[:, :2] / cell_px + 0.5)
    away = cells - np.floor(np.array([u, v]) / cell_px + 0.5)
    bell = np.exp(-0.5 * (np.arange(-3, 4) / 1.2) ** 2)
    bell /= bell.sum()
    near = (np.abs(away) <= 3).all(axis=1)
    weight = np.prod(bell[away[near].astype(int) + 3], axis=1)
    if not weight.sum():
        return 0.0, 0.0, np.zeros(2), 0.0, 0.0, 0.0
    mean = weight @ points[near] / weight.sum()
    spread = points[near, :2] - mean[:2]
    values, vectors = np.linalg.eigh((weight * spread.T) @ spread / weight.sum())
    straight = ((values[1] - values[0]) / 2 / (values.sum() / 2 + 0.05)) ** 2
    normal = vectors[:, 0]
    across = cells[near] * cell_px @ normal
    goes = weight @ (across * points[near, 2]) / weight.sum()
    goes = (goes - weight @ across / weight.sum() * mean[2]) / np.sqrt(values[0] + 0.1)
    return weight.sum(), straight, normal, normal @ ([u, v] - mean[:2]), mean[2], goes


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_line_is_that_of_the_points_around(level):
    rng = np.random.default_rng(level)
    points = np.r_[on_line(0.4, noise=0.6)[0], on_line(1.9, rho=2.0, noise=0.3)[0]]
    points = np.r_[points, np.c_[rng.uniform(0, 89, (300, 2)), rng.uniform(0.2, 2, 300)]]
    fields, compared = field_of(points), 0
    for u, v in rng.uniform(0, 89, (300, 2)):
        weight, n_u, n_v, off, rho, drift = line(fields, level, u, v)
        mass, straight, normal, distance, mean_rho, goes = naive(points, level, u, v)
        if mass < 0.15 * (1 << level):
            assert weight == 0
            continue
        compared += 1
        side = np.sign(normal @ [n_u, n_v])
        assert weight == pytest.approx(straight, rel=1e-3, abs=1e-4)
        assert rho == pytest.approx(mean_rho, rel=1e-4)
        if straight > 0.05:
            np.testing.assert_allclose([n_u, n_v], side * normal, atol=1e-3)
            assert off == pytest.approx(side * distance, abs=2e-3 * (1 << level))
            assert drift == pytest.approx(side * goes, rel=0.02, abs=5e-3)
    assert compared > 20


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0])
@pytest.mark.parametrize(("px", "drifts"), [(0.0, False), (0.3, False), (3.0, True), (5.0, True)])
def test_a_line_that_goes_across_itself_while_it_is_seen_drifts(angle, px, drifts):
    """By so many pixels in all; along itself it may go as far as it likes."""
    rng = np.random.default_rng(5)
    points, normal = on_line(angle, noise=0.2)
    points = np.repeat(points, 6, axis=0)
    points[:, 2] = rng.uniform(-0.5, 0.5, len(points)) * np.sqrt(12)
    share = points[:, 2:] / np.sqrt(12)
    along = np.array([normal[1], -normal[0]])
    points[:, :2] += share * px * normal + share * 8 * along
    found = line(field_of(points, 1), 0, 61.3, 44.6)
    assert (abs(found[5]) > DRIFTS) == drifts


def test_a_field_forgets_what_was_in_it_and_images_are_apart():
    points, _ = on_line(0.3)
    fields, fresh = LineFields([(WIDTH, HEIGHT), (50, 40)], 2), field_of(points)
    fields.begin()
    for image in (0, 1):
        fields.fill(image, on_line(2.0)[0], 20, 2)
    fields.begin()
    fields.fill(0, points, len(points), 2)
    places = points[::7, :2] + 0.4
    for level in (0, 1):
        assert [line(fields, level, *uv) for uv in places] == [
            line(fresh, level, *uv) for uv in places
        ]
        assert {line(fields, level, *uv, image=1)[0] for uv in places} == {0}


def test_depth_is_that_of_the_points_around_and_their_mean_elsewhere():
    points = np.array([[20.0, 20.0, 2.0], [100.0, 70.0, 0.5]])
    fields = DepthFields([(50, 40), (WIDTH, HEIGHT)])
    fields.fill(1, points, 2)
    rho, cell = fields.image(1), fields.places[1, 3]
    assert rho[int(20 / cell), int(20 / cell)] == pytest.approx(2.0, rel=0.01)
    assert rho[int(70 / cell), int(100 / cell)] == pytest.approx(0.5, rel=0.01)
    assert rho[0, -1] == pytest.approx(1.25, rel=0.01)
    np.testing.assert_array_equal(fields.image(0), 1)
