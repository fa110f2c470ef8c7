"""Grouping rays by image rows changes nothing but their order."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eventsweep.emvs.dsi.rays import BAND_ROWS, RayCounts, Rays, grouped_by_rows
from naive_sweep import order_by_rows
from volumes import dsi

RHO, HEIGHT_PX = 0.5, 70
# Also what lies outside the image, and what no ray should be but a kernel must survive
ROWS = st.floats(-100, 300, width=32) | st.sampled_from([np.nan, np.inf, -np.inf, 1e30, -1e30])


def rays_at(rows, seed=0):
    """Rays that meet plane RHO in given rows, each with a column that tells them apart."""
    count = len(rows)
    b_v = np.random.default_rng(seed).uniform(-20, 20, count).astype(np.float32)
    with np.errstate(invalid="ignore"):
        a_v = (rows - RHO * b_v).astype(np.float32)
    u = np.arange(count, dtype=np.float32)
    return Rays.of((u, np.zeros_like(u), a_v, b_v, -u), RayCounts(count))


@given(arrays(np.float32, st.integers(0, 60), elements=ROWS))
def test_it_is_the_slow_twin_s_order(rows):
    rays = rays_at(rows)
    with np.errstate(invalid="ignore"):
        met = rays.a_v + np.float32(RHO) * rays.b_v
    order = order_by_rows(met.tolist(), -(-HEIGHT_PX // BAND_ROWS), BAND_ROWS)
    grouped = grouped_by_rows(rays, RHO, HEIGHT_PX)
    for column, its_column in zip(rays.columns, grouped.columns, strict=True):
        np.testing.assert_array_equal(its_column, column[order])
    assert grouped.counts == rays.counts


def test_the_limits_of_chunks_belong_to_the_new_order():
    grouped = grouped_by_rows(rays_at(np.random.default_rng(0).uniform(0, 70, 5000)), RHO, 70)
    for k, limit in enumerate(grouped.c_z_max):
        assert limit == grouped.c_z[1024 * k : 1024 * (k + 1)].max()


@pytest.mark.parametrize("threads", [1, 2])
def test_blocks_keep_the_order_whatever_the_threads(threads):
    rows = np.random.default_rng(1).uniform(-10, 90, 400_000).astype(np.float32)  # four blocks
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, before))
    try:
        grouped = grouped_by_rows(rays_at(rows), RHO, HEIGHT_PX)
    finally:
        numba.set_num_threads(before)
    met = rays_at(rows).a_v + np.float32(RHO) * rays_at(rows).b_v
    band = np.clip(met, 0, BAND_ROWS * -(-HEIGHT_PX // BAND_ROWS) - 1).astype(int) // BAND_ROWS
    np.testing.assert_array_equal(grouped.a_u, np.argsort(band, kind="stable"))


def test_the_votes_are_the_same_but_for_rounding():
    rng = np.random.default_rng(2)
    spans = [(0, 64), (-9, 9), (0, 70), (-9, 9), (-1, 3)]
    columns = [rng.uniform(*span, 3000).astype(np.float32) for span in spans]
    rays = Rays.of(columns, RayCounts(3000))
    rho = np.array([0.2, 0.5, 0.8], np.float32)
    plain, counts = dsi(rays, rho, 64, HEIGHT_PX)
    grouped, its_counts = dsi(grouped_by_rows(rays, RHO, HEIGHT_PX), rho, 64, HEIGHT_PX)
    assert its_counts == counts
    np.testing.assert_allclose(grouped, plain, atol=1e-5)
