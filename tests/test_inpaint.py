"""In-painting: planes are filled exactly, edges stay steps, points stay as they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_world import fronto_parallel

from emvs.config import MapperConfig
from emvs.inpaint import fill, inpaint
from emvs.mapper import map_window
from emvs.output import write_window

SHAPE = (30, 40)


def slanted(rho, along_x, along_y):
    """Depth of a plane in space: inverse depth is linear over the image."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return (1 / (rho + along_x * x + along_y * y)).astype(np.float32)


def points(seed, share=0.1):
    mask = np.random.default_rng(seed).random(SHAPE) < share
    mask[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    return mask


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.004, 0.004), st.floats(-0.004, 0.004))
def test_a_plane_in_space_is_filled_exactly(seed, along_x, along_y):
    truth, mask = slanted(0.6, along_x, along_y), points(seed)
    depth_m, filled = fill(np.where(mask, truth, np.float32(9)), mask, max_ratio=10)
    np.testing.assert_array_equal(filled, ~mask)  # the hull is the whole image
    np.testing.assert_allclose(depth_m, truth, rtol=1e-4)


def test_a_depth_edge_stays_a_step():
    """Of two surfaces 1 m and 3 m away, no pixel in between is 2 m away."""
    truth = np.where(np.arange(SHAPE[1]) < 20, np.float32(1), np.float32(3)) * np.ones(SHAPE)
    mask = points(1)
    depth_m, _ = fill(truth.astype(np.float32), mask)
    np.testing.assert_allclose(np.unique(np.round(depth_m, 4)), [1, 3])
    ramp, _ = fill(truth.astype(np.float32), mask, max_ratio=10)
    assert ((ramp > 1.2) & (ramp < 2.8)).any()


def test_points_stay_and_nothing_beyond_them_is_filled():
    truth, mask = slanted(0.5, 0.001, 0), np.zeros(SHAPE, bool)
    mask[5:20:3, 8:30:4] = True
    depth_m, filled = fill(truth, mask)
    np.testing.assert_array_equal(depth_m[mask], truth[mask])
    assert not (filled & mask).any()
    rows, columns = np.nonzero(filled)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (5, 17, 8, 28)


@pytest.mark.parametrize("count", [0, 1, 2, 12])
def test_too_few_points_or_a_line_of_them_fill_nothing(count):
    mask = np.zeros(SHAPE, bool)
    mask[7, :count] = True
    depth_m, filled = fill(slanted(0.5, 0, 0), mask)
    assert not filled.any()
    assert np.isfinite(depth_m).all()


def test_the_map_folder_keeps_both_and_says_which_is_which(tmp_path):
    config = MapperConfig(planes=20, min_depth_m=0.5, max_depth_m=4, methods=("Focus/H", "Alg1/H"))
    result = map_window(fronto_parallel(1.5), config)
    for asked in (False, True):
        told = config.model_copy(update={"inpaint": asked})
        write_window(tmp_path / str(asked), result, told, ("cam0", "cam1"), clouds=False)
        assert (tmp_path / str(asked) / "Focus-H" / "dense.npz").exists() == asked
    with np.load(tmp_path / "True" / "Focus-H" / "dense.npz") as stored:
        dense = inpaint(result.depth_maps["Focus/H"])
        np.testing.assert_array_equal(stored["measured"], result.depth_maps["Focus/H"].mask)
        np.testing.assert_array_equal(stored["depth_m"], dense.depth_m)
        assert stored["filled"].sum() > stored["measured"].sum() > 0
        assert not (stored["filled"] & stored["measured"]).any()
