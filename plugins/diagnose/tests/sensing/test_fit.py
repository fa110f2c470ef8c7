"""What was put into a sensor comes out of its events, or is refused."""

import numpy as np
import pytest

from eventsweep.emvs.data.events import Events
from eventsweep.plugins.diagnose.sensing.estimates import resampled
from eventsweep.plugins.diagnose.sensing.fit import effective_thresholds, fit_pixels
from eventsweep.plugins.diagnose.sensing.noise import hot_estimates
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from moving_texture import movie, recorded

C = {"contrast_threshold_pos": 0.2, "contrast_threshold_neg": 0.25}


@pytest.fixture(scope="module")
def moving():
    return movie()


def still(seconds, level=0.4, shape=(64, 80)):
    times_us = list(range(0, round(seconds * 1e6) + 1, 20_000))
    return times_us, [np.full(shape, level, np.float32)] * len(times_us)


def test_thresholds_mismatch_and_bandwidth_are_recovered_and_refused_without_frames(moving):
    fit = fit_pixels(*recorded(*moving, **C))
    assert fit["contrast_threshold_pos"].value == pytest.approx(0.2, rel=0.01)
    assert fit["contrast_threshold_neg"].value == pytest.approx(0.25, rel=0.01)
    for name in ("bandwidth_hz", "refractory_period_us", "shot_rate_hz"):
        assert fit[name].refused
    assert fit["threshold_sigma"].bounds
    assert fit["threshold_sigma"].value < 0.006
    pixels, _ = recorded(*moving, **C)
    fit = fit_pixels(pixels, None)
    assert "needs frames" in fit["contrast_threshold_neg"].refused
    assert "needs frames" in fit["bandwidth_hz"].refused
    assert fit.values()["sensor"].keys() <= {"hot_pixel_fraction", "shot_rate_dark_hz",
                                             "shot_rate_bright_hz"}  # fmt: skip
    sensor = {"threshold_sigma": 0.03, "bandwidth_hz": 200.0}
    fit = fit_pixels(*recorded(*moving, sensor=sensor, **C))
    truth = {"threshold_sigma": 0.03, "bandwidth_hz": 200.0, **C}
    for name, rel in zip(truth, (0.15, 0.2, 0.04, 0.04), strict=True):
        assert fit[name].value == pytest.approx(truth[name], rel=rel)
        assert abs(fit[name].value - truth[name]) < fit[name].uncertainty


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("framed", [True, False])
def test_of_an_ideal_sensor_every_interval_holds_zero(seed, framed):
    """What is not there is refused or has an upper bound; the simulator is given none of it."""
    pixels, frames = recorded(*movie(seed, seconds=1.0, speed_px_s=20.0), seed=seed, **C)
    fit = fit_pixels(pixels, frames if framed else None)
    for estimate in fit.estimates[2:]:
        assert estimate.refused or estimate.bounds or estimate.value <= estimate.uncertainty
        assert not estimate.bounds or estimate.words[0].startswith("≤ ")
    assert not any(fit.values()["sensor"].values())


def test_the_upper_bound_of_noise_is_none_below_it(moving):
    noise = {"shot_rate_dark_hz": 1.0, "shot_rate_bright_hz": 1.0}
    pixels, _ = recorded(*moving, sensor=noise, **C)
    shot = fit_pixels(pixels, None)["shot_rate_hz"]
    assert shot.bounds
    assert 1.0 < shot.value < 6.0


def test_events_lost_in_bursts_change_no_threshold():
    """Jumps within a refractory period leave one event of several, and no two close together."""
    jumping, truth = movie(jump_px=8), (0.2, 0.25)
    for lost_us, rel in ((0, 0.02), (1500, 0.05)):
        fit = fit_pixels(*recorded(*jumping, refractory_period_us=lost_us, **C))
        np.testing.assert_allclose([fit[name].value for name in C], truth, rtol=rel)
    assert fit["refractory_period_us"].value == pytest.approx(1500, rel=0.01)


def test_light_that_fades_in_the_frames_is_a_larger_threshold_and_nothing_else(moving):
    """A law of scale: half the contrast in the frames, half the thresholds."""
    pixels, frames = recorded(*moving, **C)
    grey = np.exp(0.5 * np.log(frames.light + 0.02)).astype(np.float32) - np.float32(0.02)
    fit = fit_pixels(pixels, type(frames)(frames.t_us, grey, frames.usable, True))
    assert fit["contrast_threshold_pos"].value == pytest.approx(0.1, rel=0.02)
    assert fit["contrast_threshold_neg"].value == pytest.approx(0.125, rel=0.02)


@pytest.mark.slow
def test_noise_of_a_still_scene_is_recovered():
    sensor = {
        "shot_rate_dark_hz": 1.0, "shot_rate_bright_hz": 1.0, "leak_rate_hz": 0.5,
        "noise_spread_decades": 0.25, "hot_pixel_fraction": 1e-3, "hot_pixel_rate_hz": 100.0,
    }  # fmt: skip
    pixels, frames = recorded(*still(8), every=1, sensor=sensor, refractory_period_us=1500)
    fit = fit_pixels(pixels, frames)
    assert fit["shot_rate_hz"].value == pytest.approx(1, rel=0.15)
    assert fit["leak_rate_hz"].value == pytest.approx(0.5, rel=0.25)
    assert fit["noise_spread_decades"].value == pytest.approx(0.25, rel=0.2)
    assert fit["hot_pixel_rate_hz"].value == pytest.approx(100, rel=0.15)
    assert fit["refractory_period_us"].value == pytest.approx(1500, rel=0.1)
    assert fit.noise_light == pytest.approx(0.4, abs=0.01)
    assert fit["contrast_threshold_pos"].refused


@pytest.mark.parametrize("dead_us", [0.0, 800.0])
def test_the_rate_of_hot_pixels_is_that_before_their_dead_time(dead_us):
    """Events drawn one by one: those that fall into the dead time of the last one are lost."""
    rng = np.random.default_rng(4)
    seconds, rates_hz = 20, np.full((8, 8), 2.0)
    rates_hz[2, ::2] = 300.0
    rows = []
    for (y, x), rate_hz in np.ndenumerate(rates_hz):
        last_us = -np.inf
        for t_us in np.sort(rng.uniform(0, seconds * 1e6, rng.poisson(rate_hz * seconds))):
            if t_us - last_us > dead_us:
                last_us = t_us
                rows.append((int(t_us), x, y))
    t_us, x, y = np.array(sorted(rows)).T
    events = Events(x.astype(np.uint16), y.astype(np.uint16), t_us, np.ones(len(x), np.uint8))
    pixels = PixelEvents.of(events, (8, 8), (0, seconds * 1_000_000))
    fraction, rate = hot_estimates(pixels, dead_us)
    assert fraction.value == 4 / 64
    assert abs(rate.value - 298) < rate.uncertainty < 10


def test_effective_thresholds_make_as_many_events():
    times_us, frames = movie(seconds=0.3)
    pixels, stack = recorded(times_us, frames, every=1, **C)
    effective = effective_thresholds(pixels, stack, {})
    np.testing.assert_allclose(effective, (0.2, 0.25), rtol=0.03)


def test_quiet_pixels_equal_a_slow_twin():
    rng = np.random.default_rng(3)
    shape, number = (9, 11), 400
    pixel = np.sort(rng.integers(0, 99, number))
    t_us, on = rng.integers(0, 200_001, number), rng.random(number) < 0.5
    order = np.lexsort([t_us, pixel])
    pixels = PixelEvents(shape, (0, 200_000), pixel[order], t_us[order], on[order])
    sums, _ = pixels.quiet()
    counts = np.zeros((20, *shape), int)
    dark = np.zeros_like(counts)
    for p, t, b in zip(pixel, t_us, on, strict=True):
        counts[min(t // 10_000, 19), p // 11, p % 11] += 1
        dark[min(t // 10_000, 19), p // 11, p % 11] += not b
    cells = events = 0
    for k in range(1, 19):
        for y in range(9):
            for x in range(11):
                near = counts[k - 1 : k + 2, max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3].sum()
                if near == counts[k - 1 : k + 2, y, x].sum() and not pixels.hot[y, x]:
                    cells, events = cells + 1, events + dark[k, y, x]
    assert cells > 0
    assert (sums[:, 0].sum(), sums[:, 3].sum()) == (pytest.approx(0.01 * cells), events)


def test_replicates_scatter_as_the_mean_does():
    values = np.random.default_rng(0).standard_normal((400, 1))
    ones = np.concatenate([values, np.ones_like(values)], 1)
    mean, drawn = resampled(ones, lambda s: s[:, 0] / s[:, 1])
    assert mean == pytest.approx(values.mean())
    assert drawn.std() == pytest.approx(values.std() / 20, rel=0.2)
