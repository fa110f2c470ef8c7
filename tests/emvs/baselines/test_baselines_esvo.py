"""ESVO's mapping: kernels against twins, the algebra of its distributions, known planes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive_baselines as naive
from eventsweep.emvs.baselines import esvo
from eventsweep.emvs.baselines.esvo import (
    Estimates,
    EsvoMap,
    Lines,
    Refined,
    fuse_into,
    match_blocks,
    propagate,
    refine,
    regularised,
)
from eventsweep.emvs.baselines.esvo_kernels import compatible, fuse_two
from eventsweep.emvs.config import (
    CleanUp,
    EsvoParameters,
    MapperConfig,
    Matching,
    Refinement,
    Regularisation,
)
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.reference_view import reference_view
from eventsweep.emvs.utils.runtime import use_threads
from eventsweep.emvs.windows import choose_window
from made_events import part_of
from point_world import fronto_parallel, looking_ahead
from refusals import refused

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25, border_px=0)
RHO = st.floats(0.1, 5.0)
SCALE = st.floats(1e-3, 0.5)


def mapped(recording, function=esvo.estimate_window, config=CONFIG):
    window = choose_window(recording, config)
    view = reference_view(recording, config, window.t_ref_us)
    return function(recording, window, view, config)


def waves(height=50, width=120, shift_px=0.0, seed=0):
    """A smooth surface of 0..255, moved to the left."""
    x, y = np.meshgrid(np.arange(width) + shift_px, np.arange(height))
    rng = np.random.default_rng(seed)
    total = np.zeros((height, width))
    for _ in range(8):
        a, b, c = [*rng.uniform(-0.35, 0.35, 2).tolist(), rng.uniform(0, 6)]
        total += np.cos(a * x + b * y + c)
    return (127 + 15 * total).astype(np.float32)


def lines(n, focal_px=80.0, baseline_m=0.1):
    rng = np.random.default_rng(1)
    uv_px = rng.uniform((40, 15), (90, 35), (n, 2))
    bearing = (uv_px - (60, 25)) / focal_px
    return Lines(np.column_stack([bearing, np.ones(n)]), np.zeros((n, 3)), focal_px, (60.0, 25.0),
                 baseline_m)  # fmt: skip


# Matching


def test_blocks_against_the_twin():
    rng = np.random.default_rng(3)
    left, right = waves(), waves(seed=4) + waves(shift_px=9)
    pixels = rng.integers((40, 8), (100, 42), (40, 2))
    settings = Matching(coarse_px=1, least_zncc=-1)
    found, score = match_blocks(left, right, pixels, (2, 20), settings)
    for (u, v), disparity, value in zip(pixels.tolist(), found, score, strict=True):
        known = [naive.zncc(left, right, u, v, d, (7, 3)) for d in range(1, 22)]
        assert value == pytest.approx(max(known), abs=1e-4)
        at_the_end = int(np.argmax(known)) in (0, 20)
        assert np.isnan(disparity) == at_the_end
        assert at_the_end or disparity == 1 + np.argmax(known)


def test_a_moved_surface_is_matched_coarse_to_fine():
    pixels = np.argwhere(np.ones((40, 60)))[::50, ::-1] + (45, 5)
    found, score = match_blocks(waves(), waves(shift_px=7), pixels, (2, 20), Matching())
    assert (found == 7).mean() > 0.95
    assert score.max() > 0.99


def test_flat_surfaces_and_rims_match_nothing():
    flat = np.full((50, 120), 80, np.float32)
    assert np.isnan(match_blocks(flat, flat, np.array([[60, 25]]), (2, 20), Matching())[0]).all()
    rim = np.array([[0, 0], [119, 49], [60, 1]])
    assert np.isnan(match_blocks(waves(), waves(), rim, (2, 20), Matching())[0]).all()


# Refinement


def test_refinement_finds_a_fraction_of_a_pixel():
    start = np.full(50, 7 / 8.0)
    refined = refine(waves(), waves(shift_px=7.4), lines(50), start, Refinement())
    error_px = np.abs(refined.rho * 8 - 7.4)
    assert np.isfinite(error_px).all()
    assert error_px.max() < 0.05
    assert refined.spread.max() < 2


def test_scale_and_spread_against_the_twin():
    """The derivative of the weighted residuals, here by differences; their scale, by iteration."""
    left, right, found = waves(), waves(shift_px=7.4) + waves(seed=9) * 0.1, lines(10)
    camera, settings = (80.0, 60.0, 25.0, 0.1), Refinement()
    refined = refine(left, right, found, np.full(10, 7 / 8.0), settings)
    for k in range(10):

        def residuals(rho, k=k):
            return naive.residuals(left, right, found.a[k], found.b[k], camera, rho, (7, 3))

        spread = naive.spread(residuals(refined.rho[k]), settings.dof, settings.scale)
        assert refined.spread[k] == pytest.approx(spread, rel=0.1)
        low, high = (
            naive.weighted(residuals(refined.rho[k] + step), settings.dof, refined.spread[k])
            for step in (-1e-6, 1e-6)
        )
        scale = settings.scale / np.linalg.norm((high - low) / 2e-6)
        assert refined.scale[k] == pytest.approx(scale, rel=0.02)


def test_a_patch_that_fits_badly_has_a_wide_spread():
    clean, left = waves(shift_px=7.4), waves()
    spoilt = clean.copy()
    spoilt[::3, ::4] = 0
    one, other = (
        refine(left, right, lines(50), np.full(50, 7 / 8.0), Refinement())
        for right in (clean, spoilt)
    )
    assert (other.spread > 2 * one.spread).all()


def test_refinement_lowers_the_twins_cost():
    left, right, found = waves(), waves(shift_px=7.4) + waves(seed=9) * 0.1, lines(10)
    camera, start = (80.0, 60.0, 25.0, 0.1), np.full(10, 7 / 8.0)
    refined = refine(left, right, found, start, Refinement())
    for k in range(10):
        values = [
            naive.cost(left, right, found.a[k], found.b[k], camera, rho, (7, 3), 2.182, 17.277)
            for rho in (start[k], refined.rho[k], refined.rho[k] - 0.01, refined.rho[k] + 0.01)
        ]
        assert values[1] < values[0]
        assert values[1] < min(values[2:])


def test_patches_outside_the_picture_are_left_out():
    refined = refine(waves(), waves(), lines(3), np.array([50.0, 20.0, -30.0]), Refinement())
    assert np.isnan(refined.rho).all()


# Student t


@given(RHO, SCALE, st.floats(2.1, 30))
def test_fusing_equal_estimates_shrinks_the_scale(rho, scale, dof):
    mean, fused, more = fuse_two(rho, scale, dof, rho, scale, dof)
    assert mean == pytest.approx(rho)
    assert fused < scale / np.sqrt(2)
    assert more == dof + 1


@given(RHO, SCALE, RHO, SCALE, st.floats(2.1, 30))
def test_fusion_is_symmetric_and_lies_between(rho_a, scale_a, rho_b, scale_b, dof):
    one = fuse_two(rho_a, scale_a, dof, rho_b, scale_b, dof)
    np.testing.assert_allclose(one, fuse_two(rho_b, scale_b, dof, rho_a, scale_a, dof))
    assert min(rho_a, rho_b) - 1e-9 <= one[0] <= max(rho_a, rho_b) + 1e-9
    assert compatible(rho_a, scale_a, rho_b, scale_b) == compatible(rho_b, scale_b, rho_a, scale_a)


def fused(known, rho, scale, spread):
    points = np.array([[2.0, 1.0]]), np.array([rho]), np.array([scale]), np.array([spread])
    return fuse_into(known, *points, 3.0)


def test_of_estimates_that_contradict_the_surer_and_better_one_stays():
    empty = Estimates.empty(4, 5)
    known = fused(empty, 1.0, 0.01, 5.0)
    assert not empty.count.any()
    for scale, spread in ((0.02, 1.0), (0.001, 9.0)):
        vague = fused(known, 2.0, scale, spread)
        assert (vague.rho[1, 2], vague.count[1, 2], vague.spread[1, 2]) == (1.0, 1, 5.0)
    sure = fused(known, 2.0, 0.001, 1.0)
    assert (sure.rho[1, 2], sure.count[1, 2], sure.spread[1, 2]) == (2.0, 1, 1.0)


def test_what_lies_behind_is_left_out_however_sure():
    known = fused(Estimates.empty(4, 5), 2.0, 0.05, 5.0)
    hidden = fused(known, 1.0, 0.001, 1.0)
    assert (hidden.rho[1, 2], hidden.count[1, 2]) == (2.0, 1)


def test_estimates_that_agree_are_counted_and_keep_the_better_fit():
    twice = fused(fused(Estimates.empty(4, 5), 1.0, 0.05, 5.0), 1.02, 0.05, 3.0)
    assert (twice.count[1, 2], twice.spread[1, 2]) == (2, 3.0)
    assert twice.rho[1, 2] == pytest.approx(1.01)
    assert twice.scale[1, 2] < 0.05


@pytest.mark.parametrize(("u", "columns"), [(-0.5, [0]), (0.0, [0, 1]), (3.5, [3, 4]), (4.5, [4])])
@pytest.mark.parametrize(("v", "rows"), [(-0.5, [0]), (0.0, [0, 1]), (2.5, [2, 3]), (3.5, [3])])
def test_a_point_fills_those_pixels_around_it_that_are_in_the_image(u, columns, v, rows):
    point = (np.array([[u, v]]), np.array([1.0]), np.array([0.01]), np.array([5.0]))
    found = fuse_into(Estimates.empty(4, 5), *point, 3.0)
    filled = np.zeros((4, 5), int)
    filled[np.ix_(rows, columns)] = 1
    np.testing.assert_array_equal(found.count, filled)


def test_propagation_is_the_geometry_and_its_derivative():
    rays, origin = np.array([[0.1, -0.2, 0.9]]), np.array([[0.05, 0.1, 0.3]])
    rho, scale, step = np.array([0.7]), np.array([0.02]), 1e-6
    bearing, new, wide = propagate(rays, origin, rho, scale)
    point = rays / rho + origin
    np.testing.assert_allclose(bearing, point[:, :2] / point[:, 2:])
    np.testing.assert_allclose(new, 1 / point[:, 2])
    moved = propagate(rays, origin, rho + step, scale)[1]
    np.testing.assert_allclose(wide, 0.02 * (moved - new) / step, rtol=1e-4)


# Regularisation


def test_regularisation_against_the_twin():
    rng = np.random.default_rng(5)
    rho = np.where(rng.random((20, 30)) < 0.4, rng.choice([1.0, 2.0], (20, 30)), np.nan)
    rho += 0.02 * rng.standard_normal(rho.shape)
    scale = rng.uniform(0.01, 0.03, rho.shape)
    count = np.isfinite(rho).astype(np.int64)
    known = Estimates(rho, scale, np.full(rho.shape, 4.0), count, np.zeros(rho.shape))
    smoothed = Regularisation(radius_px=5, least_neighbours=8)
    found = regularised(known, CleanUp(least_fusions=0), smoothed, 1.0)
    expected = naive.smooth(rho, known.deviation, 5, 8)
    np.testing.assert_allclose(found, expected)
    assert 0 < np.isfinite(found).sum() < count.sum()


def test_clean_up_asks_for_a_second_estimate_and_for_a_small_deviation():
    rho = np.array([[1.0, 2.0, 3.0, np.nan]])
    scale, dof = np.array([[0.01, 0.01, 0.5, 0.01]]), np.full((1, 4), 4.0)
    known = Estimates(rho, scale, dof, np.array([[2, 1, 2, 0]]), np.zeros((1, 4)))
    found = regularised(known, CleanUp(least_fusions=1), Regularisation(), 0.1)
    np.testing.assert_array_equal(found, [[1.0, np.nan, np.nan, np.nan]])


# Through a recording


@pytest.mark.parametrize("depth_m", [0.8, 1.3, 2.5])
@pytest.mark.parametrize("function", [esvo.estimate, esvo.estimate_window])
def test_a_fronto_parallel_plane_is_found_to_a_seventh_of_a_pixel(depth_m, function):
    found = mapped(fronto_parallel(depth_m, points=3000), function)
    errors_px = np.abs(8 / found.depth_m[found.mask] - 8 / depth_m)
    assert found.points > 1000
    assert np.median(errors_px) < 0.15
    assert (errors_px < 1).mean() > 0.98


@pytest.mark.parametrize("function", [esvo.estimate, esvo.estimate_window])
def test_one_thread_and_two_give_the_same_bits(function):
    recording, maps = fronto_parallel(1.3, points=600), []
    for threads in (1, 2):
        use_threads(threads)
        maps.append(mapped(recording, function))
    use_threads(0)
    for field in ("depth_m", "confidence", "mask", "argmax"):
        np.testing.assert_array_equal(getattr(maps[0], field), getattr(maps[1], field))


def test_own_rate_fuses_the_newest_whole_maps():
    maps = [EsvoMap(0, *(np.empty(0),) * 3, Refined(np.ones(n), *(np.empty(0),) * 2))
            for n in (5, 3, 4, 2)]  # fmt: skip
    counts = {most: len(esvo._newest(maps, most)) for most in (1, 2, 5, 6, 9, 100)}
    assert counts == {1: 1, 2: 1, 5: 1, 6: 2, 9: 3, 100: 4}
    assert esvo._newest(maps, 6)[0] is maps[2]


def test_what_comes_after_the_reference_time_does_not_touch_own_rate():
    recording = fronto_parallel(1.3, points=600)
    window = choose_window(recording, CONFIG)
    later = fronto_parallel(0.7, points=600, seed=1)
    spliced = tuple(
        Events.concat([s.between(0, window.t_ref_us), o.between(window.t_ref_us, 500_001)])
        for s, o in zip(recording.streams, later.streams, strict=True)
    )
    both = [mapped(r, esvo.estimate)
            for r in (recording, replace(recording, streams=spliced))]  # fmt: skip
    np.testing.assert_array_equal(both[0].depth_m, both[1].depth_m)


def test_settings_of_the_configuration_reach_the_mapping():
    recording = fronto_parallel(1.3, points=600)
    lax = CONFIG.model_copy(update={"esvo": EsvoParameters(clean_up=CleanUp(least_fusions=0))})
    strict = CONFIG.model_copy(update={"esvo": EsvoParameters(clean_up=CleanUp(least_fusions=3))})
    points = [mapped(recording, config=config).points for config in (lax, CONFIG, strict)]
    assert points[0] > points[1] > points[2] > 0


# Bad input


def of_few_events():
    recording = fronto_parallel(1.3)
    few = tuple(part_of(stream, slice(None, None, 400)) for stream in recording.streams)
    return replace(recording, streams=few)


@pytest.mark.parametrize(("recording", "words"), [
    (of_few_events(), r"0 estimates from 9 maps up to \d+ µs, but no pixel where 2"),
    (fronto_parallel(1.3, cameras=1), "stereo matching needs 2"),
    (looking_ahead(1.3), r"cannot be rectified.*90\.0 degrees"),
])  # fmt: skip
def test_what_cannot_be_mapped_is_refused(recording, words):
    refused(words, mapped, recording)
