"""Pictures: colours mean what the scale says, and files hold what was drawn."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eventsweep.emvs.errors import InputError
from eventsweep.eval.figures.colormaps import (
    BLANK,
    confidence_scale,
    depth_scale,
    error_scale,
    events_scale,
    grey_palette,
    nice_above,
    nice_between,
    spaced,
)
from eventsweep.eval.figures.images import (
    IndexedImage,
    behind_image,
    confidence_image,
    depth_image,
    error_cap_cm,
    error_image,
    events_image,
    frame_image,
)
from eventsweep.eval.figures.plots import (
    DsiSlice,
    SliceFigures,
    _surfaces,
    curves_figure,
    slice_figure,
    svg,
)
from eventsweep.eval.scoring.curves import THRESHOLDS_CM
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.metrics import Pairs

WHITE = [255, 255, 255]


@given(hnp.arrays(np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=40)))
def test_a_png_decodes_to_what_was_drawn(index):
    palette = np.random.default_rng(0).integers(0, 256, (256, 4)).astype(np.uint8)
    image = IndexedImage(index, palette)
    decoded = cv2.imdecode(np.frombuffer(image.png(), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded[..., [2, 1, 0, 3]], image.rgba())


def test_enlarging_repeats_pixels():
    image = IndexedImage(np.array([[0, 1]], np.uint8), grey_palette()).enlarged(3)
    np.testing.assert_array_equal(image.index, [[0, 0, 0, 1, 1, 1]] * 3)


def test_a_colour_outside_the_palette_is_refused():
    with pytest.raises(InputError, match="palette of 2"):
        IndexedImage(np.array([[2]], np.uint8), grey_palette()[:2])


def test_near_is_red_far_is_blue_nothing_is_white():
    scale = depth_scale((0.5, 4.0))
    depth_m = np.array([[0.5, 4.0, 1.0]])
    colours = depth_image(depth_m, np.array([[True, True, False]]), scale).rgba()[0]
    near, far, nothing = colours[:, :3].astype(int)
    assert near[0] > 2 * max(near[1], near[2])
    assert far[2] > 1.5 * max(far[0], far[1])
    assert nothing.tolist() == WHITE


def test_depth_colours_are_even_in_inverse_depth():
    scale = depth_scale((0.5, 4.0))
    rho = np.linspace(1 / 4.0, 1 / 0.5, 255)[None]
    index = depth_image(1 / rho, np.ones(rho.shape, bool), scale).index[0]
    np.testing.assert_array_equal(index, np.arange(255))


def test_depth_beyond_the_range_takes_the_colour_of_its_end():
    scale = depth_scale((0.5, 4.0))
    index = depth_image(np.array([[0.1, 99.0]]), np.ones((1, 2), bool), scale).index
    assert index.tolist() == [[254, 0]]


def test_points_grow_and_the_nearest_wins_but_never_over_another_point():
    scale = depth_scale((0.5, 4.0))
    depth_m, mask = np.full((5, 6), 4.0), np.zeros((5, 6), bool)
    depth_m[2, 3] = 0.5
    mask[2, 1] = mask[2, 3] = mask[2, 4] = True
    index = depth_image(depth_m, mask, scale, point_px=3).index
    assert (index[2, 1], index[2, 2], index[2, 3], index[2, 4]) == (0, 254, 254, 0)
    assert index[0, 0] == BLANK
    assert index[1, 1] == 0


def test_undefined_depth_under_the_mask_is_never_looked_at():
    depth_m = np.array([[np.nan, 0.0, 1.0]])
    mask = np.array([[False, False, True]])
    with np.errstate(all="raise"):
        image = depth_image(depth_m, mask, depth_scale((0.5, 4.0)))
    assert (image.index[0] == BLANK).tolist() == [True, True, False]


def test_error_is_in_centimetres_and_transparent_where_nothing_is_compared():
    truth_m = np.array([[1.0, 1.0, 1.0, np.nan]])
    depth_m = np.array([[1.0, 1.1, 3.0, 1.0]])
    mask, scored = np.ones((1, 4), bool), np.isfinite(truth_m)
    image = error_image(depth_m, mask, truth_m, scored, error_scale(20.0))
    assert image.index[0, :3].tolist() == [0, 127, 254]
    assert image.rgba()[0, :, 3].tolist() == [255, 255, 255, 0]


def test_the_error_scale_holds_three_of_four():
    errors_cm = np.random.default_rng(0).exponential(3.0, 1000)
    cap_cm = error_cap_cm(errors_cm)
    assert np.mean(errors_cm <= cap_cm) >= 0.75
    assert error_cap_cm(np.empty(0)) > 0


def test_brighter_is_blue_darker_is_orange_silence_is_white():
    brighter, darker = np.array([[9, 0, 0]]), np.array([[1, 9, 0]])
    colours = events_image(brighter, darker, events_scale(9)).rgba()[0, :, :3].astype(int)
    assert colours[0, 2] > 2 * colours[0, 0]
    assert colours[1, 0] > 2 * colours[1, 2]
    assert colours[2].tolist() == WHITE


def test_confidence_is_dark_where_high_and_white_where_there_is_none():
    confidence = np.array([[0.0, 5.0, 10.0, np.nan]])
    grey = confidence_image(confidence, confidence_scale(10.0)).rgba()[0, :, 0].astype(int)
    assert grey[0] == grey[3] == 255
    assert grey[0] > grey[1] > grey[2]


def test_large_pictures_are_kept_small():
    """Fewer greys and half the frame, and still blank where blank, dark where high."""
    confidence = np.tile(np.linspace(0, 10, 1280), (720, 1))
    confidence[0, 0] = np.nan
    few = confidence_image(confidence, confidence_scale(10.0))
    assert few.index[0, 0] == 255
    assert len(np.unique(few.index[1])) == 17
    assert (np.diff(few.rgba()[1, :, 0].astype(int)) <= 0).all()
    frame = np.random.default_rng(0).integers(0, 256, (720, 1280), np.uint8)
    assert behind_image(frame).index.shape == (360, 640)
    small = frame[:100, :100]
    np.testing.assert_array_equal(behind_image(small).index, frame_image(small).index)


def test_true_depth_is_a_line_that_jumps_where_depth_does():
    truth = np.array([1.0, 1.0, np.nan, 2.0, 2.0, 4.0])
    x, rho = _surfaces(truth, np.linspace(0.2, 1.2, 11))
    pieces = np.split(rho, np.flatnonzero(np.isnan(rho)))
    runs = [set(run[~np.isnan(run)]) for run in pieces]
    assert [run for run in runs if run] == [{1.0}, {0.5}, {0.25}]
    assert x[0] == -0.5
    assert x[-1] == 5.5


def test_frame_keeps_black_white_and_order():
    index = frame_image(np.arange(256, dtype=np.uint8)[None]).index[0].astype(int)
    assert (index[0], index[-1]) == (0, 255)
    assert (np.diff(index) >= 0).all()


@given(st.floats(1e-6, 1e6))
def test_the_next_round_value_is_near_and_not_below(value):
    assert value <= nice_above(value) <= 2 * value


@given(st.floats(0.01, 10.0), st.floats(1.01, 100.0))
def test_round_values_lie_between(low, ratio):
    values = nice_between(low, low * ratio)
    assert all(low < value < low * ratio for value in values)
    assert len(set(values)) == len(values)


@given(st.lists(st.floats(0, 1), max_size=30))
def test_ticks_never_crowd(positions):
    kept = [position for position, _ in spaced([(p, "") for p in positions], gap=0.1)]
    assert all(b - a >= 0.1 for a, b in pairwise(kept))


def test_every_depth_bar_is_labelled_at_both_ends():
    for near_m, far_m in [(0.45, 4.0), (4.0, 200.0), (1.0, 1.1)]:
        ticks = depth_scale((near_m, far_m)).ticks
        assert ticks[0] == (0.0, f"{far_m:g}")
        assert ticks[-1] == (1.0, f"{near_m:g}")


def _curve(pairs):
    return {
        name: np.array([ALL_METRICS[f"{name}_{cm}cm"](pairs) for cm in THRESHOLDS_CM])
        for name in ("precision", "recall", "f1")
    }


def _curves():
    truth_m = np.linspace(1, 2, 50)
    return [
        (name, _curve(Pairs(truth_m + error_m, truth_m, 80, 22.6)))
        for name, error_m in (("Alg1/H", 0.02), ("Alg1/A", 0.07), ("mine", 0.1))
    ]


def test_curves_name_every_method_and_follow_the_page_in_colour():
    drawing = svg(curves_figure, _curves(), "case0")
    for name in ("Alg1/H", "Alg1/A", "mine"):
        assert name in drawing
    assert "tolerated error [cm]" in drawing
    assert 'id="case0-precision-curve-2"' in drawing
    assert "currentColor" in drawing
    assert drawing.split(">", 1)[0].count("width=") == 0


def test_same_curves_same_drawing():
    assert svg(curves_figure, _curves(), "a") == svg(curves_figure, _curves(), "a")


@pytest.mark.parametrize("order", [1, -1])
def test_a_slice_is_the_same_whichever_way_its_planes_run(order):
    rho = np.linspace(2.0, 0.25, 20)
    votes = np.random.default_rng(0).random((20, 30))
    depth_m, mask = np.full(30, 1.0), np.arange(30) % 2 == 0
    truth_m = np.where(np.arange(30) < 5, np.nan, 1.1)
    piece = DsiSlice(12, rho[::order], votes[::order], depth_m, mask, truth_m)
    reference = DsiSlice(12, rho, votes, depth_m, mask, truth_m)
    assert svg(slice_figure, piece) == svg(slice_figure, reference)
    assert "image row 12" in svg(slice_figure, piece)
    assert "true depth" in svg(slice_figure, piece)


def test_slices_of_one_window_look_as_if_each_were_laid_out_alone():
    rng, rho = np.random.default_rng(1), np.linspace(2.0, 0.25, 20)
    truth_m, draw = np.full(30, 1.1), SliceFigures()
    for depth_m in (0.6, 1.0, 3.0):
        mask = rng.random(30) < 0.5
        piece = DsiSlice(12, rho, rng.random((20, 30)), np.full(30, depth_m), mask, truth_m)
        assert svg(draw, piece) == svg(slice_figure, piece)


def test_an_empty_slice_without_truth_can_be_drawn():
    piece = DsiSlice(0, np.array([1.0, 0.5]), np.zeros((2, 4)), np.zeros(4), np.zeros(4, bool))
    assert "true depth" not in svg(slice_figure, piece)
