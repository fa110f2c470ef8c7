"""Mismatch, unequal thresholds, bandwidth and leak: laws, statistics and plain twins."""

import numpy as np
import pytest

import naive_esim
import naive_sensor
from eventsweep.sim.sensor import pixels_kernels as kernels
from eventsweep.sim.sensor.labels import Label
from eventsweep.sim.sensor.pixels import Pixels, Randomness
from eventsweep.sim.sensor.pixels_kernels import low_pass
from eventsweep.sim.sensor_presets import SensorParameters
from sensor_runs import config, constant, counts_per_pixel, gaps_of, irregular_times_us, run
from tiers import often

EPS = 1e-6


def ramp(log_start, log_end, times_us, shape):
    share = (np.asarray(times_us) - times_us[0]) / (times_us[-1] - times_us[0])
    levels = np.exp(log_start + (log_end - log_start) * share) - EPS
    return [np.full(shape, level, np.float32) for level in levels]


@pytest.mark.parametrize("sign", [1, -1])
def test_mismatch_is_recovered_from_event_counts_on_ramps(sign):
    shape, times_us = (60, 60), [0, 5000, 10_000]
    frames = ramp(-6 * sign, 6 * sign, times_us, shape)
    labelled, _ = run(
        frames, times_us, config(c_pos=0.2, c_neg=0.3, log_eps=EPS, threshold_sigma=0.02)
    )
    # A ramp of 12 gives floor(12 / C) events: half an event more is the mean.
    thresholds = 12 / (counts_per_pixel(labelled.events, shape) + 0.5)
    assert thresholds.mean() == pytest.approx(0.2 if sign > 0 else 0.3, rel=0.01)
    assert thresholds.std() == pytest.approx(0.02, rel=0.05)


def test_mismatch_is_fixed_and_independent_of_polarity():
    shape, times_us = (40, 40), [0, 10_000, 20_000, 30_000, 40_000]
    up = ramp(-6, 6, times_us[:2], shape)
    frames = [up[0], up[1], up[0], up[1], up[0]]
    labelled, _ = run(frames, times_us, config(log_eps=EPS, threshold_sigma=0.02))
    e = labelled.events
    per_ramp = [counts_per_pixel(e.between(t + 1, t + 10_001), shape) for t in times_us[:-1]]
    assert np.abs(per_ramp[0] - per_ramp[2]).max() <= 2
    assert np.abs(per_ramp[1] - per_ramp[3]).max() <= 2
    assert abs(np.corrcoef(per_ramp[0], per_ramp[1])[0, 1]) < 0.1


def test_unequal_thresholds_give_their_ratio_of_events():
    times_us, shape = [0, 10_000, 20_000], (8, 8)
    up = ramp(-6, 6, times_us[:2], shape)
    labelled, _ = run([up[0], up[1], up[0]], times_us, config(c_pos=0.1, c_neg=0.25, log_eps=EPS))
    p = labelled.events.p
    assert (p == 1).sum() / (p == 0).sum() == pytest.approx(2.5, rel=0.03)


def filtered(log, times_us, **parameters):
    """Output of the photoreceptor of one pixel at the frames."""
    pixels = Pixels((1, 1), (0.2, 0.2), EPS, SensorParameters(**parameters), Randomness(0, 0))
    frames = (np.exp(np.asarray(log)) - EPS).astype(np.float32).reshape(-1, 1, 1)
    pixels.start(frames[0])
    out = [float(pixels.state()["light"][0])]
    for k in range(1, len(frames)):
        pixels.step(frames[k], times_us[k - 1], times_us[k])
        out.append(float(pixels.state()["light"][0]))
    return np.array(out), frames.ravel()


@pytest.mark.parametrize("order", [1, 2])
def test_low_pass_equals_many_small_steps(order):
    rng = np.random.default_rng(order)
    log, times_us = rng.uniform(-3, 0.5, 8), np.cumsum(rng.integers(20, 10_000, 8)).tolist()
    out, light = filtered(log, times_us, bandwidth_hz=80.0, bandwidth_order=order)
    times_s = [t * 1e-6 for t in times_us]
    twin = naive_sensor.low_pass(
        np.log(light + EPS), light, times_s, 80.0, SensorParameters().dark_level, order
    )
    np.testing.assert_allclose(out, twin, atol=2e-3)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("level", [0.02, 0.3, 2.0])
def test_step_response_has_the_analytic_time_course(order, level):
    cutoff_hz, dark = 100.0, SensorParameters().dark_level
    tau_us = 1e6 * (1 + dark) / (2 * np.pi * cutoff_hz * (level + dark))
    times_us = [0, *(np.rint(1 + tau_us * np.linspace(0, 5, 60))).astype(int).tolist()]
    # A step too small to change the cut-off.
    log = np.log(level) + 0.01 * (np.arange(len(times_us)) > 0)
    out, _ = filtered(log, times_us, bandwidth_hz=cutoff_hz, bandwidth_order=order)
    share = (out - np.log(level)) / 0.01
    t = (np.array(times_us) - 0.5) / tau_us
    analytic = 1 - np.exp(-t) * (1 if order == 1 else 1 + t)
    np.testing.assert_allclose(share[1:], analytic[1:], atol=0.02)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("frequency_hz", [30.0, 100.0, 300.0])
def test_sines_are_attenuated_as_the_transfer_function_says(order, frequency_hz):
    times_us = np.arange(0, 100_000, 100).tolist()
    t_s = np.array(times_us) * 1e-6
    log = np.log(0.5) + 0.02 * np.sin(2 * np.pi * frequency_hz * t_s)
    out, _ = filtered(log, times_us, bandwidth_hz=100.0, bandwidth_order=order)
    dark = SensorParameters().dark_level
    ratio = frequency_hz * (1 + dark) / (100.0 * (0.5 + dark))
    settled = t_s > 0.05
    waves = np.stack([f(2 * np.pi * frequency_hz * t_s) for f in (np.sin, np.cos, np.ones_like)])
    fit = np.linalg.lstsq(waves[:, settled].T, out[settled], rcond=None)[0]
    amplitude = np.hypot(fit[0], fit[1]) / 0.02
    assert amplitude == pytest.approx((1 + ratio**2) ** (-order / 2), rel=0.02)


@pytest.mark.parametrize("order", [1, 2])
def test_low_pass_of_a_ramp_does_not_depend_on_the_frames(order):
    """Constant intensity for the cut-off, so that only the interpolation is at stake."""
    log = np.linspace(-1, 0, 101).astype(np.float32)
    light = np.full(1, 0.5, np.float32)

    def end(stride):
        inner, out = np.full(1, log[0], float), np.full(1, log[0], float)
        for k in range(0, 100, stride):
            before, now = out, np.empty(1)
            low_pass(
                log[[k]], log[[k + stride]], light, light, 0.03 * stride, 0.08, order,
                inner, before, now,
            )  # fmt: skip
            out = now
        return out[0]

    assert end(100) == pytest.approx(end(1), abs=1e-6)


def test_leak_rate_and_jitter_of_intervals():
    """20 Hz over 20 s of irregular frames: 400 events of every pixel, all positive, all leak."""
    shape, times_us = (10, 12), irregular_times_us(20_000_000)
    settings = config(leak_rate_hz=20.0, leak_jitter=0.2)
    labelled, _ = run(constant(0.3, shape, times_us), times_us, settings)
    assert set(labelled.label.tolist()) == {Label.LEAK}
    assert set(labelled.events.p.tolist()) == {1}
    rate_hz = counts_per_pixel(labelled.events, shape) / 20
    np.testing.assert_allclose(rate_hz, 20, rtol=0.05)
    assert rate_hz.mean() == pytest.approx(20, rel=0.005)
    gaps_us = gaps_of(labelled.events, shape)
    assert gaps_us.mean() == pytest.approx(50_000, rel=0.01)
    assert gaps_us.std() == pytest.approx(0.2 * 50_000, rel=0.05)


@pytest.mark.parametrize("dark_hz", [0.0, 5.0])
@pytest.mark.parametrize("level", often([0.0, 1.0], [0.0, 0.25, 1.0, 3.0]))
def test_leak_grows_in_proportion_to_light(dark_hz, level):
    shape, times_us = (10, 12), irregular_times_us(10_000_000)
    settings = config(leak_rate_hz=dark_hz, leak_light_hz=8.0, leak_jitter=0.1)
    labelled, _ = run(constant(level, shape, times_us), times_us, settings)
    rate_hz = counts_per_pixel(labelled.events, shape) / 10
    assert rate_hz.mean() == pytest.approx(dark_hz + 8 * level, rel=0.01, abs=0.01)
    assert set(labelled.label.tolist()) <= {Label.LEAK}


def test_leak_in_light_that_rises_and_falls_is_that_of_its_mean():
    shape, times_us = (10, 12), list(range(0, 10_000_001, 5000))
    # Too faint a flicker for an event of its own: thresholds are far away.
    frames = [np.full(shape, 0.5 + 0.4 * (k % 2), np.float32) for k in range(len(times_us))]
    settings = config(c_pos=50, c_neg=50, leak_light_hz=10.0)
    labelled, _ = run(frames, times_us, settings)
    assert len(labelled) / 120 / 10 == pytest.approx(7, rel=0.01)


def test_leak_does_not_depend_on_the_frames():
    shape, few_us = (6, 6), [0, 900_000, 1_000_000]
    many_us = list(range(0, 1_000_001, 500))
    settings = config(leak_rate_hz=10.0, leak_jitter=0.3)
    few, _ = run(constant(0.3, shape, few_us), few_us, settings)
    many, _ = run(constant(0.3, shape, many_us), many_us, settings)
    assert abs(len(few) - len(many)) <= 2
    assert np.array_equal(counts_per_pixel(few.events, shape), counts_per_pixel(many.events, shape))


def test_leak_helps_rises_and_delays_falls():
    shape, times_us = (20, 20), [0, 1_000_000]
    settings = config(c_pos=0.1, c_neg=0.1, log_eps=EPS, leak_rate_hz=5.0, leak_jitter=0.0)
    rise, _ = run(ramp(-1, 0.0, times_us, shape), times_us, settings)
    fall, _ = run(ramp(0.0, -1, times_us, shape), times_us, settings)
    # 10 thresholds of signal and 5 of leak, from anywhere above an event and below the next.
    assert len(rise) / 400 == pytest.approx(15, abs=0.02)
    assert len(fall) / 400 == pytest.approx(4, abs=0.02)
    assert set(rise.label.tolist()) == {Label.SIGNAL}


def test_pixels_equal_their_twin():
    rng = np.random.default_rng(5)
    frames = rng.uniform(0.1, 1, (40, 4, 5)).astype(np.float32)
    frames[10:30] = frames[10]
    times_us = np.cumsum(rng.integers(20, 60_000, 40)).tolist()
    parameters = SensorParameters(threshold_sigma=0.04, leak_rate_hz=6.0, leak_jitter=0.3)
    pixels = Pixels((4, 5), (0.2, 0.25), 0.02, parameters, Randomness(0, 0))
    pixels.start(frames[0])
    start, key = pixels.state()["leaked"].copy(), pixels._leak_key
    steps = [
        pixels.step(f, a, b) for f, a, b in zip(frames[1:], times_us, times_us[1:], strict=False)
    ]
    mine = [list(zip(b.pixel, b.t_us, b.p, b.label, strict=True)) for b in steps]
    logs = naive_esim.log_of(frames, 0.02).astype(float).reshape(40, -1)
    leaky = 0
    for k in range(20):
        leak = [
            naive_sensor.leaked(
                (t - times_us[0]) * 1e-6, start[k],
                lambda slot, k=k: 1 / kernels.leak_speed(key, k, slot, 6.0, 0.3),
            )
            for t in times_us
        ]  # fmt: skip
        twin = naive_sensor.comparator(
            logs[:, k].tolist(), leak, times_us, pixels.c_pos[k], pixels.c_neg[k]
        )
        assert [tuple(map(int, row[1:])) for step in mine for row in step if row[0] == k] == twin
        leaky += sum(row[2] for row in twin)
    assert leaky > 20


def test_numbers_of_the_leak_are_standard_normal():
    key = np.uint64(12345678901234567890)
    drawn = np.array([kernels.normal(key, k, j) for k in range(200) for j in range(100)])
    assert drawn.mean() == pytest.approx(0, abs=0.03)
    assert drawn.std() == pytest.approx(1, abs=0.02)
    table = drawn.reshape(200, 100)
    assert abs(np.corrcoef(table[:-1].ravel(), table[1:].ravel())[0, 1]) < 0.03
    assert abs(np.corrcoef(table[:, :-1].ravel(), table[:, 1:].ravel())[0, 1]) < 0.03
