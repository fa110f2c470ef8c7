import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import naive_sweep
from eventsweep.emvs.dsi.rays import RayCounts, Rays
from eventsweep.emvs.dsi.voting import PASS_PLANES, Scratch, batch_planes
from eventsweep.emvs.dsi.voting_kernels import CHUNK
from eventsweep.emvs.reference_view import inverse_depth_at, inverse_depth_planes
from eventsweep.emvs.utils.runtime import use_threads
from volumes import dsi

W, H = 12, 9
NEAREST = pytest.mark.parametrize("nearest", [False, True])
EDGES = [
    0.0, -0.0, 0.5, 3.0, 2.9999998, -1e-7, W - 1, H - 1,
    np.nextafter(np.float32(W - 1), 0), np.nextafter(np.float32(H - 1), 0),
    np.inf, -np.inf, np.nan, 1e30,
]  # fmt: skip


def make_rays(a_u, b_u, a_v, b_v, c_z):
    columns = [np.asarray(column, np.float32) for column in (a_u, b_u, a_v, b_v, c_z)]
    c_z = columns[-1]
    limits = [c_z[k : k + CHUNK].max() for k in range(0, len(c_z), CHUNK)]
    return Rays(*columns, np.array(limits, np.float32), RayCounts(len(c_z)))


def random_rays(seed, n, depth_spread=0.3):
    rng = np.random.default_rng(seed)
    return make_rays(
        rng.uniform(-3, W + 2, n), rng.normal(0, 2, n), rng.uniform(-3, H + 2, n),
        rng.normal(0, 2, n), rng.normal(-0.5, depth_spread, n),
    )  # fmt: skip


def check_against_twin(rays, rho, nearest):
    volume, counts = dsi(rays, rho, W, H, nearest=nearest)
    cast = naive_sweep.nearest if nearest else naive_sweep.bilinear
    twin, counted, behind = naive_sweep.vote(
        rays.a_u, rays.b_u, rays.a_v, rays.b_v, rays.c_z, rho, W, H, cast
    )
    np.testing.assert_array_equal(volume, twin)
    assert counts.counted == counted.sum()
    assert counts.behind == behind.sum()
    assert counts.counted + counts.behind + counts.outside == len(rays) * len(rho)
    smaller = rays.in_planes(rho)
    assert len(smaller.c_z) in ((len(rays),) if behind.any() else (0, len(rays)))
    again, same = dsi(smaller, rho, W, H, nearest=nearest)
    np.testing.assert_array_equal(again, volume)
    assert same == counts


@settings(max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1), n=st.sampled_from([1, 7, CHUNK, CHUNK + 3]),
    depth_spread=st.sampled_from([0.0, 0.3, 2.0]), nearest=st.booleans(),
)  # fmt: skip
def test_kernel_equals_twin_bit_for_bit(seed, n, depth_spread, nearest):
    rays = random_rays(seed, n, depth_spread)
    check_against_twin(rays, inverse_depth_planes(0.4, 5, 3), nearest)


def test_rays_keep_what_tells_planes_behind_only_where_there_are_some():
    rays, near = random_rays(3, 2 * CHUNK, 0.0), np.array([1.9, 0.5], np.float32)
    some = make_rays(*rays.columns[:4], np.where(np.arange(len(rays)) == 7, 0.5, rays.c_z))
    assert len(rays.in_planes(near).c_z) == len(some.in_planes(near).c_z) == 0
    assert some.in_planes(np.array([2, 0.5], np.float32)) is some


@NEAREST
def test_kernel_equals_twin_on_edges_poles_and_planes_behind(nearest):
    slopes = [0.0, 1.0, -1e30, np.inf]
    columns = np.array(list(itertools.product(EDGES, slopes, EDGES, [0.0, -1.0], [-1, 0, 0.5, 2])))
    check_against_twin(make_rays(*columns.T), np.array([2, 1, 0.5], np.float32), nearest)


def test_nearest_votes_are_whole_and_as_many_as_bilinear_ones():
    rays, rho = random_rays(5, 5000), inverse_depth_planes(0.4, 5, 6)
    volume, counts = dsi(rays, rho, W, H, nearest=True)
    np.testing.assert_array_equal(volume, np.rint(volume))
    assert volume.sum(dtype=np.float64) == counts.counted
    assert counts == dsi(rays, rho, W, H)[1]


def test_nearest_and_bilinear_votes_agree_on_whole_pixels():
    rng = np.random.default_rng(0)
    rays = make_rays(rng.integers(0, W - 1, 99), np.zeros(99), rng.integers(0, H - 1, 99),
                     np.zeros(99), np.full(99, -1))  # fmt: skip
    rho = inverse_depth_planes(0.4, 5, 2)
    np.testing.assert_array_equal(dsi(rays, rho, W, H)[0], dsi(rays, rho, W, H, nearest=True)[0])


def test_sum_of_a_plane_is_the_number_of_votes_inside_it():
    rays, rho = random_rays(0, 5000), inverse_depth_planes(0.4, 5, 6)
    volume, counts = dsi(rays, rho, W, H)
    assert counts.outside > 0
    assert volume.sum(dtype=np.float64) == pytest.approx(counts.counted, abs=1e-2)


@NEAREST
def test_neither_threads_nor_batches_change_a_bit(nearest):
    rays, rho = random_rays(3, 20_000), inverse_depth_planes(0.4, 5, 7)
    volumes = []
    for threads in (1, 2):
        use_threads(threads)
        volumes.append(dsi(rays, rho, W, H, nearest=nearest)[0])
    use_threads(0)
    volumes.append(np.concatenate([dsi(rays, rho[k : k + 1], W, H, nearest=nearest)[0]
                                   for k in range(7)]))  # fmt: skip
    np.testing.assert_array_equal(volumes[0], volumes[1])
    np.testing.assert_array_equal(volumes[0], volumes[2])


def test_scratch_is_cleared_between_batches():
    rho = inverse_depth_planes(0.4, 5, 4)
    scratch = Scratch(1, 4, W, H)
    scratch.cast(0, random_rays(1, 500), rho)
    scratch.cast(0, random_rays(2, 500), rho)
    np.testing.assert_array_equal(scratch.images(4)[0], dsi(random_rays(2, 500), rho, W, H)[0])


def test_too_many_planes_for_the_scratch_are_refused():
    with pytest.raises(ValueError, match="scratch"):
        Scratch(1, 2, W, H).cast(0, random_rays(1, 5), inverse_depth_planes(0.4, 5, 3))


@given(
    st.integers(1, 300), st.integers(1, 64), st.sampled_from([1, 90_000, 300_000, 1 << 20]),
    st.integers(1, 200),
)  # fmt: skip
def test_batches_keep_all_threads_busy(planes, threads, px, volumes):
    step = batch_planes(planes, threads, px, volumes)
    full = step % (threads * PASS_PLANES) == 0
    assert full or step == planes or (step + 1) * volumes * px > 128 << 20


@given(st.floats(0.05, 10), st.floats(1.01, 100), st.integers(2, 300))
def test_planes_run_near_to_far_with_both_ends(near_m, ratio, count):
    rho = inverse_depth_planes(near_m, near_m * ratio, count)
    assert len(rho) == count
    np.testing.assert_allclose([1 / rho[0], 1 / rho[-1]], [near_m, near_m * ratio], rtol=1e-5)
    assert np.all(np.diff(rho) < 0)
    np.testing.assert_allclose(
        inverse_depth_at(rho, np.arange(count, dtype=np.float32)), rho, rtol=1e-4
    )
