"""In-painting: planes are filled exactly, edges stay steps, points stay as they are."""

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.inpainting import fill, inpaint
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import StoredWindow, write_window
from point_world import fronto_parallel
from refusals import refused

SHAPE = (30, 40)


def slanted(rho, along_x, along_y):
    """Depth of a plane in space: inverse depth is linear over the image."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return (1 / (rho + along_x * x + along_y * y)).astype(np.float32)


def points(seed, share=0.1):
    mask = np.random.default_rng(seed).random(SHAPE) < share
    mask[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    return mask


@settings(max_examples=15)
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


@pytest.fixture(scope="module")
def filled_window(tmp_path_factory):
    config = MapperConfig(
        planes=20, min_depth_m=0.5, max_depth_m=4, methods=("Focus/H", "Alg1/H"), inpaint=True
    )
    result = map_window(fronto_parallel(1.5), config)
    folder = tmp_path_factory.mktemp("map") / "w000"
    info = write_window(folder, result, config, ("cam0", "cam1"), clouds=False)
    return StoredWindow(folder, info), result, config


def test_the_map_folder_keeps_both_and_says_which_is_which(filled_window):
    window, result, _ = filled_window
    for method, depth_map in result.depth_maps.items():
        read, made = window.dense(method), inpaint(depth_map)
        for name in ("depth_m", "measured", "filled"):
            np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
            assert getattr(read, name).dtype == getattr(made, name).dtype
        np.testing.assert_array_equal(read.measured, depth_map.mask)
        assert read.filled.sum() > read.measured.sum() > 0


def test_a_map_without_inpaint_has_no_dense_depth(filled_window, tmp_path):
    _, result, config = filled_window
    plain = config.model_copy(update={"inpaint": False})
    info = write_window(tmp_path / "w000", result, plain, ("cam0", "cam1"), clouds=False)
    assert not (tmp_path / "w000" / "Focus-H" / "dense.npz").exists()
    refused("map with inpaint", lambda: StoredWindow(tmp_path / "w000", info).dense("Focus/H"))
    refused("no method", lambda: StoredWindow(tmp_path / "w000", info).dense("Alg1/max"))


WRONG = {
    "no array": {"filled": None}, "float32": {"measured": np.zeros((60, 80), np.float32)},
    "shape": {"depth_m": np.ones((3, 4), np.float32)}, "damaged": {},
    "both measured and filled": {"filled": "measured"},
}  # fmt: skip


@pytest.mark.parametrize("told", WRONG)
def test_damaged_dense_depth_is_refused(filled_window, tmp_path, told):
    window, _, _ = filled_window
    dense = window.dense("Focus/H")
    arrays = {"depth_m": dense.depth_m, "measured": dense.measured, "filled": dense.filled}
    for name, value in WRONG[told].items():
        arrays[name] = dense.measured if isinstance(value, str) else value
    copy = tmp_path / "w000" / "Focus-H"
    copy.mkdir(parents=True)
    (copy / "depth.npz").write_bytes((window.path / "Focus-H" / "depth.npz").read_bytes())
    np.savez(copy / "dense.npz", **{k: v for k, v in arrays.items() if v is not None})
    if told == "damaged":
        os.truncate(copy / "dense.npz", 200)
    refused(told, lambda: StoredWindow(tmp_path / "w000", window.info).dense("Focus/H"))
