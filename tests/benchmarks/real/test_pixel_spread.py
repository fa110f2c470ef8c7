"""A spread of pixels that is put into counts comes out; edges and chance are none."""

import numpy as np
import pytest

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.perturbations import Perturbation, perturbed_trajectory
from pixel_spread import passing, rough, spread_of

SHAPE = (120, 160)


def events_of(rate, seconds=4, seed=0):
    """Events at each pixel's rate, 1/s; chance decides how many."""
    rng = np.random.default_rng(seed)
    pixel = np.repeat(np.arange(rate.size), rng.poisson(rate.ravel() * seconds))
    t_us = np.sort(rng.integers(0, round(seconds * 1e6), len(pixel)))
    y, x = np.divmod(rng.permutation(pixel), SHAPE[1])
    return Events(x.astype(np.uint16), y.astype(np.uint16), t_us, np.ones(len(x), np.uint8))


@pytest.mark.parametrize("spread", [0, 0.1, 0.3])
def test_a_spread_of_rates_is_found_whatever_rows_differ_by(spread):
    rng = np.random.default_rng(1)
    rows = np.exp(rng.normal(0, 0.5, (SHAPE[0], 1)))
    own = np.exp(spread * rng.normal(size=SHAPE))
    found = spread_of(events_of(40 * rows * own), SHAPE)
    assert found.fixed == pytest.approx(spread, rel=0.12, abs=0.03)
    assert found.warm_pixels == 0 or spread == 0.3


def test_a_pixel_that_is_warm_in_one_half_only_is_none():
    rate = np.full(SHAPE, 20.0)
    rate[[30, 80], [40, 100]] = 400
    events = events_of(rate)
    late = (events.x == 40) & (events.t_us > 2_000_000)
    found = spread_of(events.take(~late), SHAPE)
    assert found.warm_pixels == pytest.approx(1 / rate.size)
    assert found.warm_events == pytest.approx(1600 / (20 * 4 * rate.size), rel=0.1)


def test_a_picture_that_passes_comes_back_and_never_jumps():
    picture = np.random.default_rng(0).uniform(0.2, 0.8, (4, 24)).astype(np.float32)
    frames = [light for _, light in passing(picture, 1.01)]
    np.testing.assert_allclose(frames[96], frames[0], atol=1e-6)  # 48 px: there and back
    assert max(np.abs(np.diff(frames, axis=0)).max(axis=(1, 2))) < 0.25


def test_twice_the_walk_is_twice_as_rough():
    t_us = np.arange(0, 10_000_000, 10_000)
    rest = Trajectory.from_matrices(t_us, np.tile(np.eye(4), (len(t_us), 1, 1)))
    ones, twos = (
        rough(perturbed_trajectory(rest, Perturbation(pose_walk_mm=a, pose_walk_deg=a / 10), 0))
        for a in (1, 2)
    )
    np.testing.assert_allclose(twos, 2 * np.array(ones), rtol=0.01)
    assert ones[0] > 0
