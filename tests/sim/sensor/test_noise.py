"""Shot noise, hot pixels and the refractory period."""

import numpy as np
import pytest

from eventsweep.sim.sensor.labels import Label
from sensor_runs import (
    config,
    constant,
    counts_per_pixel,
    gaps_of,
    irregular_times_us,
    moving_bars,
    rows_of,
    run,
)
from tiers import often

SHAPE = (10, 12)


@pytest.mark.parametrize(
    ("level", "rate_hz"),
    often([(0.0, 80.0), (0.4, 56.0)], [(0.0, 80.0), (0.4, 56.0), (1.0, 20.0), (5.0, 20.0)]),
)
def test_shot_noise_has_the_rate_of_its_intensity(level, rate_hz):
    times_us = irregular_times_us(6_000_000)
    settings = config(shot_rate_dark_hz=80.0, shot_rate_bright_hz=20.0)
    labelled, _ = run(constant(level, SHAPE, times_us), times_us, settings)
    per_pixel = counts_per_pixel(labelled.events, SHAPE)
    expected = 6 * rate_hz
    assert per_pixel.mean() == pytest.approx(expected, rel=0.03)
    # Poisson: the variance over the pixels is the mean.
    assert per_pixel.var() == pytest.approx(expected, rel=0.5)
    assert set(labelled.label.tolist()) == {Label.SHOT}
    assert labelled.events.p.mean() == pytest.approx(0.5, abs=0.02)
    gaps_us = gaps_of(labelled.events, SHAPE)
    assert gaps_us.std() == pytest.approx(gaps_us.mean(), rel=0.03)


def test_shot_noise_per_pixel_within_five_percent():
    """Long enough for one pixel's own statistics: 2 % are one standard error."""
    times_us = list(range(0, 100_000_001, 100_000))
    settings = config(shot_rate_dark_hz=100.0, shot_rate_bright_hz=100.0)
    labelled, _ = run(constant(0.2, (4, 4), times_us), times_us, settings)
    np.testing.assert_allclose(counts_per_pixel(labelled.events, (4, 4)), 10_000, rtol=0.05)


def test_shot_noise_follows_the_intensity_within_a_step():
    dark, bright = np.zeros(SHAPE, np.float32), np.ones(SHAPE, np.float32)
    settings = config(shot_rate_dark_hz=1000.0, c_pos=9, c_neg=9)
    labelled, _ = run([dark, bright], [0, 1_000_000], settings)
    # The rate falls linearly to zero: the mean time is a third of the step.
    assert len(labelled) == pytest.approx(500 * 120, rel=0.02)
    assert labelled.events.t_us.mean() == pytest.approx(1e6 / 3, rel=0.02)


def paired(light_hz, pair_hz, times_us, shape=SHAPE):
    settings = config(
        shot_rate_dark_hz=light_hz, shot_rate_bright_hz=light_hz, shot_pair_rate_hz=pair_hz
    )
    return run(constant(0.5, shape, times_us), times_us, settings)


@pytest.mark.parametrize("times_us", [irregular_times_us(8_000_000), [0, 7, 8_000_000]])
def test_noise_that_resets_pixels_comes_in_pairs_of_opposite_events(times_us):
    """Pairs (rate 1 Hz) are far apart: their delay is exponential, their order even."""
    shape = (40, 50)
    labelled, sensor = paired(2.0, 400.0, times_us, shape)
    events = labelled.events
    assert len(events) / 2000 / 8 == pytest.approx(2, rel=0.03)
    assert abs(int((events.p == 1).sum()) - int((events.p == 0).sum())) <= 5
    pixel = events.y.astype(int) * shape[1] + events.x
    order = np.lexsort([events.t_us, pixel])
    same = np.diff(pixel[order]) == 0
    gaps_us = np.diff(events.t_us[order])[same]
    alike = (events.p[order][1:] == events.p[order][:-1])[same]
    # Within a pair events differ; from pair to pair they are alike as often as not.
    between_pairs = len(gaps_us) - len(events) / 2
    assert alike.sum() / between_pairs == pytest.approx(0.5, abs=0.02)
    short_us = gaps_us[gaps_us < 10_000]
    assert short_us[short_us < 2500].size / short_us.size == pytest.approx(
        (1 - np.exp(-1)) / (1 - np.exp(-4)), abs=0.02
    )
    assert sum(sensor.counts.values()) == len(events) + sensor.counts["dropped_after_end"]


def test_pairs_leave_the_scenes_events_where_they_are():
    frames, times_us = moving_bars(60), [1000 * k for k in range(60)]
    alone, _ = run(frames, times_us, config())
    noisy, _ = run(
        frames, times_us,
        config(shot_rate_dark_hz=300.0, shot_rate_bright_hz=300.0, shot_pair_rate_hz=200.0),
    )  # fmt: skip
    assert (noisy.label == Label.SHOT).sum() > 1000
    assert [r for r in rows_of(noisy) if r[4] == Label.SIGNAL] == rows_of(alone)


@pytest.mark.parametrize("cause", ["shot", "leak"])
def test_noise_rates_are_log_normal_over_the_pixels(cause):
    """80 s at 50 Hz: Poisson counts add 0.007 decades of their own."""
    shape, times_us = (30, 40), list(range(0, 80_000_001, 10_000_000))
    rates = {
        "shot": {"shot_rate_dark_hz": 50.0, "shot_rate_bright_hz": 50.0},
        "leak": {"leak_rate_hz": 50.0},
    }
    settings = config(noise_spread_decades=0.15, **rates[cause])
    labelled, _ = run(constant(0.5, shape, times_us), times_us, settings)
    decades = np.log10(counts_per_pixel(labelled.events, shape) / 80)
    # The median of 1200 drawn factors scatters by 1.2 %.
    assert 10 ** np.median(decades) == pytest.approx(50, rel=0.05)
    assert decades.std() == pytest.approx(0.15, rel=0.05)
    assert abs(((decades - decades.mean()) ** 3).mean()) < 0.3 * 0.15**3


def test_a_pixels_leak_and_shot_noise_are_strong_together():
    times_us = list(range(0, 20_000_001, 1_000_000))
    settings = config(
        noise_spread_decades=0.3, leak_rate_hz=20.0, shot_rate_dark_hz=40.0,
        shot_rate_bright_hz=40.0,
    )  # fmt: skip
    labelled, _ = run(constant(0.5, SHAPE, times_us), times_us, settings)
    counts = [
        counts_per_pixel(labelled.events.take(labelled.label == label), SHAPE)
        for label in (Label.LEAK, Label.SHOT)
    ]
    assert np.corrcoef(np.log(counts))[0, 1] > 0.97


def test_hot_pixels_are_as_many_and_as_hot_as_asked():
    shape, times_us = (40, 50), irregular_times_us(5_000_000)
    settings = config(hot_pixel_fraction=0.01, hot_pixel_rate_hz=400.0)
    labelled, _ = run(constant(0.5, shape, times_us), times_us, settings)
    per_pixel = counts_per_pixel(labelled.events, shape)
    assert (per_pixel > 0).sum() == 20
    np.testing.assert_allclose(per_pixel[per_pixel > 0], 2000, rtol=0.12)
    assert per_pixel.sum() == pytest.approx(40_000, rel=0.02)
    assert set(labelled.label.tolist()) == {Label.HOT}


def test_silence_after_every_event_whatever_its_cause():
    times_us = irregular_times_us(2_000_000)
    settings = config(
        3000, leak_rate_hz=50.0, shot_rate_dark_hz=200.0, shot_rate_bright_hz=200.0,
        hot_pixel_fraction=0.1, hot_pixel_rate_hz=1000.0,
    )  # fmt: skip
    labelled, sensor = run(constant(0.5, SHAPE, times_us), times_us, settings)
    assert gaps_of(labelled.events, SHAPE).min() >= 3000
    assert sensor.counts["dropped_refractory"] > 1000


def test_a_dead_time_lowers_a_poisson_rate_as_it_should():
    """A non-paralysable counter: rate / (1 + rate x dead time)."""
    times_us = irregular_times_us(10_000_000)
    settings = config(2000, shot_rate_dark_hz=300.0, shot_rate_bright_hz=300.0)
    labelled, _ = run(constant(0.5, SHAPE, times_us), times_us, settings)
    assert len(labelled) / 120 / 10 == pytest.approx(300 / 1.6, rel=0.01)
