"""Event-by-event stereo: kernels against twins, a world of few points, bad input."""

from dataclasses import replace

import numpy as np
import pytest

import naive_baselines as naive
from depth_maps import assert_same_bits
from eventsweep.emvs.baselines import gts
from eventsweep.emvs.baselines.gts import Stream, pairs, time_slopes
from eventsweep.emvs.config import Coincidence, GtsParameters, MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.reference_view import reference_view
from eventsweep.emvs.utils.runtime import use_threads
from eventsweep.emvs.windows import choose_window
from point_world import Recorded, fronto_parallel, looking_ahead
from refusals import refused

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25, border_px=0)


def mapped(recording, parameters=CONFIG.gts):
    window = choose_window(recording, CONFIG)
    view = reference_view(recording, CONFIG, window.t_ref_us)
    config = CONFIG.model_copy(update={"gts": parameters})
    return gts.estimate(recording, window, view, config)


def random_stream(seed, n=120):
    """Places in steps of a quarter, so that pairs lie exactly on the limits of what is allowed."""
    rng = np.random.default_rng(seed)
    uv_px, t_us = rng.integers(0, (120, 24), (n, 2)) / 4, np.sort(rng.integers(0, 4000, n))
    polarity = rng.integers(0, 2, n).astype(np.uint8)
    return Stream(uv_px, t_us, polarity, rng.uniform(800, 1200, (n, 2)))


@pytest.mark.parametrize("settings", [
    Coincidence(row_px=1.0, time_us=1000.0, motion=0.5, most_energy=4.0),
    Coincidence(row_px=1.0, time_us=1000.0, motion=0.5, most_energy=1.0),
    Coincidence(row_px=0.5, time_us=500.0, motion=1.0, most_energy=9.0),
])  # fmt: skip
def test_pairs_against_the_twin_choose_each_other(settings):
    left, right = random_stream(1, 400), random_stream(2, 400)
    i, j, energy = pairs(left, right, (1, 12), settings)
    to_right = naive.best_pairs(left, right, 1, 12, settings)
    to_left = naive.best_pairs(right, left, -12, -1, settings)
    expected = [(k, m) for k, m in enumerate(to_right) if m >= 0 and to_left[m] == k]
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == expected
    assert len(expected) > 5
    assert len(np.unique(j)) == len(j)
    assert (energy < settings.most_energy).all()


def test_events_without_motion_match_nothing():
    left, right = random_stream(1), random_stream(2)
    still = Stream(left.uv_px, left.t_us, left.p, np.full((120, 2), np.nan))
    assert len(pairs(still, right, (1, 12), Coincidence())[0]) == 0


@pytest.mark.parametrize("slope", [(500.0, 0.0), (300.0, 400.0), (-200.0, 100.0)])
def test_an_edge_that_moves_evenly_has_the_slope_of_its_plane(slope):
    v, u = np.mgrid[0:9, 0:9].reshape(2, -1)
    t_us = np.rint(u * slope[0] + v * slope[1] + 5000).astype(np.int64)
    order = np.argsort(t_us, kind="stable")
    pixels = np.column_stack([u, v])[order]
    found = time_slopes(pixels, t_us[order], np.zeros(81, np.uint8), (9, 9), 2, 10**6)
    known = np.isfinite(found).all(axis=1)
    assert known.sum() > 40
    np.testing.assert_allclose(found[known], np.tile(slope, (known.sum(), 1)), atol=1.0)


def test_old_neighbours_and_the_other_polarity_tell_no_motion():
    v, u = np.mgrid[0:5, 0:5].reshape(2, -1)
    pixels, t_us = np.column_stack([u, v]), np.arange(25) * 1000
    assert np.isnan(time_slopes(pixels, t_us, np.zeros(25, np.uint8), (5, 5), 2, 2000)).all()
    mixed = (np.arange(25) % 5 == 0).astype(np.uint8)
    assert np.isnan(time_slopes(pixels, t_us, mixed, (5, 5), 2, 10**6)[mixed == 1]).all()


def edge_world(depth_m, f=80.0, speed_m_s=0.8):
    """One upright edge before a moving rig: no other event to be taken for its partner."""
    recording = fronto_parallel(depth_m)
    camera = recording.rig.cameras[0]
    streams = []
    for T in recording.rig.T_body_cam:
        u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        x_m = (u - camera.cx_px) / f * depth_m
        t_us = np.rint((0.25 - (x_m + T[0, 3]) / speed_m_s) * 1e6).astype(np.int64).ravel()
        inside = np.flatnonzero((t_us >= 0) & (t_us < 500_000))
        inside = inside[np.argsort(t_us[inside], kind="stable")]
        streams.append(Events(
            u.ravel()[inside].astype(np.uint16), v.ravel()[inside].astype(np.uint16), t_us[inside],
            np.ones(len(inside), np.uint8),
        ))  # fmt: skip
    return Recorded(recording.rig, recording.trajectory, tuple(streams))


@pytest.mark.parametrize("disparity_px", [4.0, 6.0, 8.0])
def test_a_lone_edge_is_triangulated_exactly(disparity_px):
    """At the reference time it fills one column; so slow an edge needs a long memory."""
    found = mapped(edge_world(8 / disparity_px), GtsParameters(memory_s=0.2))
    assert found.points > 50
    np.testing.assert_allclose(8 / found.depth_m[found.mask], disparity_px, atol=1e-3)


def test_one_thread_and_two_give_the_same_bits():
    maps = []
    for threads in (1, 2):
        use_threads(threads)
        maps.append(mapped(edge_world(1.0), GtsParameters(memory_s=0.2)))
    use_threads(0)
    assert_same_bits(*maps)


# Bad input


def of_two_clocks():
    recording = edge_world(1.0)
    left, right = recording.streams
    return replace(recording, streams=(left, replace(right, t_us=right.t_us // 1000)))


@pytest.mark.parametrize(("recording", "words", "settings"), [
    (edge_world(1.0), "no events match", GtsParameters(memory_s=0.002)),
    (of_two_clocks(), r"no events match among the \d+ and \d+ events", GtsParameters()),
    (fronto_parallel(1.3, cameras=1), "stereo matching needs 2", GtsParameters()),
    (looking_ahead(1.3), r"cannot be rectified.*90\.0 degrees", GtsParameters()),
])  # fmt: skip
def test_what_cannot_be_matched_is_refused(recording, words, settings):
    refused(words, mapped, recording, settings)
