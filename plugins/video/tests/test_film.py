"""A folder of images and a video through the sensor: the law of ESIM, whatever the frames' file."""

import math
import tempfile
from fractions import Fraction
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import naive_esim
from eventsweep.emvs.errors import InputError
from eventsweep.plugins.video.film import Film, Pace, ahead
from eventsweep.plugins.video.frames import open_frames
from eventsweep.plugins.video.record import record
from eventsweep.sim.config import PixelConfig, VideoConfig
from eventsweep.sim.sensor_presets import SensorConfig
from refusals import refused
from sensor_runs import grey_video
from video_files import decoded, drifting, events_of, rows, write_folder, write_video

LINEAR = VideoConfig(encoding="linear")
# What esim_py is called with in its own examples: values over 255 taken as light.
ESIM_PY = PixelConfig(
    contrast_threshold_pos=0.2, contrast_threshold_neg=0.2, refractory_period_us=100, log_eps=1e-3
)


def recorded(source, out, pixels=None, video=None, **options):
    return record(source, out, pixels or PixelConfig(), video or VideoConfig(), **options)


@st.composite
def films(draw):
    frames = draw(hnp.arrays(np.uint8, st.tuples(st.integers(2, 6), st.just(2), st.just(3))))
    steps = draw(st.lists(st.integers(1, 90_000), min_size=len(frames), max_size=len(frames)))
    start = draw(st.sampled_from([0, -50_000, 1_600_000_000_000_000]))
    pixels = PixelConfig(
        contrast_threshold_pos=draw(st.floats(0.05, 0.6)),
        contrast_threshold_neg=draw(st.floats(0.05, 0.6)),
        refractory_period_us=draw(st.sampled_from([0, 0, 500, 20_000])),
        log_eps=draw(st.sampled_from([0.02, 1e-3])),
    )
    return frames, (start + np.cumsum(steps)).tolist(), pixels


@settings(deadline=None, max_examples=60)
@given(films())
def test_a_folder_of_images_gives_the_events_of_the_exact_law(film):
    """Against sums of exact fractions: every event's pixel, polarity and microsecond."""
    frames, times_us, pixels = film
    with tempfile.TemporaryDirectory() as temporary:
        folder = write_folder(Path(temporary) / "in", frames, times_us)
        out = Path(temporary) / "out"
        told = recorded(folder, out, pixels, VideoConfig(encoding="linear", unit="us"))
        found = rows(events_of(out))
    light = (frames.astype(np.float64) / 255).astype(np.float32)
    assert found == naive_esim.simulate(light, times_us, pixels)
    assert told.span_us == (times_us[0], times_us[-1])


def test_ramps_of_grey_levels_fire_as_often_as_whole_thresholds_fit(tmp_path):
    """esim_py's kind of input, counted by exact powers instead of logarithms.

    From level a to level b pixels fire floor(ln((b + e) / (a + e)) / C) times; with C = ln 2 the
    number is that of doublings, found by integers alone.
    """
    levels = np.arange(256, dtype=np.uint8)
    frames = np.stack([np.full(256, 3, np.uint8), levels])[:, None]
    pixels = PixelConfig(
        contrast_threshold_pos=math.log(2), contrast_threshold_neg=math.log(2), log_eps=1 / 255
    )
    recorded(write_folder(tmp_path / "in", frames, ["0.0", "0.1"]), tmp_path / "o", pixels, LINEAR)
    events = events_of(tmp_path / "o")
    for level in levels.tolist():
        ratio = Fraction(level + 1, 4)
        number = int(math.log2(max(ratio, 1 / ratio)) + 1e-12)
        mine = events.p[events.x == level]
        assert mine.tolist() == [int(ratio > 1)] * number, level


def test_esim_pys_settings_give_the_events_of_its_law(tmp_path):
    """By its float32 reference, whose drift loses some, and by exact sums, all of them."""
    light, times_us = grey_video(61, 18, 24), list(range(0, 61_000, 1000))
    levels = np.rint(light * 255).astype(np.uint8)
    folder = write_folder(tmp_path / "in", levels, [f"{t * 1e-6:.6f}" for t in times_us])
    recorded(folder, tmp_path / "out", ESIM_PY, LINEAR)
    found = rows(events_of(tmp_path / "out"))
    theirs = naive_esim.published(np.log(light + np.float32(1e-3)), times_us, 0.2, 100)
    near = {(t_us + off_us, *where) for t_us, *where in found for off_us in (-1, 0, 1)}
    assert len(theirs) > 1500
    assert len(theirs & near) / len(theirs) > 0.995
    assert found == naive_esim.simulate(light, times_us, ESIM_PY)


@pytest.mark.parametrize("preset", ["ideal", "davis346"])
@pytest.mark.parametrize(("codec", "name"), [("MJPG", "v.avi"), ("mp4v", "v.mp4")])
def test_a_video_gives_the_events_of_its_decoded_frames(tmp_path, codec, name, preset):
    path = write_video(tmp_path / name, drifting(20, 64, 48, colour=True), 25.0, codec)
    frames = decoded(path)
    assert len(frames) == 20
    folder = write_folder(tmp_path / "in", frames, [f"{k * 0.04:.6f}" for k in range(20)])
    pixels = PixelConfig(sensor=SensorConfig(preset=preset))
    of_video = recorded(path, tmp_path / "a", pixels, seed=3)
    of_folder = recorded(folder, tmp_path / "b", pixels, seed=3)
    events = events_of(tmp_path / "a")
    assert rows(events) == rows(events_of(tmp_path / "b"))
    assert of_video.events == of_folder.events == len(events) > 1000
    assert of_video.span_us == (0, 19 * 40_000)
    assert of_video.encoding == of_folder.encoding == "srgb"


def test_times_scale_with_slow_motion_and_rate(tmp_path):
    path = write_video(tmp_path / "v.avi", drifting(10, 64, 48, colour=True), 30.0)
    base = recorded(path, tmp_path / "a")
    slowed = recorded(path, tmp_path / "b", video=VideoConfig(slow_motion=8))
    stated = recorded(path, tmp_path / "c", video=VideoConfig(rate_hz=240))
    assert base.span_us == (0, 300_000)
    assert slowed.span_us == stated.span_us == (0, 37_500)
    assert rows(events_of(tmp_path / "b")) == rows(events_of(tmp_path / "c"))
    assert "8 times slower" in slowed.time_base
    assert stated.time_base == "240 Hz as stated"


def test_equal_seeds_give_equal_noise_and_others_do_not(tmp_path):
    folder = write_folder(tmp_path / "in", drifting(8), [f"{k}.0" for k in range(8)])
    pixels = PixelConfig(sensor=SensorConfig(preset="davis346"))
    made = [recorded(folder, tmp_path / str(k), pixels, seed=s) for k, s in enumerate((1, 1, 2))]
    assert rows(events_of(made[0].path)) == rows(events_of(made[1].path))
    assert rows(events_of(made[0].path)) != rows(events_of(made[2].path))


def measure(frames):
    pace = Pace(PixelConfig())
    for frame in frames:
        pace.take(frame)
    return pace.lost_at_half_rate


def test_frames_that_only_rise_lose_nothing_at_half_their_rate():
    ramp = np.linspace(0.05, 0.9, 30)[:, None, None] * np.ones((1, 4, 4))
    assert measure(ramp.astype(np.float32)) < 1e-6
    assert measure(ramp[:2].astype(np.float32)) == 0


def test_frames_that_have_nothing_in_common_lose_half():
    """Of independent values |a - c| is |a - b| on average, a half of what a, b and c move."""
    logs = np.random.default_rng(0).uniform(-3, 0, (40, 100, 100))
    assert measure(np.exp(logs).astype(np.float32)) == pytest.approx(0.5, abs=0.02)


def test_a_flicker_loses_everything():
    logs = np.where(np.arange(9) % 2, -2.0, -1.0)[:, None, None] * np.ones((1, 4, 4))
    assert measure(np.exp(logs).astype(np.float32)) == pytest.approx(1.0)


@pytest.mark.parametrize(("step_px", "told"), [(0.5, False), (9.0, True)])
def test_images_that_move_too_fast_are_told_of_once(tmp_path, step_px, told):
    folder = write_folder(tmp_path / "in", drifting(16, step_px=step_px), np.arange(16) + 0.5)
    notes = recorded(folder, tmp_path / "out").notes
    assert len([note for note in notes if "moves too far" in note]) == told


def test_items_are_made_while_the_one_before_is_at_work():
    second = Event()

    def items():
        yield 1
        second.set()
        yield 2
        raise InputError("the third")

    taken = ahead(items())
    assert next(taken) == 1
    assert second.wait(10)
    assert next(taken) == 2
    refused("the third", next, taken)


def test_values_that_are_no_light_are_named(tmp_path):
    frames = np.full((3, 2, 2), 0.5, np.float32)
    frames[2, 0, 0] = -0.25
    folder = write_folder(tmp_path / "in", frames, ["0.0", "0.1", "0.2"], ".npy")
    film = Film(open_frames(folder, VideoConfig()), PixelConfig(), VideoConfig(), 0)
    refused(r"2\.npy decodes to light from -0\.25 to 0\.5 \(linear\)", list, film)
    refused(r"2\.npy", recorded, folder, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]
