"""ESVO's mapping: kernels against twins, the algebra of its distributions, known planes."""

import naive_esvo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from point_world import Recorded, fronto_parallel

import scenes
from emvs.config import MapperConfig
from emvs.data.events import Events
from emvs.data.rig import Rig
from emvs.data.sequence import Sequence
from emvs.errors import InputError
from emvs.rivals import esvo, gts
from emvs.rivals.esvo_match import match_blocks
from emvs.rivals.esvo_parameters import Matching, Refinement, Regularisation
from emvs.rivals.esvo_refine import Lines, refine
from emvs.rivals.esvo_regularise import regularised
from emvs.rivals.esvo_select import newest
from emvs.rivals.esvo_student_t import Estimates, compatible, fuse_into, fuse_two, propagate
from emvs.view import reference_view
from emvs.window import choose_window
from sim.config import SimConfig
from sim.generate import simulate
from sim.rigs import rig as named_rig

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


# Events


def test_the_newest_event_of_every_pixel_is_picked():
    x = np.array([1, 2, 1, 3, 2], np.uint16)
    events = Events(x, np.zeros(5, np.uint16), np.arange(5), np.zeros(5, np.uint8))
    assert newest(events, 10, 8).tolist() == [2, 3, 4]
    assert newest(events, 2, 8).tolist() == [3, 4]
    assert newest(Events.empty(), 2, 8).tolist() == []


# Matching


def test_blocks_against_the_twin():
    rng = np.random.default_rng(3)
    left, right = waves(), waves(seed=4) + waves(shift_px=9)
    pixels = rng.integers((40, 8), (100, 42), (40, 2))
    settings = Matching(coarse_px=1, least_zncc=-1)
    found, score = match_blocks(left, right, pixels, (2, 20), settings)
    for (u, v), disparity, value in zip(pixels.tolist(), found, score, strict=True):
        known = [naive_esvo.zncc(left, right, u, v, d, (7, 3)) for d in range(1, 22)]
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
    assert refined.rms.max() < 2


def test_refinement_lowers_the_twins_cost():
    left, right, found = waves(), waves(shift_px=7.4) + waves(seed=9) * 0.1, lines(10)
    camera, start = (80.0, 60.0, 25.0, 0.1), np.full(10, 7 / 8.0)
    refined = refine(left, right, found, start, Refinement())
    for k in range(10):
        values = [
            naive_esvo.cost(left, right, found.a[k], found.b[k], camera, rho, (7, 3), 2.182, 17.277)
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


def test_estimates_that_contradict_keep_the_surer_one():
    uv_px, empty = np.array([[2.0, 1.0]]), Estimates.empty(4, 5)
    sure = fuse_into(empty, uv_px, np.array([1.0]), np.array([0.01]), 3.0)
    both = fuse_into(sure, uv_px, np.array([2.0]), np.array([0.02]), 3.0)
    assert (both.rho[1, 2], both.count[1, 2]) == (1.0, 1)
    again = fuse_into(both, uv_px, np.array([2.0]), np.array([0.001]), 3.0)
    assert again.rho[1, 2] == 2.0
    assert not empty.count.any()


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
    known = Estimates(rho, scale, np.full(rho.shape, 4.0), count)
    found = regularised(known, Regularisation(least_neighbours=8), 1.0)
    expected = naive_esvo.smooth(rho, known.deviation, 5, 8)
    np.testing.assert_allclose(found, expected)
    assert 0 < np.isfinite(found).sum() < count.sum()


# Through a recording


@pytest.mark.parametrize("depth_m", [0.8, 1.3, 2.5])
@pytest.mark.parametrize("function", [esvo.estimate, esvo.estimate_window])
def test_a_fronto_parallel_plane_is_found_to_a_fifth_of_a_pixel(depth_m, function):
    found = mapped(fronto_parallel(depth_m, points=600), function)
    disparity_px = 8 / found.depth_m[found.mask]
    assert found.points > 100
    assert np.median(np.abs(disparity_px - 8 / depth_m)) < 0.2


@pytest.fixture(scope="module")
def planes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("esvo") / "planes"
    scene = scenes.load("planes")
    config = SimConfig.model_validate({"duration_s": 0.12})
    simulate(scene, named_rig(scene.rig), config, 0, folder)
    return Sequence.open(folder)


def true_rho(sequence, t_us, uv_px):
    """Inverse depth of the truth at pixels of camera 0, 1/m; NaN where it has none."""
    truth_m = sequence.truth_view_depth_m(0, t_us)
    column, row = np.rint(uv_px).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < truth_m.shape[1]) & (row < truth_m.shape[0])
    depth_m = np.where(inside, truth_m[row * inside, column * inside], 0)
    return np.divide(1, depth_m, out=np.full(len(depth_m), np.nan), where=depth_m > 0)


def test_refinement_lowers_the_error_of_its_start(planes):
    view = reference_view(planes, MapperConfig(), 100_000)
    looker = esvo.Looker(planes, 0, view, esvo.DEFAULT)
    t_us = planes.truth_times_us(0)
    looked = looker.at(int(t_us[np.argmin(np.abs(t_us - 100_000))]))
    camera = looker.stereo.camera
    # The rig is rectified already: its views differ from camera 0 by the principal point only.
    sensor = planes.rig.cameras[0]
    uv_px = camera.fx_px * looked.bearing[:, :2] + (sensor.cx_px, sensor.cy_px)
    truth = true_rho(planes, int(t_us[np.argmin(np.abs(t_us - 100_000))]), uv_px)
    done = np.isfinite(looked.refined.rho) & np.isfinite(truth)
    scale = camera.fx_px * looker.stereo.baseline_m
    start, refined = (
        scale * np.abs(rho[done] - truth[done]) for rho in (looked.start, looked.refined.rho)
    )
    assert done.sum() > 50
    assert np.median(refined) < np.median(start)
    assert refined.mean() < start.mean()


@pytest.mark.parametrize(
    ("function", "points", "median_px"),
    [(esvo.estimate, 50, 0.3), (esvo.estimate_window, 150, 0.3), (gts.estimate, 300, 0.5)],
)
def test_planes_are_found_to_the_stated_accuracy(planes, function, points, median_px):
    found = mapped(planes, function, MapperConfig(reference_s=0.1))
    t_us = planes.truth_times_us(0)
    truth_m = planes.truth_view_depth_m(0, int(t_us[np.argmin(np.abs(t_us - found.t_us))]))
    known = found.mask & (truth_m > 0)
    scale = planes.rig.cameras[0].fx_px * planes.rig.baseline_m()
    errors_px = scale * np.abs(1 / found.depth_m[known] - 1 / truth_m[known])
    assert known.sum() > points
    assert np.median(errors_px) < median_px


# Bad input


def test_too_few_events_are_refused():
    recording = fronto_parallel(1.3)
    few = tuple(Events(s.x[::400], s.y[::400], s.t_us[::400], s.p[::400])
                for s in recording.streams)  # fmt: skip
    with pytest.raises(InputError, match="has an event that matches in both cameras") as error:
        mapped(Recorded(recording.rig, recording.trajectory, few))
    assert "\n" not in str(error.value)


def test_one_camera_is_refused():
    recording = fronto_parallel(1.3, cameras=1)
    with pytest.raises(InputError, match="stereo matching needs 2") as error:
        mapped(recording)
    assert "\n" not in str(error.value)


def test_a_rig_that_looks_along_its_baseline_is_refused():
    recording = fronto_parallel(1.3)
    ahead = np.eye(4)
    ahead[2, 3] = 0.1
    rig = Rig("ahead", recording.rig.cameras, (np.eye(4), ahead))
    with pytest.raises(InputError, match=r"cannot be rectified.*90\.0 degrees") as error:
        mapped(Recorded(rig, recording.trajectory, recording.streams))
    assert "\n" not in str(error.value)
