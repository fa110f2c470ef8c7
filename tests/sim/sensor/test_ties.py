"""Levels reached exactly: images of few grey levels, whose pixels return to old values."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import naive_esim
from eventsweep.emvs.data.events import Events
from eventsweep.sim.config import SimConfig
from eventsweep.sim.sensor.esim import EventSimulator
from sensor_runs import config as sensor_config
from sensor_runs import grey_video, ideal_rows, rows_of, run_ideal
from sensor_runs import run as run_sensor

H, W = 2, 3
GREY = [0, 20, 50, 51, 130, 255]
# None of these is a binary fraction: every sum of them is rounded somewhere.
THRESHOLD = st.sampled_from([0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.6])


@st.composite
def quantised(draw):
    """Frames (N, H, W) of few grey levels, their times, and a configuration."""
    count = draw(st.integers(3, 12))
    grey = draw(hnp.arrays(np.int64, (count, H, W), elements=st.sampled_from(GREY)))
    steps = draw(st.lists(st.integers(1, 20_000), min_size=count, max_size=count))
    config = SimConfig(
        contrast_threshold_pos=draw(THRESHOLD),
        contrast_threshold_neg=draw(THRESHOLD),
        refractory_period_us=draw(st.sampled_from([0, 0, 1, 500])),
        log_eps=draw(st.sampled_from([0.001, 0.02])),
    )
    return (grey / 255).astype(np.float32), np.cumsum(steps).tolist(), config


def exact_logs(frames, config):
    logs = naive_esim.log_of(frames, config.log_eps)
    return np.vectorize(lambda log: Fraction(float(log)), otypes=[object])(logs)


@given(quantised())
def test_quantised_frames_equal_exact_arithmetic(recording):
    assert ideal_rows(run_ideal(*recording)) == naive_esim.simulate(*recording)


@given(quantised())
def test_the_imperfect_pixels_decide_ties_alike(recording):
    frames, times_us, config = recording
    c_pos, c_neg = config.contrast_threshold_pos, config.contrast_threshold_neg
    full = sensor_config(config.refractory_period_us, c_pos, c_neg, config.log_eps)
    labelled, _ = run_sensor(frames, times_us, full, always_full=True)
    assert [row[:4] for row in rows_of(labelled)] == naive_esim.simulate(*recording)


@given(quantised())
def test_what_is_left_after_every_frame_is_less_than_a_threshold(recording):
    """In exact arithmetic, without any allowance."""
    frames, times_us, config = recording
    config = config.model_copy(update={"refractory_period_us": 0})
    c_pos, c_neg = (
        Fraction(c) for c in (config.contrast_threshold_pos, config.contrast_threshold_neg)
    )
    logs = exact_logs(frames, config)
    net = np.full((H, W), Fraction(0))
    for log, events in zip(logs[1:], run_ideal(frames, times_us, config), strict=True):
        np.add.at(net, (events.y, events.x), np.where(events.p == 1, c_pos, -c_neg))
        left = log - logs[0] - net
        assert (left < c_pos).all()
        assert (left > -c_neg).all()


@given(
    st.lists(st.sampled_from(GREY), min_size=1, max_size=8),
    st.sampled_from(GREY), st.sampled_from([0.05, 0.07, 0.1, 0.15, 0.2]), st.integers(1, 6),
)  # fmt: skip
def test_what_rises_from_a_value_falls_back_to_it(grey, start, threshold, ratio):
    """C+ a multiple of C-: n rises are n times as many falls, each time the pixel comes back."""
    bright = [max(level, start) for level in grey]
    there_and_back = np.array([start, *(g for level in bright for g in (level, start))])
    frames = (there_and_back / 255).astype(np.float32).reshape(-1, 1, 1)
    config = SimConfig(contrast_threshold_pos=ratio * threshold, contrast_threshold_neg=threshold)
    steps = run_ideal(frames, list(range(0, 1000 * len(frames), 1000)), config)
    for there, back in zip(steps[::2], steps[1::2], strict=True):
        assert len(back) == ratio * len(there)
        assert not len(there) or back.t_us[-1] % 1000 == 0


def test_a_video_of_8_bits_gives_the_events_of_the_published_law():
    """Its float32 reference drifts, so the last thousandths cannot agree."""
    config = SimConfig(log_eps=1e-3, refractory_period_us=100)
    frames, times_us = grey_video(161, 18, 24), list(range(0, 161_000, 1000))
    theirs = naive_esim.published(
        naive_esim.log_of(frames, 1e-3), times_us, 0.2, config.refractory_period_us
    )
    mine = set(ideal_rows(run_ideal(frames, times_us, config)))
    near = {(t_us + off_us, *where) for t_us, *where in mine for off_us in (-1, 0, 1)}
    assert len(theirs) > 5000
    assert len(theirs & near) / len(theirs) > 0.995
    assert mine == set(naive_esim.simulate(frames, times_us, config))


def swing():
    """One pixel up, back, down and back again: back exactly, at frames 2 and 4."""
    logs = np.array([-1.0, -0.75, -1.0, -1.25, -1.0, -1.0])
    return (np.exp(logs) - 0.02).astype(np.float32).reshape(-1, 1, 1)


def test_a_level_reached_at_a_frame_fires_at_its_time_and_once():
    steps = run_ideal(swing(), list(range(0, 6000, 1000)), SimConfig())
    assert [len(events) for events in steps] == [1, 1, 1, 1, 0]
    assert [int(steps[k].t_us[0]) for k in (1, 3)] == [2000, 4000]


@pytest.mark.parametrize(("longer_us", "kept"), [(0, [0, 1, 3]), (1, [0, 2])])
def test_an_event_as_late_as_the_refractory_period_is_emitted(longer_us, kept):
    times_us = list(range(0, 6000, 1000))
    t_us = Events.concat(run_ideal(swing(), times_us, SimConfig())).t_us
    silence_us = int(t_us[1] - t_us[0]) + longer_us
    heard = Events.concat(run_ideal(swing(), times_us, SimConfig(refractory_period_us=silence_us)))
    assert heard.t_us.tolist() == t_us[kept].tolist()


def test_a_half_microsecond_goes_to_the_even_one():
    """Levels at 1/4 and 3/4 of 10 µs and of 6 µs; everything here is a binary fraction."""
    config = SimConfig(contrast_threshold_pos=0.25, contrast_threshold_neg=0.25)
    simulator = EventSimulator(1, 1, config)
    simulator.start(np.ones((1, 1), np.float32), 0)
    simulator._log_of = lambda log: log.ravel()
    simulator._log[:] = simulator._reference[:] = simulator._memory["first_log"] = 0
    found = [simulator.step(np.full((1, 1), log, np.float32), t) for log, t in ((1, 10), (0, 16))]
    assert [events.t_us.tolist() for events in found] == [[2, 5, 8, 10], [12, 13, 14, 16]]
