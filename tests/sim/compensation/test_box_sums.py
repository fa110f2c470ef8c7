"""Sums over a box equal those of a plain mean, wherever it lies and however many samples it has."""

import numpy as np
import pytest

from eventsweep.sim.compensation.box_sums_kernels import box_sums
from eventsweep.sim.compensation.edge_reach_kernels import Seen

LEAST, MOST = np.float32(0.3), np.float32(0.8)


def expected(frame, n, u, v):
    j, i = int(u), int(v)
    across, down = np.ones((2, n + 1))
    across[0], across[n], down[0], down[n] = 1 - (u - j), u - j, 1 - (v - i), v - i
    weight, box = np.outer(down, across), np.s_[i : i + n + 1, j : j + n + 1]
    rho, light = frame.rho[box].astype(float), frame.light[box]
    on, beyond = weight * ((rho > LEAST) & (rho <= MOST)), weight * (rho <= LEAST)
    return np.array([on.sum(), beyond.sum(), (on * light).sum(), (on * rho).sum()]) / n**2


@pytest.mark.parametrize("n", [1, 6, 8, 15, 16])
def test_sums_are_those_of_a_plain_mean_up_to_the_last_sample(n):
    rng = np.random.default_rng(n)
    light, rho = rng.random((2, n * 7, n * 7)).astype(np.float32)
    pixels = np.zeros((7, 7), np.float32)
    frame = Seen(light, rho, light, pixels, pixels, pixels.astype(np.uint16))
    places = [*(6 * n * rng.random((50, 2))), (6 * n - 1e-3, 6 * n - 1e-3), (0.0, 0.0)]
    for u, v in places:
        found = box_sums(frame, n, u, v, float(MOST), float(LEAST))
        np.testing.assert_allclose(found, expected(frame, n, u, v), atol=1e-6)
