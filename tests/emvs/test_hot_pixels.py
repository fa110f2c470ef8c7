import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.hot_pixels import WithoutPixels, find_hot_pixels, hot_mask
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import RecordingInfo, read_map
from eventsweep.emvs.maps.sliding import map_windows
from eventsweep.emvs.windows import choose_window
from made_events import part_of, random_events
from point_world import fronto_parallel

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4, planes=20, methods=("Alg1/H", "EMVS/cam0"))
CLEAN = fronto_parallel(1.5)
SPAN = (0, 500_001)
RATIO = 3.0


def naive_hot_mask(counts, ratio):
    height, width = counts.shape
    around = np.pad(counts, 2, mode="reflect")
    median = np.median(counts[counts > 0])
    hot = np.zeros(counts.shape, bool)
    for y in range(height):
        for x in range(width):
            others = np.delete(around[y : y + 5, x : x + 5].ravel(), 12)
            usual = ratio * max(np.sort(others)[-4], median)
            hot[y, x] = counts[y, x] > usual + 5 * np.sqrt(usual)
    return hot


def with_hot(recording, pixels, rate_hz=20_000, seed=0):
    """The recording with pixels that fire at random, on top of what they saw, in every camera."""
    rng, streams = np.random.default_rng(seed), []
    for stream in recording.streams:
        hot = [random_events(rng, int(rate_hz * 0.5), 1, 1, 0, 500_000) for _ in pixels]
        moved = [dataclasses.replace(e, x=e.x + np.uint16(x), y=e.y + np.uint16(y))
                 for e, (x, y) in zip(hot, pixels, strict=True)]  # fmt: skip
        both = Events.concat([stream, *moved])
        streams.append(part_of(both, np.argsort(both.t_us, kind="stable")))
    return dataclasses.replace(recording, streams=tuple(streams))


@given(seed=st.integers(0, 10**6), high=st.integers(1, 300), ratio=st.sampled_from([0.5, 2.0, 5.0]))
def test_the_mask_equals_its_slow_twin(seed, high, ratio):
    rng = np.random.default_rng(seed)
    counts = rng.poisson(rng.uniform(0, 3), (9, 12)).astype(np.int64)
    counts[rng.integers(9), rng.integers(12)] = high
    np.testing.assert_array_equal(hot_mask(counts, ratio), naive_hot_mask(counts, ratio))


def test_no_events_no_hot_pixels():
    assert not hot_mask(np.zeros((6, 7), np.int64), RATIO).any()


def test_a_working_sensor_keeps_all_its_pixels():
    assert [found.pixels for found in find_hot_pixels(CLEAN, *SPAN, RATIO)] == [0, 0]


@settings(max_examples=5)
@given(st.lists(st.tuples(st.integers(0, 95), st.integers(0, 63)), max_size=8, unique=True))
def test_exactly_the_hot_pixels_are_found(pixels):
    # Four in one neighbourhood hide each other: the reference is the fourth most active.
    chosen: list[tuple[int, int]] = []
    for x, y in pixels:
        if sum(abs(x - a) < 5 and abs(y - b) < 5 for a, b in chosen) < 3:
            chosen.append((x, y))
    noisy = with_hot(CLEAN, chosen)
    for camera, found in enumerate(find_hot_pixels(noisy, *SPAN, RATIO)):
        assert {(int(x), int(y)) for y, x in np.argwhere(found.mask)} == set(chosen)
        events = noisy.streams[camera]
        assert found.events == int(found.mask[events.y, events.x].sum())


def test_the_map_is_that_of_the_clean_recording_without_these_pixels():
    pixels = [(40, 20), (41, 20), (70, 50), (0, 0)]
    noisy = with_hot(CLEAN, pixels)
    masks = [found.mask for found in find_hot_pixels(noisy, *SPAN, RATIO)]
    window = choose_window(CLEAN, CONFIG)
    expected = map_window(WithoutPixels(CLEAN, masks), CONFIG, window=window)
    filtered = map_window(WithoutPixels(noisy, masks), CONFIG, window=window)
    unfiltered = map_window(noisy, CONFIG, window=window)
    for method in CONFIG.methods:
        for name in ("depth_m", "confidence", "mask", "argmax"):
            want = getattr(expected.depth_maps[method], name)
            np.testing.assert_array_equal(getattr(filtered.depth_maps[method], name), want)
        # Without the filter they do harm: else this test would show nothing.
        harmed = unfiltered.depth_maps[method].confidence
        assert np.abs(harmed - expected.depth_maps[method].confidence).max() > 1


def test_a_run_says_what_it_dropped(tmp_path):
    config = CONFIG.model_copy(update={"hot_pixels": RATIO, "window_s": 0.2})
    noisy = with_hot(CLEAN, [(40, 20), (70, 50)])
    about = RecordingInfo(name="points", path="points")
    map_windows(noisy, tmp_path / "map", config, about, clouds=False)
    info = read_map(tmp_path / "map").info
    for camera in ("cam0", "cam1"):
        assert set(info.hot_pixels[camera].pixels) == {(40, 20), (70, 50)}
        assert info.hot_pixels[camera].events >= 20_000
    for window in info.windows:
        assert window.counts["cam0"]["events"] < len(CLEAN.streams[0])


@pytest.mark.parametrize("name", ["name", "depth_range_m", "rig", "trajectory"])
def test_everything_else_of_the_recording_stays(name):
    mask = np.zeros((64, 96), bool)
    filtered = WithoutPixels(CLEAN, [mask, mask])
    assert getattr(filtered, name) is getattr(CLEAN, name)
    assert filtered.event_span_us(1) == CLEAN.event_span_us(1)
    assert len(filtered.events(1, *SPAN)) == len(CLEAN.streams[1])
