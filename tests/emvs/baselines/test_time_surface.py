from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive_baselines
from eventsweep.emvs.baselines.pixels_kernels import NEVER_US
from eventsweep.emvs.baselines.time_surface import TimeSurface
from eventsweep.emvs.data.events import Events
from made_events import random_events
from refusals import refused

WIDTH, HEIGHT = 7, 5


def some_events(seed, n, span_us=100_000):
    return random_events(np.random.default_rng(seed), n, WIDTH, HEIGHT, 0, span_us)


@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(0, 60), decay_s=st.floats(1e-4, 1.0),
)  # fmt: skip
def test_it_equals_its_twin_however_it_is_fed(seed, n, decay_s):
    events = some_events(seed, n)
    surface = TimeSurface(WIDTH, HEIGHT, decay_s)
    for start, stop in pairwise((0, n // 3, n // 2, n)):
        surface.update(events.slice(start, stop))
    expected = naive_baselines.time_surface(WIDTH, HEIGHT, events, 100_000, decay_s)
    whole = TimeSurface(WIDTH, HEIGHT, decay_s)
    whole.update(events)
    np.testing.assert_allclose(whole.at(100_000, smooth=False), expected, rtol=1e-5, atol=1e-30)
    np.testing.assert_array_equal(surface.last_us, whole.last_us)


@given(seed=st.integers(0, 2**32 - 1), later_us=st.integers(0, 1_000_000))
def test_it_is_between_0_and_1_and_decays_alike_everywhere(seed, later_us):
    surface = TimeSurface(WIDTH, HEIGHT, median_px=1)
    surface.update(some_events(seed, 30))
    now, later = surface.at(100_000), surface.at(100_000 + later_us)
    assert now.min() >= 0
    assert now.max() <= 1
    np.testing.assert_allclose(later, now * np.exp(-later_us / 30_000), rtol=1e-4, atol=1e-7)


def test_an_event_right_now_is_1_and_a_pixel_that_never_fired_is_0():
    surface = TimeSurface(WIDTH, HEIGHT, median_px=1)
    surface.update(some_events(0, 1).slice(0, 1))
    image = surface.at(surface.newest_us)
    assert image.max() == 1
    assert (image > 0).sum() == 1
    assert (surface.last_us == NEVER_US).sum() == WIDTH * HEIGHT - 1
    assert surface.active(surface.newest_us + 1000, 0.001).sum() == 1
    assert surface.active(surface.newest_us + 1001, 0.001).sum() == 0


def test_the_median_removes_single_events_and_the_gaussian_keeps_the_mean():
    lone = Events(*(np.array([3], kind) for kind in (np.uint16, np.uint16, np.int64, np.uint8)))
    sharp = TimeSurface(WIDTH, HEIGHT, median_px=3)
    sharp.update(lone)
    assert sharp.at(3).max() == 0
    assert sharp.at(3, smooth=False).max() == 1
    soft = TimeSurface(31, 31, median_px=1, blur_sigma_px=1.0)
    middle = Events(lone.x + np.uint16(12), lone.y + np.uint16(12), lone.t_us, lone.p)
    soft.update(middle)
    assert soft.at(3).sum() == pytest.approx(1, rel=1e-3)
    assert soft.at(3).max() < 0.2


def test_time_does_not_run_backwards():
    surface = TimeSurface(WIDTH, HEIGHT)
    events = some_events(1, 20)
    surface.update(events)
    refused("feed events in time order", surface.update, events.slice(0, 3))
    refused("request it before feeding", surface.at, int(events.t_us[-1]) - 1)


def test_events_outside_are_refused():
    refused("outside the 4x4 sensor", lambda: TimeSurface(4, 4).update(some_events(1, 50)))
