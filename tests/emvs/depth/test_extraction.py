"""Extraction by focus: kernels equal their twins, and depth obeys its laws."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import naive_extraction as naive
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth import neighbours_kernels
from eventsweep.emvs.depth.focus import (
    FocusEstimate,
    between_the_ends,
    disparity_at,
    estimate_in_focus,
    on_surface,
    surface_scatter_px,
)
from eventsweep.emvs.dsi import focus_measures
from eventsweep.emvs.dsi.focus_kernels import BLOCK, PAIR
from eventsweep.emvs.dsi.maxima import FocusPeak, InFocus, Maximum
from eventsweep.emvs.utils.runtime import in_threads
from volumes import found_in_volumes, judge, maximum_of

F = np.float32
TWINS = {
    "votes": lambda plane, _: plane, "variance": naive.variance, "mean-square": naive.mean_square,
    "gradient": naive.gradient, "laplacian": naive.laplacian, "dog": naive.difference_of_gaussians,
}  # fmt: skip


def falling(volume):
    """Disparities of a volume's planes, px: 0.3 from one to the next."""
    return 16 - 0.3 * np.arange(len(volume))


def find(fused, votes, measure="variance"):
    """Depth by focus in whole volumes."""
    return found_in_volumes(fused, votes, falling(fused), measure)


def random_planes(seed, *shape):
    return np.random.default_rng(seed).gamma(0.5, 10, shape).astype(F)


def test_every_measure_has_a_twin():
    assert set(TWINS) == set(focus_measures.MEASURES)


@pytest.mark.parametrize("name", focus_measures.MEASURES)
def test_measure_equals_twin(name):
    plane = random_planes(1, 9, 13)
    slow = TWINS[name](plane, 1.3)
    np.testing.assert_allclose(
        focus_measures.MEASURES[name](plane, 1.3), slow, atol=2e-4 * abs(slow).max()
    )


@pytest.mark.parametrize("name", ["variance", "gradient", "laplacian", "dog"])
def test_even_votes_are_nowhere_in_focus(name):
    even = np.full((20, 30), 37.5, F)
    np.testing.assert_allclose(focus_measures.MEASURES[name](even, 2.5), 0, atol=1e-2)


@pytest.mark.parametrize(("name", "power"), [("variance", 2), ("gradient", 2), ("dog", 1)])
def test_more_votes_scale_the_measure(name, power):
    plane, measure = random_planes(2, 20, 30), focus_measures.MEASURES[name]
    np.testing.assert_array_equal(measure(4 * plane, 2.0), F(4**power) * measure(plane, 2.0))


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(2, 40))
def test_peak_equals_twin(seed, planes, levels):
    volume = np.random.default_rng(seed).integers(0, levels, (planes, 4, 5)).astype(F)
    volume -= 3  # a difference of Gaussians is below 0, too
    peak = FocusPeak(5, 4, "votes", 1.0)
    peak.update(volume)
    found = peak.maximum()
    for y, x in np.ndindex(volume.shape[1:]):
        value, plane, before, after = naive.peak(volume[:, y, x].tolist())
        assert (found.value[y, x], found.plane[y, x]) == (value, plane)
        assert before is None or found.left[y, x] == before
        assert after is None or found.right[y, x] == after


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.sampled_from([0.5, 2.0, 9.0]))
def test_support_equals_twin(seed, radius, tolerance):
    rng = np.random.default_rng(seed)
    position, candidate = rng.uniform(0, 10, (7, 9)).astype(F), rng.random((7, 9)) < 0.4
    out = np.zeros((7, 9), F)
    listed = neighbours_kernels.listed(position, candidate)
    in_threads(neighbours_kernels.support, 7, *listed, radius, F(tolerance), out)
    slow = naive.support(position, candidate, radius, tolerance)
    np.testing.assert_allclose(out, slow, atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.sampled_from([0.5, 2.0, 9.0]))
def test_own_surface_equals_twin(seed, radius, tolerance):
    rng = np.random.default_rng(seed)
    disparity, candidate = rng.uniform(0, 10, (7, 9)).astype(F), rng.random((7, 9)) < 0.4
    out = np.zeros((2, 7, 9), F)
    listed = neighbours_kernels.listed(disparity, candidate)
    in_threads(neighbours_kernels.own_surface, 7, *listed, radius, F(tolerance), out)
    slow = naive.own_surface(disparity, candidate, radius, tolerance)
    np.testing.assert_allclose(out, slow, atol=1e-5)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4), st.sampled_from([0.5, 2.0, 9.0]))
def test_fitted_surface_equals_twin(seed, radius, tolerance):
    rng = np.random.default_rng(seed)
    disparity, candidate = rng.uniform(0, 10, (7, 9)).astype(F), rng.random((7, 9)) < 0.4
    weight = np.exp(-0.1 * np.arange(radius + 1)).astype(F)
    out = np.full((7, 9), -1, F)
    listed = neighbours_kernels.listed(disparity, candidate)
    in_threads(neighbours_kernels.fit_surface, 7, *listed, weight, F(tolerance), 0.5, out)
    slow = naive.fitted_surface(disparity, candidate, weight, tolerance, 0.5)
    np.testing.assert_allclose(out[candidate], slow[candidate], atol=1e-4)
    assert (out[~candidate] == -1).all()


def test_scatter_around_a_surface_equals_its_twin():
    rng = np.random.default_rng(4)
    own_px, candidate = rng.uniform(1, 9, (20, 24)).astype(F), rng.random((20, 24)) < 0.3
    fitted_px = own_px + rng.normal(0, 0.2, own_px.shape).astype(F)
    found = surface_scatter_px(own_px, fitted_px, candidate)
    reach = 6  # 1.5 scales of 4 px
    near = np.exp(-0.5 * (np.arange(-reach, reach + 1) / 4) ** 2)
    weight = np.outer(near, near)
    apart, there = (np.pad(a, reach, mode="reflect") for a in (abs(fitted_px - own_px), candidate))
    for y, x in np.ndindex(own_px.shape):
        window = slice(y, y + 2 * reach + 1), slice(x, x + 2 * reach + 1)
        w = weight * there[window]
        slow = (w * apart[window]).sum() / w.sum() if candidate[y, x] else 0
        assert found[y, x] == pytest.approx(slow, rel=1e-4)


def surface(disparity_px, planes_px):
    """What was found where every pixel of this disparity is a candidate."""
    ones = np.ones_like(disparity_px)
    position = np.interp(-disparity_px, -planes_px, np.arange(len(planes_px))).astype(F)
    return FocusEstimate(position, ones, ones > 0, *(ones,) * 5)


def test_a_slanted_surface_stays_and_its_noise_goes():
    """A plane in space is linear in disparity; a step in depth takes no part across."""
    planes_px, noise = 16 - 0.3 * np.arange(41), np.random.default_rng(1).normal(0, 0.1, (30, 40))
    x, y = np.arange(40.0), np.arange(30.0)[:, None]
    exact = (8 + 0.02 * x - 0.03 * y + 3 * (x > 20)).astype(F)
    here = surface(exact, planes_px)
    kept = on_surface(here, planes_px)
    np.testing.assert_allclose(kept.position, here.position, atol=0.06)
    noisy = on_surface(surface((exact + noise).astype(F), planes_px), planes_px)
    off_px = 0.3 * abs(noisy.position - here.position)
    assert np.median(off_px) < 0.3 * np.median(abs(noise))
    turned = on_surface(replace(here, position=40 - here.position), planes_px[::-1])
    np.testing.assert_allclose(40 - turned.position, kept.position, atol=1e-3)


@pytest.mark.parametrize("at", [3.0, 3.2, 3.49, 2.6])
def test_a_bell_is_found_where_it_is(at):
    """The vertex through a Gaussian's three values is exact; a parabola's is not."""
    left, value, right = (np.full((1, 1), np.exp(-((k - at) ** 2)), F) for k in (2, 3, 4))
    maximum = Maximum(value, np.full((1, 1), 3, np.int16), left, right, 9)
    np.testing.assert_allclose(maximum.position(gaussian=True), at, atol=1e-5)
    assert at == 3 or abs(maximum.position()[0, 0] - at) > 1e-2
    dark = Maximum(value, maximum.plane, np.zeros_like(left), right, 9)
    np.testing.assert_array_equal(dark.position(gaussian=True), dark.position())


def filtered_variance(plane, sigma_px):
    """By scipy's filters, of votes about their mean, to which variance does not look."""
    centred = plane.astype(np.float64) - plane.mean()
    half = focus_measures.half_window(sigma_px).astype(np.float64)
    window = np.concatenate([half[:0:-1], half])

    def mean(values):
        down = ndimage.correlate1d(values, window, axis=0, mode="mirror")
        return ndimage.correlate1d(down, window, axis=1, mode="mirror")

    return mean(centred**2) - mean(centred) ** 2


@settings(max_examples=8)
@given(
    seed=st.integers(0, 2**32 - 1),
    height=st.sampled_from([1, 2, 7, BLOCK, 2 * BLOCK + 3]),
    width=st.sampled_from([5, PAIR, PAIR + 1, 3 * PAIR - 1]),
    sigma_px=st.sampled_from([0.4, 1.3, 2.5]),
)
def test_the_compiled_variance_equals_the_measure_and_its_twin(seed, height, width, sigma_px):
    """Also where the window is higher than the image, and where columns fill no vector."""
    planes = random_planes(seed, 4, height, width)
    compiled = FocusPeak(width, height, "variance", sigma_px)
    for batch in np.split(planes, [seed % 5, 3]):
        compiled.update(batch)
    slow = np.array([filtered_variance(plane, sigma_px) for plane in planes])
    np.testing.assert_allclose(compiled.maximum().value, slow.max(0), atol=2e-4 * slow.max() + 1e-6)
    chosen = np.take_along_axis(slow, compiled.maximum().plane[None].astype(int), 0)[0]
    np.testing.assert_allclose(chosen, slow.max(0), atol=2e-4 * slow.max() + 1e-6)


@pytest.mark.parametrize("sigma_px", [2.5, 9.0])
def test_a_window_wider_than_the_image_is_mirrored_again(sigma_px):
    planes = random_planes(11, 2, BLOCK + 1, PAIR + 3)
    compiled = FocusPeak(PAIR + 3, BLOCK + 1, "variance", sigma_px)
    compiled.update(planes)
    slow = np.max([filtered_variance(plane, sigma_px) for plane in planes], axis=0)
    np.testing.assert_allclose(compiled.maximum().value, slow, atol=2e-4 * slow.max())


def test_planes_that_lie_apart_are_the_same_planes():
    """Votes of a camera lie with its dump behind each plane; a view turned round is copied."""
    planes, found = random_planes(12, 6, 20, 2 * PAIR), []
    wide = np.full((6, 22, 2 * PAIR), np.nan, F)
    wide[:, :20] = planes
    for same in (planes, wide[:, :20], planes[::-1].copy()[::-1]):
        peak = FocusPeak(2 * PAIR, 20, "variance", 1.3)
        peak.update(same)
        found.append(peak.maximum().value)
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])


@pytest.mark.parametrize("measure", ["variance", "gradient"])
def test_positions_at_pixels_are_those_of_the_image(measure):
    peak = FocusPeak(13, 9, measure, 1.3)
    peak.update(random_planes(3, 7, 9, 13))
    found, (rows, columns) = peak.maximum(), np.indices((9, 13)).reshape(2, -1)
    whole = found.position(gaussian=True)
    assert (whole % 1 > 0).any()
    at = found.position_at(rows, columns, gaussian=True)
    np.testing.assert_array_equal(at, whole.ravel())
    planes = found.position_at(rows, columns, refined=False)
    assert np.abs(planes - at).max() <= 0.5


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_disparity_between_planes_is_linear_and_ends_with_them(seed, planes):
    rng = np.random.default_rng(seed)
    at, disparity_px = rng.uniform(-2, planes + 2, 40).astype(F), rng.uniform(0, 30, planes)
    slow = np.interp(at, np.arange(planes), disparity_px)
    np.testing.assert_allclose(disparity_at(at, disparity_px), slow, atol=2e-5)


@pytest.mark.parametrize("refine", [True, False])
def test_candidates_are_judged_as_if_every_pixel_were(refine):
    """Law: to leave out what is no candidate changes nothing for those that are."""
    volume, disparity_px = random_planes(6, 9, 30, 40), 16 - 0.3 * np.arange(9)
    config = MapperConfig(interpolate=refine)
    votes = maximum_of(volume)
    focus = InFocus(maximum_of(volume[:, ::-1].copy()), (maximum_of(volume[::-1].copy()),))
    found = estimate_in_focus(votes, focus, disparity_px, config)
    gaussian = [m.position(gaussian=True) if refine else m.plane.astype(F)
                for m in (focus.maximum, *focus.camera_maxima)]  # fmt: skip
    peak = votes.position() if refine else votes.plane.astype(F)
    inside = between_the_ends(focus.maximum)
    assert 0 < inside.mean() < 1
    whole = judge(votes.value, peak, gaussian[0], gaussian[1:], disparity_px, inside)
    whole = on_surface(whole, disparity_px) if refine else whole
    assert 20 < found.candidate.sum() < found.candidate.size / 2
    np.testing.assert_array_equal(found.position, whole.position)
    np.testing.assert_array_equal(found.reliability, whole.reliability)
    assert found.reliability.any()


def slanted_line(planes=41, at_plane=20, at_px=24.4, slant_px=0.35):
    """Votes of a vertical line seen by a camera to one side: sharp in its plane, moving past it."""
    k = np.arange(planes)[:, None, None] - at_plane
    x = np.arange(49)[None, None, :]
    width_px = np.hypot(0.6, 0.25 * k)
    blob = np.exp(-0.5 * ((x - at_px - slant_px * k) / width_px) ** 2) / width_px
    return np.repeat(100 * blob, 33, axis=1).astype(F)


def test_variance_finds_the_plane_beside_the_line_where_the_ray_maximum_slides_off():
    volume = slanted_line()
    beside = (16, slice(23, 27))
    focused = find(volume, volume[None]).position[beside]
    plain = find(volume, volume[None], "votes").position[beside]
    assert abs(plain - 20).max() > 1.0
    assert abs(focused - 20).max() < 0.5 * abs(plain - 20).max()


def test_order_of_cameras_changes_nothing():
    votes = random_planes(4, 2, 9, 20, 25)
    one, other = (find(votes.min(0), v) for v in (votes, votes[::-1]))
    np.testing.assert_array_equal(one.reliability, other.reliability)
    np.testing.assert_array_equal(one.position, other.position)


def test_cameras_that_agree_are_trusted_and_others_are_not():
    here, there = slanted_line(at_plane=20), slanted_line(at_plane=30)
    alike = find(here, np.stack([here, here]))
    apart = find(here, np.stack([here, there]))
    np.testing.assert_array_equal(alike.agreement, 1)
    assert apart.agreement[16, 24] < 1e-2
    assert (apart.reliability <= alike.reliability).all()


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_reliability_is_a_share_and_only_candidates_have_one(seed):
    votes = random_planes(seed, 2, 6, 20, 25)
    found = find(votes.min(0), votes)
    assert ((found.reliability >= 0) & (found.reliability <= 1)).all()
    assert not found.reliability[~found.candidate].any()
    assert ((found.position >= 0) & (found.position <= 5)).all()


def test_no_votes_no_candidates():
    empty = np.zeros((5, 12, 14), F)
    assert not find(empty, empty[None]).candidate.any()


def test_inputs_stay_as_they_are():
    votes = random_planes(5, 2, 6, 20, 25)
    fused, kept = votes.min(0), votes.copy()
    find(fused, votes)
    np.testing.assert_array_equal(votes, kept)
    np.testing.assert_array_equal(fused, kept.min(0))
