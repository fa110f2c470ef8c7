"""Focus methods and focus measures in the mapper: streaming, names, any rig, and their laws."""

import itertools
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from depth_maps import assert_same_bits, mapper, steps_off
from eventsweep.emvs.config import FocusParameters, MapperConfig
from eventsweep.emvs.depth.focus import AGREEMENT_PX, at_least
from eventsweep.emvs.dsi import focus_measures
from eventsweep.emvs.dsi.maxima import RunningMaxima
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import methods_by_name, overview
from eventsweep.emvs.reference_view import inverse_depth_at
from point_world import fronto_parallel, with_cameras
from refusals import refused
from volumes import found_in_volumes, judge

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25)
mapped = mapper(CONFIG)
F = np.float32


@pytest.mark.parametrize("fusion", ["H", "A"])
def test_streaming_equals_whole_volumes(tmp_path, fusion):
    """Law: the sweep, which keeps no volume, finds what is found in whole volumes."""
    recording = fronto_parallel(1.5)
    names = (f"Focus/{fusion}", "EMVS/cam0", "EMVS/cam1")
    config = CONFIG.model_copy(update={"methods": names, "save_dsi": True})
    result = map_window(recording, config, dsi_dir=tmp_path)
    votes = np.stack([np.load(tmp_path / f"EMVS-cam{k}.npy") for k in (0, 1)])
    rho, camera = result.view.rho, recording.rig.cameras[0]
    disparity_px = 0.1 * camera.fx_px * rho.astype(np.float64)
    fused = np.load(tmp_path / f"Focus-{fusion}.npy")
    found = found_in_volumes(fused, votes, disparity_px)
    depth = result.depth_maps[f"Focus/{fusion}"]
    np.testing.assert_array_equal(depth.confidence, found.confidence)
    np.testing.assert_allclose(1 / depth.depth_m, inverse_depth_at(rho, found.position), rtol=1e-5)
    expected = at_least(found, config.focus.reliability, config.border_px)
    assert expected.sum() > 100
    assert (depth.mask != expected).mean() < 1e-3


@pytest.mark.parametrize("depth_m", [0.8, 1.23, 2.1])
def test_a_fronto_parallel_plane_is_recovered(depth_m):
    """By fusion, by one camera, and over sub-intervals, within half a plane."""
    names = ("Focus/H", "Focus/min", "Focus/cam1", "Focus/HcAt@2", "Focus/AtHc@2")
    result = mapped(fronto_parallel(depth_m), *names)
    for name in names:
        assert steps_off(result, name, depth_m) < 0.5, name


def test_one_interval_is_the_window_to_the_bit():
    result = mapped(fronto_parallel(1.5), "Focus/H", "Focus/AtHc@1", "Focus/HcAt@1")
    for name in ("Focus/AtHc@1", "Focus/HcAt@1"):
        assert_same_bits(result.depth_maps[name], result.depth_maps["Focus/H"])


def test_threads_company_and_repetition_do_not_change_a_bit():
    recording = fronto_parallel(1.5)
    alone = mapped(recording, "Focus/H", threads=1).depth_maps["Focus/H"]
    for threads in (1, 2):
        result = mapped(recording, "Focus/A", "Focus/AtHc@2", "all", threads=threads)
        assert_same_bits(result.depth_maps["Focus/H"], alone)


def test_order_of_cameras_changes_nothing_but_rounding():
    """Camera 1 and 2 of three change places; the reference view stays camera 0's."""
    recording = fronto_parallel(1.5, cameras=3)
    one = mapped(recording, "Focus/A").depth_maps["Focus/A"]
    other = mapped(with_cameras(recording, (0, 2, 1)), "Focus/A").depth_maps["Focus/A"]
    assert (one.argmax == other.argmax).mean() > 0.999


@pytest.mark.parametrize("cameras", [1, 2, 3])
def test_any_number_of_cameras(cameras):
    name = "Focus/cam0" if cameras == 1 else "Focus/H"
    assert steps_off(mapped(fronto_parallel(1.23, cameras=cameras), name), name, 1.23) < 0.5


def test_polarities_apart_are_one_camera_still():
    """A camera's own votes are those of both polarities: its focus does not change."""
    recording = fronto_parallel(1.5)
    both, apart = (mapped(recording, "Focus/cam0", polarity=p) for p in ("both", "separate"))
    a, b = (result.depth_maps["Focus/cam0"] for result in (both, apart))
    assert (a.argmax == b.argmax).mean() > 0.99


def test_one_camera_at_rest_is_refused():
    recording = fronto_parallel(1.5, cameras=1)
    poses = recording.trajectory
    still = replace(recording, trajectory=replace(poses, positions_m=0 * poses.positions_m))
    refused("one camera that does not move sees no parallax", mapped, still, "Focus/cam0")


@pytest.mark.parametrize("measure", [name for name in focus_measures.MEASURES if name != "votes"])
def test_a_measure_moves_the_depth_of_any_method_and_nothing_else(measure):
    """Pixels and confidence are those of the votes; the plane is still found."""
    recording, names = fronto_parallel(1.23), ("Alg1/H", "EMVS/cam0", "Alg2/AtHc@2", "Late/union")
    votes = mapped(recording, *names)
    # The difference of Gaussians filters votes and gathers none
    sigma_px = 0.7 if measure == "dog" else 2.5
    result = mapped(recording, *names, extraction=measure, focus={"sigma_px": sigma_px})
    for name in names:
        plain, sharp = votes.depth_maps[name], result.depth_maps[name]
        np.testing.assert_array_equal(plain.mask, sharp.mask)
        if name != "Late/union":
            np.testing.assert_array_equal(plain.confidence, sharp.confidence)
        assert steps_off(result, name, 1.23) < 0.6, name


def test_the_configuration_names_every_measure():
    assert any(name.startswith("Focus/<F>") for name in overview())
    field = MapperConfig.model_fields["extraction"]
    assert get_args(field.annotation) == tuple(focus_measures.MEASURES)
    own = get_args(FocusParameters.model_fields["measure"].annotation)
    assert ("votes", *own) == tuple(focus_measures.MEASURES)


def test_the_focus_methods_have_parameters_of_their_own():
    """What steers the votes does not move them; what steers them leaves the votes alone."""
    recording, names = fronto_parallel(1.23), ("Alg1/H", "Focus/H")
    plain = mapped(recording, *names)
    by_votes = mapped(recording, *names, extraction="gradient", threshold_c=1)
    by_focus = mapped(recording, *names, focus={"measure": "gradient", "threshold_c": 15})
    wide = mapped(recording, *names, focus={"threshold_kernel_px": 25})
    assert_same_bits(plain.depth_maps["Focus/H"], by_votes.depth_maps["Focus/H"])
    for other in (by_focus, wide):
        assert_same_bits(plain.depth_maps["Alg1/H"], other.depth_maps["Alg1/H"])
        assert (plain.depth_maps["Focus/H"].mask != other.depth_maps["Focus/H"].mask).any()
    assert (plain.depth_maps["Alg1/H"].mask != by_votes.depth_maps["Alg1/H"].mask).any()


@pytest.mark.parametrize("interpolate", [True, False])
def test_interpolation_and_border_are_the_configurations(interpolate):
    result = mapped(fronto_parallel(1.5), "Focus/H", interpolate=interpolate, border_px=5)
    depth = result.depth_maps["Focus/H"]
    off = abs(1 / depth.depth_m[..., None] - result.view.rho).min(axis=-1)[depth.mask]
    step = abs(float(result.view.rho[1] - result.view.rho[0]))
    assert (off.max() > 0.1 * step) == interpolate
    assert not depth.mask[:5].any()
    assert not depth.mask[:, -5:].any()


def test_points_fall_with_the_reliability_that_is_asked_for():
    recording = fronto_parallel(1.5)
    points = [
        mapped(recording, "Focus/H", focus={"reliability": r}).depth_maps["Focus/H"].points
        for r in (0.0, 0.2, 0.5, 1.0)
    ]
    assert points == sorted(points, reverse=True)
    assert points[0] > points[-1] == 0


def some_depths(seed=0):
    rng = np.random.default_rng(seed)
    confidence = rng.gamma(0.5, 10, (20, 25)).astype(F)
    return confidence, rng.uniform(0, 30, (2, 20, 25)).astype(F)


def test_reliability_depends_on_disparity_and_not_on_how_finely_it_is_cut():
    """Twice the planes at half the distance, far to near or near to far: the same reliability."""
    confidence, (own, other) = some_depths()
    coarse_px, fine_px = 15 - 0.4 * np.arange(31), 15 - 0.2 * np.arange(61)
    coarse = judge(confidence, other, own, [other], coarse_px)
    fine = judge(confidence, 2 * other, 2 * own, [2 * other], fine_px)
    back, front = 30 - other, 30 - own
    turned = judge(confidence, back, front, [back], coarse_px[::-1])
    np.testing.assert_allclose(fine.reliability, coarse.reliability, atol=1e-4)
    np.testing.assert_allclose(turned.reliability, coarse.reliability, atol=1e-4)


def test_tolerance_grows_with_the_square_root_of_disparity():
    """Cameras 1 px apart at 10 px agree as much as cameras 2 px apart at 40 px."""
    confidence, position = np.full((6, 6), 5, F), np.full((6, 6), 10, F)
    at_10, at_40 = (judge(
        confidence, position, position, [position + 1], first_px - step_px * np.arange(20)
    ).agreement for first_px, step_px in ((20.0, 1.0), (60.0, 2.0)))  # fmt: skip
    np.testing.assert_allclose(at_10, np.exp(-1 / AGREEMENT_PX), rtol=1e-5)
    np.testing.assert_allclose(at_40, at_10, rtol=1e-5)


def test_votes_whose_own_maximum_lies_elsewhere_are_not_trusted():
    confidence, position = np.full((6, 6), 5, F), np.full((6, 6), 10, F)
    near, far = (
        judge(confidence, loudest, position, [], 20 - np.arange(20.0)).ray
        for loudest in (position, position + 9)
    )
    np.testing.assert_array_equal(near, 1)
    np.testing.assert_allclose(far, np.exp(-3), rtol=1e-5)


def test_beyond_a_silhouette_is_told_from_inside():
    """An object with texture at the left, its edge a ridge of votes, and nothing at the right."""
    confidence = np.zeros((40, 40), F)
    confidence[:, 18:23] = np.array([3, 8, 10, 8, 3], F)  # the ridge; its middle is column 20
    confidence[4:36:4, 3:17:4] = 9  # the texture
    position = np.full((40, 40), 10, F)
    found = judge(confidence, position, position, [position], 9 - 0.3 * np.arange(25))
    inner, outer = found.inside[8:32, 19], found.inside[8:32, 21]
    assert found.candidate[8:32, 20].all()
    assert outer.max() < 0.3
    assert inner.mean() > 1.5 * outer.mean()


def test_without_slope_no_side_is_preferred():
    confidence, (own, _) = some_depths(1)
    disparity_px = 10 - 0.3 * np.arange(31)
    even = judge(np.full_like(confidence, 5), own, own, [], disparity_px)
    np.testing.assert_array_equal(even.inside, F(0.5))
    np.testing.assert_array_equal(even.agreement, 1)


def test_three_cameras_have_every_method_and_the_order_of_means():
    """Law in the mapper: min <= H <= G <= A <= RMS <= max; all find the plane."""
    names = ("Alg2/AtHc@2", "Alg2/HcAt@2", "Alg2/AtHc@2~", "Late/union", "Focus/AtHc@2")
    result = mapped(fronto_parallel(1.23, cameras=3), "all", *names)
    rows = [result.slices.values[f"Alg1/{mean}"] for mean in ("min", "H", "G", "A", "RMS", "max")]
    for smaller, larger in itertools.pairwise(rows):
        assert np.all(smaller <= larger * F(1 + 1e-6))
    for name in (*names, "Focus/H", "EMVS/cam2"):
        assert steps_off(result, name, 1.23) < 0.6, name


def test_equal_volumes_are_remembered_once():
    """Focus/H and Alg1/H fuse the same votes: one maximum serves both."""
    methods = methods_by_name(("Alg1/H", "EMVS/cam1", "Focus/H", "Focus/cam1"), 2)
    maxima = RunningMaxima([method.fusion for method in methods], 6, 5)
    maxima.update(np.random.default_rng(0).gamma(0.5, 9, (2, 4, 30)).astype(F), 4)
    assert len(maxima.arrays[0]) == 2
    for one, other in ((0, 2), (1, 3)):
        np.testing.assert_array_equal(maxima.of(one).value, maxima.of(other).value)
    assert (maxima.of(0).value != maxima.of(1).value).any()
