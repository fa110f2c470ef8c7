"""Latency, the row arbiter and its losses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive_sensor
from eventsweep.sim.sensor.pixels import Batch, Randomness
from eventsweep.sim.sensor.sensor import Arbiter, Latency
from eventsweep.sim.sensor_presets import SensorParameters
from sensor_runs import config, run

LONG_US = 10**6


def batch(t_us, pixel):
    number = len(t_us)
    index = (np.arange(number) % 251).astype(np.uint8)
    return Batch(np.asarray(pixel, np.int32), np.asarray(t_us, np.int64), index % 2, index)


@pytest.mark.parametrize("level", [0.0, 0.3, 1.0, 4.0])
def test_latency_has_its_mean_and_spread(level):
    number, dark = 20_000, SensorParameters().dark_level
    parameters = SensorParameters(latency_us=2000.0, latency_jitter=0.25)
    latency = Latency(number, parameters, Randomness(0, 0))
    light = np.full(number, level, np.float32)
    events = batch(np.zeros(number), np.arange(number))
    delay_us = latency.step(events, light, 0, LONG_US).t_us
    mean_us = 2000 * (1 + dark) / (level + dark)
    assert len(delay_us) == number
    assert delay_us.mean() == pytest.approx(mean_us, rel=0.01)
    assert delay_us.std() == pytest.approx(0.25 * mean_us, rel=0.03)
    # A gamma distribution's skewness is twice its coefficient of variation.
    skewness = (((delay_us - delay_us.mean()) / delay_us.std()) ** 3).mean()
    assert skewness == pytest.approx(0.5, abs=0.1)


def test_latency_without_jitter_only_delays():
    frames = np.array([0.1, 0.9], np.float32)[:, None, None] * np.ones((1, 6, 7), np.float32)
    plain, _ = run([*frames, frames[1]], [0, 1000, 9000], config())
    late, _ = run([*frames, frames[1]], [0, 1000, 9000], config(latency_us=100.0))
    dark = SensorParameters().dark_level
    delay_us = round(100 * (1 + dark) / (0.9 + dark))
    assert np.array_equal(late.events.t_us, plain.events.t_us + delay_us)


def test_a_pixels_events_never_overtake_each_other():
    parameters = SensorParameters(latency_us=500.0, latency_jitter=1.0)
    latency = Latency(3, parameters, Randomness(0, 0))
    pixel = np.arange(3000) % 3
    out = latency.step(batch(np.arange(3000), pixel), np.ones(3, np.float32), 0, LONG_US)
    for k in range(3):
        mine = out.label[out.pixel == k]
        sent = (np.arange(3000) % 251)[pixel == k]
        assert np.array_equal(mine, sent)


REQUESTS = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 5)), max_size=60).map(sorted)


@given(
    REQUESTS, st.sampled_from([0.0, 2e5, 1e6]), st.sampled_from([1.5e5, 7e5, 3e6]),
    st.integers(1, 12), st.integers(1, 100),
)  # fmt: skip
def test_arbiter_equals_its_twin_however_it_is_cut(requests, rows_hz, events_hz, capacity, step):
    parameters = SensorParameters(
        readout_rows_per_s=rows_hz, readout_events_per_s=events_hz, readout_queue_events=capacity
    )
    arbiter = Arbiter((6, 1), parameters)
    t_us, row = (np.array([r[k] for r in requests], np.int64) for k in (0, 1))
    events = batch(t_us, row)
    sent, lost, before_us = [], 0, -1
    for end_us in range(step, 2000, step):
        mine = events.take((t_us > before_us) & (t_us <= end_us))
        out, dropped = arbiter.step(mine, end_us)
        sent += list(zip(out.label.tolist(), out.t_us.tolist(), strict=True))
        lost, before_us = lost + dropped, end_us
    event_us, row_us = 1e6 / events_hz, 1e6 / rows_hz if rows_hz else 0.0
    served, dropped = naive_sensor.arbiter(requests, row_us, event_us, capacity)
    assert sent == served
    assert lost == len(dropped)
    assert len(sent) + lost == len(requests)


def test_throughput_is_never_exceeded_and_reached_under_load():
    rng = np.random.default_rng(0)
    number, rate_hz = 20_000, 1e5
    t_us = np.sort(rng.integers(0, 100_000, number))
    arbiter = Arbiter(
        (60, 80), SensorParameters(readout_events_per_s=rate_hz, readout_queue_events=300)
    )
    out, lost = arbiter.step(batch(t_us, rng.integers(0, 4800, number)), 100_000)
    left = arbiter.discard()
    assert len(out) + lost + left == number
    assert left <= 300
    # Any service keeps the read-out busy until the next: 10 µs per event since the first.
    stamps_us, counts = np.unique(out.t_us, return_counts=True)
    assert (np.diff(stamps_us) >= 10 * counts[:-1] - 1).all()
    assert len(out) == pytest.approx(10_000, rel=0.01)


def test_rows_are_read_at_once_and_limited():
    arbiter = Arbiter((4, 100), SensorParameters(readout_rows_per_s=1e4))
    pixel = np.concatenate([np.arange(100) + 100 * row for row in range(4)])
    out, lost = arbiter.step(batch(np.full(400, 7), pixel), 10_000)
    assert lost == 0
    assert out.t_us.tolist() == [7] * 100 + [107] * 100 + [207] * 100 + [307] * 100


def test_an_unloaded_readout_changes_no_time():
    rng = np.random.default_rng(1)
    t_us = np.cumsum(rng.integers(2, 50, 500))
    events = batch(t_us, rng.integers(0, 100, 500))
    out, lost = Arbiter((10, 10), SensorParameters(readout_events_per_s=1e6)).step(events, LONG_US)
    assert lost == 0
    assert np.array_equal(out.t_us, t_us)
