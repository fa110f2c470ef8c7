"""The event model: its laws, and equality with a plain twin."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import naive_esim
from eventsweep.emvs.data.events import Events
from eventsweep.sim.config import SimConfig
from eventsweep.sim.sensor.esim import EventSimulator
from made_events import assert_same_events
from refusals import refused
from sensor_runs import ideal_rows, run_ideal

H, W = 3, 4
FRAMES = hnp.arrays(
    np.float32,
    st.tuples(st.integers(2, 6), st.just(H), st.just(W)),
    elements=st.floats(0, 1, width=32),
)
THRESHOLD = st.floats(0.03, 0.6)


@st.composite
def recordings(draw):
    frames = draw(FRAMES)
    steps = draw(st.lists(st.integers(1, 90_000), min_size=len(frames), max_size=len(frames)))
    config = SimConfig(
        contrast_threshold_pos=draw(THRESHOLD),
        contrast_threshold_neg=draw(THRESHOLD),
        refractory_period_us=draw(st.sampled_from([0, 0, 1, 500, 20_000, 10**7])),
    )
    # Time starts before zero in some, so that no time stamp means "never".
    return frames, (np.cumsum(steps) - draw(st.integers(0, 100_000))).tolist(), config


def log_change(frames, config):
    logs = naive_esim.log_of(frames, config.log_eps).astype(float)
    return logs[-1] - logs[0]


def integrated(events, config, shape):
    total = np.zeros(shape)
    size = np.where(events.p == 1, config.contrast_threshold_pos, -config.contrast_threshold_neg)
    np.add.at(total, (events.y, events.x), size)
    return total


@given(recordings())
def test_equals_the_twin_event_by_event(recording):
    assert ideal_rows(run_ideal(*recording)) == naive_esim.simulate(*recording)


@given(recordings())
def test_events_integrate_to_the_change_of_log_intensity(recording):
    frames, times_us, config = recording
    config = config.model_copy(update={"refractory_period_us": 0})
    total = integrated(Events.concat(run_ideal(frames, times_us, config)), config, (H, W))
    error = log_change(frames, config) - total
    assert (error < config.contrast_threshold_pos + 1e-9).all()
    assert (error > -config.contrast_threshold_neg - 1e-9).all()


@given(recordings())
def test_times_are_sorted_inside_their_interval_with_ties_in_raster_order(recording):
    frames, times_us, config = recording
    for k, events in enumerate(run_ideal(frames, times_us, config)):
        assert ((events.t_us > times_us[k]) & (events.t_us <= times_us[k + 1])).all()
        key = np.stack([events.t_us, events.y, events.x]).astype(np.int64)
        assert (np.lexsort(key[::-1]) == np.arange(len(events))).all()


@given(recordings())
def test_no_pixel_emits_twice_within_the_refractory_period(recording):
    events = Events.concat(run_ideal(*recording))
    for pixel in range(H * W):
        mine = events.t_us[events.y.astype(int) * W + events.x == pixel]
        assert (np.diff(mine) >= recording[2].refractory_period_us).all()


def one_pixel(values):
    return np.asarray(values, np.float32).reshape(-1, 1, 1)


def linear_in_log(start, slope, times_us, eps):
    return one_pixel(np.exp(start + slope * np.asarray(times_us)) - eps)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_linear_ramp_fires_at_the_ideal_times(sign):
    config = SimConfig(contrast_threshold_pos=0.1, contrast_threshold_neg=0.15)
    threshold = 0.1 if sign > 0 else 0.15
    times_us = [0, 2500, 10_000]
    slope = sign * 1.03 / 10_000
    frames = linear_in_log(-1.5, slope, times_us, config.log_eps)
    events = Events.concat(run_ideal(frames, times_us, config))
    ideal_us = np.arange(1, int(1.03 / threshold) + 1) * threshold / abs(slope)
    np.testing.assert_allclose(events.t_us, ideal_us, rtol=0, atol=0.6)
    assert set(events.p.tolist()) == {1 if sign > 0 else 0}


@given(st.floats(-2, 2), st.integers(1, 9_999))
def test_two_steps_of_a_linear_ramp_equal_one(rise, middle_us):
    config = SimConfig(contrast_threshold_pos=0.07, contrast_threshold_neg=0.11)
    frames = linear_in_log(-1.5, rise / 10_000, [0, middle_us, 10_000], config.log_eps)
    once = Events.concat(run_ideal(frames[[0, 2]], [0, 10_000], config))
    twice = Events.concat(run_ideal(frames, [0, middle_us, 10_000], config))
    # A crossing that the last frame just touches may fall to either side of float32's rounding.
    assert abs(len(once) - len(twice)) <= 1
    both = min(len(once), len(twice))
    np.testing.assert_allclose(once.t_us[:both], twice.t_us[:both], rtol=0, atol=1)


@pytest.mark.slow
def test_references_do_not_drift_over_many_events():
    """20 000 flickers of three crossings each, then back to the start: nothing is left over."""
    config = SimConfig(contrast_threshold_pos=0.1, contrast_threshold_neg=0.13)
    frames = one_pixel([0.3, 0.45, 0.2] * 20_000 + [0.3])
    times_us = list(range(0, 1000 * len(frames), 1000))
    events = Events.concat(run_ideal(frames, times_us, config))
    error = (log_change(frames, config) - integrated(events, config, (1, 1))).item()
    assert len(events) > 100_000
    assert -0.13 - 1e-9 < error < 0.1 + 1e-9


def test_cameras_in_threads_give_what_they_give_alone():
    frames = np.random.default_rng(0).random((2, 4, 64, 48), np.float32)
    times_us = [0, 700, 1500, 200_000]
    alone = [Events.concat(run_ideal(f, times_us, SimConfig())) for f in frames]
    with ThreadPoolExecutor(2) as pool:
        together = pool.map(lambda f: Events.concat(run_ideal(f, times_us, SimConfig())), frames)
    for a, b in zip(alone, together, strict=True):
        assert_same_events(a, b)


def test_frames_are_not_changed():
    frames = np.random.default_rng(0).random((3, H, W), np.float32)
    before = frames.copy()
    run_ideal(frames, [0, 10, 20], SimConfig())
    assert np.array_equal(frames, before)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -0.1])
def test_refuses_misuse_and_impossible_intensities(bad):
    frame = np.full((H, W), 0.5, np.float32)
    simulator = EventSimulator(W, H, SimConfig())
    refused(r"before start", simulator.step, frame, 0)
    simulator.start(frame, 5)
    refused("must increase", simulator.step, frame, 5)
    refused("this sensor needs", simulator.step, frame.T, 6)
    frame[1, 2] = bad
    refused("finite values", simulator.step, frame, 10)
