"""The tree of discs finds what looking at every disc finds, whatever the threads and the places."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.plugins.geometry.nearest import Nearest, along_curve
from naive_surfaces import nearest_disc


def discs(rng, count, flat=False, extent=1.0):
    points = rng.uniform(-extent, extent, (count, 3))
    if flat:
        points[:, 2] = 0.25
    normals = rng.normal(size=(count, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    return points, normals, rng.uniform(0, 0.3, count).astype(np.float32)


@given(
    seed=st.integers(0, 10_000), count=st.integers(1, 90), flat=st.booleans(),
    extent=st.sampled_from([1e-6, 1.0, 1e5]), repeats=st.integers(1, 3),
)  # fmt: skip
def test_points_and_discs_are_those_of_the_twin(seed, count, flat, extent, repeats):
    rng = np.random.default_rng(seed)
    points, normals, radius_m = discs(rng, count, flat, extent)
    points, normals, radius_m = (
        np.repeat(values, repeats, axis=0) for values in (points, normals, radius_m)
    )
    queries = np.concatenate([rng.uniform(-2, 2, (40, 3)) * extent, points[:5]])
    for of, twin in (
        (Nearest(points), nearest_disc(queries, points)),
        (Nearest(points, normals, radius_m), nearest_disc(queries, points, normals, radius_m)),
    ):
        distance_m, found = of.query(queries)
        np.testing.assert_allclose(distance_m, twin[0], atol=1e-9 * extent, rtol=1e-6)
        own = nearest_disc(queries, points)[0] if of._radius_m.size == 0 else None
        if own is not None:
            np.testing.assert_allclose(
                np.linalg.norm(queries - points[found], axis=1), own, atol=1e-9 * extent
            )


def test_open3d_and_scipy_find_the_same():
    o3d = pytest.importorskip("open3d")
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(1)
    points, queries = rng.normal(size=(4000, 3)), rng.normal(size=(3000, 3)) * 2
    distance_m, found = Nearest(points).query(queries)
    search = o3d.core.nns.NearestNeighborSearch(o3d.core.Tensor(points))
    search.knn_index()
    numbers, square = search.knn_search(o3d.core.Tensor(queries), 1)
    np.testing.assert_allclose(distance_m, np.sqrt(square.numpy()[:, 0]), atol=1e-6)
    np.testing.assert_array_equal(found, numbers.numpy()[:, 0])
    np.testing.assert_allclose(distance_m, cKDTree(points).query(queries)[0], atol=1e-12)


def test_the_answer_does_not_depend_on_threads_or_order():
    """Discs that overlap are equally near: the first of them in the tree is taken each time."""
    rng = np.random.default_rng(2)
    points, normals, radius_m = discs(rng, 500, flat=True)
    normals[:] = 0, 0, 1
    of = Nearest(points, normals, radius_m)
    queries = rng.uniform(-1, 1, (2000, 3))
    threads, results = numba.get_num_threads(), []
    try:
        for count in (1, min(2, threads)):
            numba.set_num_threads(count)
            results.append(of.query(queries))
    finally:
        numba.set_num_threads(threads)
    results.append(of.query(queries, is_ordered=True))  # which only says how they are walked
    for distance_m, found in results[1:]:
        np.testing.assert_array_equal(distance_m, results[0][0])
        np.testing.assert_array_equal(found, results[0][1])


def test_the_curve_keeps_neighbours_together():
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 1, (4000, 3))
    order = along_curve(points)
    assert sorted(order) == list(range(4000))
    steps = np.linalg.norm(np.diff(points[order], axis=0), axis=1).mean()
    assert steps < 0.25 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()


def test_no_queries_have_no_answers():
    distance_m, found = Nearest(np.zeros((1, 3))).query(np.empty((0, 3)))
    assert len(distance_m) == len(found) == 0
