"""The whole sensor: ideal is ESIM, equal arguments give equal events, nothing gets lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import naive_esim
from eventsweep.emvs.errors import InputError
from eventsweep.sim.config import SimConfig
from eventsweep.sim.sensor.esim import EventSimulator
from eventsweep.sim.sensor.frame_camera import blurred
from eventsweep.sim.sensor.labels import Drop, Label
from eventsweep.sim.sensor.sensor import Sensor
from eventsweep.sim.sensor_presets import PRESETS, SensorConfig
from refusals import refused
from sensor_runs import config, constant, irregular_times_us, moving_bars, rows_of, run

NOISY = {
    "lens_blur_px": 0.5, "threshold_sigma": 0.03, "bandwidth_hz": 200.0, "bandwidth_order": 2,
    "leak_rate_hz": 5.0, "leak_light_hz": 5.0, "noise_spread_decades": 0.2,
    "shot_rate_dark_hz": 20.0, "shot_rate_bright_hz": 5.0, "hot_pixel_fraction": 0.02,
    "hot_pixel_rate_hz": 300.0, "latency_us": 300.0, "latency_jitter": 0.5,
    "readout_events_per_s": 3e4, "readout_rows_per_s": 1e5, "readout_queue_events": 20,
}  # fmt: skip


@settings(max_examples=50)
@given(st.integers(0, 2**32), st.sampled_from([0, 1, 700, 30_000]), st.booleans())
def test_ideal_equals_esim_and_its_twin(seed, refractory_us, full):
    rng = np.random.default_rng(seed)
    frames = rng.random((4, 3, 5), np.float32) * np.float32(3)
    times_us = (np.cumsum(rng.integers(1, 90_000, 4)) - 50_000).tolist()
    ideal = config(refractory_us, 0.11, 0.17)
    labelled, sensor = run(frames, times_us, ideal, always_full=full)
    esim = EventSimulator(5, 3, ideal)
    esim.start(frames[0], times_us[0])
    steps = [esim.step(f, t) for f, t in zip(frames[1:], times_us[1:], strict=True)]
    expected = [
        (t, y, x, p) for e in steps for t, y, x, p in zip(e.t_us, e.y, e.x, e.p, strict=True)
    ]
    assert [row[:4] for row in rows_of(labelled)] == expected
    assert expected == naive_esim.simulate(frames, times_us, ideal)
    assert not labelled.label.any()
    assert sensor.counts["dropped_refractory"] == esim.suppressed


@pytest.mark.parametrize("cut", [0, 1, 7, 19])
@pytest.mark.parametrize("preset", ["ideal", "davis346"])
def test_goes_on_from_its_state_bit_by_bit(cut, preset):
    settings_ = config(100, **({} if preset == "ideal" else NOISY))
    frames, times_us = moving_bars(30), irregular_times_us(200_000)[:30]
    whole, sensor = run(frames, times_us, settings_, seed=3)
    first, second = (Sensor(0, 16, 12, settings_, 3) for _ in range(2))
    first.start(frames[0], times_us[0])
    rows = [r for k in range(1, cut + 1) for r in rows_of(first.step(frames[k], times_us[k]))]
    second.restore({name: value.copy() for name, value in first.state().items()})
    first.step(frames[cut + 1], times_us[cut + 1])
    for k in range(cut + 1, len(times_us)):
        rows += rows_of(second.step(frames[k], times_us[k]))
    second.finish()
    assert rows == rows_of(whole)
    assert second.counts == sensor.counts


def test_second_events_of_pairs_survive_a_restart():
    settings_ = config(shot_rate_dark_hz=400.0, shot_rate_bright_hz=400.0, shot_pair_rate_hz=30.0)
    frames, times_us = constant(0.3, (12, 16), range(9)), list(range(0, 90_000, 10_000))
    whole, sensor = run(frames, times_us, settings_)
    first, second = (Sensor(0, 16, 12, settings_, 0) for _ in range(2))
    first.start(frames[0], 0)
    rows = [r for k in range(1, 4) for r in rows_of(first.step(frames[k], times_us[k]))]
    second.restore(first.state())
    rows += [r for k in range(4, 9) for r in rows_of(second.step(frames[k], times_us[k]))]
    second.finish()
    assert rows == rows_of(whole)
    assert second.counts == sensor.counts
    # Half of what is caused in the last 33 ms, the mean time to the second event, is cut off.
    assert sensor.counts["dropped_after_end"] > 100


def test_a_blurring_lens_is_a_blurred_picture():
    frames, times_us = moving_bars(20), [2000 * k for k in range(20)]
    through, _ = run(frames, times_us, config(lens_blur_px=1.5))
    blurry, _ = run([blurred(frame, 1.5) for frame in frames], times_us, config())
    sharp, _ = run(frames, times_us, config())
    assert rows_of(through) == rows_of(blurry)
    assert len(blurry) < 0.7 * len(sharp)
    with pytest.raises(InputError, match="finite values"):
        Sensor(0, 16, 12, config(lens_blur_px=9), 0).start(frames[0] - 0.3, 0)


def test_cameras_and_seeds_differ_and_repeats_do_not():
    frames, times_us = moving_bars(20), [1000 * k for k in range(20)]
    noisy = config(100, **NOISY)
    same, again = (rows_of(run(frames, times_us, noisy, 1, 0)[0]) for _ in range(2))
    assert same == again
    assert same != rows_of(run(frames, times_us, noisy, 2, 0)[0])
    assert same != rows_of(run(frames, times_us, noisy, 1, 1)[0])


def test_every_event_is_sent_or_counted_as_dropped():
    """What limits the output never changes what the pixels do."""
    frames, times_us = moving_bars(40), irregular_times_us(200_000)[:40]
    pixels = {k: v for k, v in NOISY.items() if not k.startswith(("readout", "latency"))}
    caused, _ = run(frames, times_us, config(0, **pixels))
    sent, sensor = run(frames, times_us, config(400, **NOISY))
    counts = sensor.counts
    assert counts == {
        **{label.name.lower(): int((sent.label == label).sum()) for label in Label},
        **{k: v for k, v in counts.items() if k.startswith("dropped_")},
    }
    assert sum(counts.values()) == len(caused)
    assert all(counts[f"dropped_{drop.name.lower()}"] for drop in Drop)


def test_a_sensor_that_starts_again_counts_from_nothing():
    frames, times_us = moving_bars(10), [2000 * k for k in range(10)]
    once, sensor = run(frames, times_us, config(**NOISY))
    sensor.start(frames[0], 0)
    assert len(once) > 0
    assert set(sensor.counts.values()) == {0}


def test_events_come_out_in_order_and_inside_the_recording():
    frames, times_us = moving_bars(40), irregular_times_us(200_000)[:40]
    sensor = Sensor(0, 16, 12, config(100, **NOISY), 0)
    sensor.start(frames[0], times_us[0])
    last_us = times_us[0]
    for frame, t_us in zip(frames[1:], times_us[1:], strict=True):
        out_us = sensor.step(frame, t_us).events.t_us
        assert (np.diff(np.concatenate([[last_us], out_us, [t_us]])) >= 0).all()
        last_us = int(out_us[-1]) if len(out_us) else last_us


def test_the_clock_rounds_down():
    frames, times_us = moving_bars(10), [1000 * k for k in range(10)]
    fine, _ = run(frames, times_us, config())
    coarse, _ = run(frames, times_us, config(timestamp_resolution_us=64))
    assert np.array_equal(coarse.events.t_us, fine.events.t_us // 64 * 64)


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_run_and_given_values_beat_them(preset):
    frames, times_us = moving_bars(10), [2000 * k for k in range(10)]
    labelled, _ = run(frames, times_us, SimConfig(sensor=SensorConfig(preset=preset)))
    assert len(labelled) > 50
    given = SimConfig(
        contrast_threshold_neg=0.5, sensor=SensorConfig(preset=preset, leak_rate_hz=7)
    )
    thresholds = PRESETS[preset].thresholds
    assert given.contrast_threshold_neg == 0.5
    assert given.contrast_threshold_pos == thresholds.get("contrast_threshold_pos", 0.2)
    assert given.sensor.resolved().leak_rate_hz == 7
    expected_us = PRESETS[preset].parameters.latency_us
    assert given.sensor.resolved().latency_us == expected_us
    assert SimConfig.model_validate(given.model_dump()) == given


def test_zero_switches_a_presets_effect_off():
    off = SensorConfig(
        preset="davis346", threshold_sigma=0, bandwidth_hz=0, leak_rate_hz=0, shot_rate_dark_hz=0,
        shot_rate_bright_hz=0, hot_pixel_fraction=0, latency_us=0, readout_events_per_s=0,
    )  # fmt: skip
    assert off.resolved().ideal_pixels
    assert off.resolved().ideal_readout


def test_refuses_misuse():
    sensor = Sensor(0, 4, 3, config(**NOISY), 0)
    frame = constant(0.5, (3, 4), [0])[0]
    refused("before start", sensor.step, frame, 0)
    sensor.start(frame, 5)
    refused("must increase", sensor.step, frame, 5)
    refused("this sensor needs", sensor.step, frame.T, 6)
    refused("finite values", sensor.step, -frame, 6)
    refused("seed -1", Sensor, 0, 4, 3, config(**NOISY), -1)
