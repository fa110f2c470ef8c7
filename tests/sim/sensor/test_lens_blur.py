"""Blur of the lens: light is kept, edges become the Gaussian's integral."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from eventsweep.sim.sensor.lens_blur import blurred


@pytest.mark.parametrize("sigma_px", [0.4, 0.8, 2.5])
def test_light_is_kept_and_the_twin_agrees(sigma_px):
    light = np.random.default_rng(2).random((23, 31), np.float32)
    out = blurred(light, sigma_px)
    assert out.dtype == np.float32
    assert out.sum() == pytest.approx(light.sum(), rel=1e-5)
    twin = gaussian_filter(light.astype(float), sigma_px, mode="reflect", truncate=4)
    np.testing.assert_allclose(out, twin, atol=2e-3)


def test_an_edge_becomes_the_integral_of_the_point_spread_function():
    sigma_px, x = 2.0, np.arange(40)
    edge = np.repeat((x >= 20).astype(np.float32)[None], 5, 0)
    expected = 0.5 * (1 + erf((x - 19.5) / (sigma_px * np.sqrt(2))))
    np.testing.assert_allclose(blurred(edge, sigma_px)[2], expected, atol=5e-3)


def test_no_blur_is_the_light_itself():
    light = np.random.default_rng(0).random((4, 5), np.float32)
    assert blurred(light, 0.0) is light
