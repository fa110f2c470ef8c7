"""Pictures: colours mean what the scale says, and files hold what was drawn."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eventsweep.eval.figures import colormaps, images, plots
from eventsweep.eval.scoring.curves import THRESHOLDS_CM
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.metrics import Pairs
from refusals import line_of

WHITE = [255, 255, 255]


@given(hnp.arrays(np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=40)))
def test_a_png_decodes_to_what_was_drawn(index):
    palette = np.random.default_rng(0).integers(0, 256, (256, 4)).astype(np.uint8)
    image = images.IndexedImage(index, palette)
    decoded = cv2.imdecode(np.frombuffer(image.png(), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded[..., [2, 1, 0, 3]], image.rgba())


def test_enlarging_repeats_pixels_and_colours_are_of_the_palette():
    image = images.IndexedImage(np.array([[0, 1]], np.uint8), colormaps.grey_palette()).enlarged(3)
    np.testing.assert_array_equal(image.index, [[0, 0, 0, 1, 1, 1]] * 3)
    index = np.array([[2]], np.uint8)
    assert "palette of 2" in line_of(images.IndexedImage, index, colormaps.grey_palette()[:2])


DEPTHS = colormaps.depth_scale((0.5, 4.0))


def test_depth_is_red_when_near_blue_when_far_and_even_in_inverse_depth():
    depth_m = np.array([[0.5, 4.0, 1.0]])
    colours = images.depth_image(depth_m, np.array([[True, True, False]]), DEPTHS).rgba()[0]
    near, far, nothing = colours[:, :3].astype(int)
    assert near[0] > 2 * max(near[1], near[2])
    assert far[2] > 1.5 * max(far[0], far[1])
    assert nothing.tolist() == WHITE
    rho = np.linspace(1 / 4.0, 1 / 0.5, 255)[None]
    index = images.depth_image(1 / rho, np.ones(rho.shape, bool), DEPTHS).index[0]
    np.testing.assert_array_equal(index, np.arange(255))
    beyond = images.depth_image(np.array([[0.1, 99.0]]), np.ones((1, 2), bool), DEPTHS).index
    assert beyond.tolist() == [[254, 0]]


def test_points_grow_the_nearest_wins_and_what_the_mask_hides_is_never_looked_at():
    depth_m, mask = np.full((5, 6), 4.0), np.zeros((5, 6), bool)
    depth_m[2, 3] = 0.5
    mask[2, 1] = mask[2, 3] = mask[2, 4] = True
    index = images.depth_image(depth_m, mask, DEPTHS, point_px=3).index
    assert index[2, 1:5].tolist() == [0, 254, 254, 0]
    assert (index[0, 0], index[1, 1]) == (colormaps.BLANK, 0)
    with np.errstate(all="raise"):
        image = images.depth_image(
            np.array([[np.nan, 0.0, 1.0]]), np.array([[False, False, True]]), DEPTHS
        )
    assert (image.index[0] == colormaps.BLANK).tolist() == [True, True, False]


def test_error_is_in_centimetres_on_a_scale_of_three_in_four_or_transparent():
    truth_m = np.array([[1.0, 1.0, 1.0, np.nan]])
    depth_m = np.array([[1.0, 1.1, 3.0, 1.0]])
    mask, scored = np.ones((1, 4), bool), np.isfinite(truth_m)
    image = images.error_image(depth_m, mask, truth_m, scored, colormaps.error_scale(20.0))
    assert image.index[0, :3].tolist() == [0, 127, 254]
    assert image.rgba()[0, :, 3].tolist() == [255, 255, 255, 0]
    errors_cm = np.random.default_rng(0).exponential(3.0, 1000)
    cap_cm = images.error_cap_cm(errors_cm)
    assert np.mean(errors_cm <= cap_cm) >= 0.75
    assert images.error_cap_cm(np.empty(0)) > 0


def test_brighter_is_blue_darker_is_orange_and_confidence_is_dark_where_high():
    brighter, darker = np.array([[9, 0, 0]]), np.array([[1, 9, 0]])
    colours = (
        images.events_image(brighter, darker, colormaps.events_scale(9))
        .rgba()[0, :, :3]
        .astype(int)
    )
    assert colours[0, 2] > 2 * colours[0, 0]
    assert colours[1, 0] > 2 * colours[1, 2]
    assert colours[2].tolist() == WHITE
    confidence = np.array([[0.0, 5.0, 10.0, np.nan]])
    grey = (
        images.confidence_image(confidence, colormaps.confidence_scale(10.0))
        .rgba()[0, :, 0]
        .astype(int)
    )
    assert grey[0] == grey[3] == 255
    assert grey[0] > grey[1] > grey[2]


def test_true_depth_is_a_line_that_jumps_where_depth_does():
    truth = np.array([1.0, 1.0, np.nan, 2.0, 2.0, 4.0])
    x, rho = plots._surfaces(truth, np.linspace(0.2, 1.2, 11))
    pieces = np.split(rho, np.flatnonzero(np.isnan(rho)))
    runs = [set(run[~np.isnan(run)]) for run in pieces]
    assert [run for run in runs if run] == [{1.0}, {0.5}, {0.25}]
    assert (x[0], x[-1]) == (-0.5, 5.5)


def test_frames_keep_black_white_and_order_and_large_pictures_are_kept_small():
    index = images.frame_image(np.arange(256, dtype=np.uint8)[None]).index[0].astype(int)
    assert (index[0], index[-1]) == (0, 255)
    assert (np.diff(index) >= 0).all()
    # Fewer greys and half the frame, and still blank where blank, dark where high.
    confidence = np.tile(np.linspace(0, 10, 1280), (720, 1))
    confidence[0, 0] = np.nan
    few = images.confidence_image(confidence, colormaps.confidence_scale(10.0))
    assert few.index[0, 0] == 255
    assert len(np.unique(few.index[1])) == 17
    assert (np.diff(few.rgba()[1, :, 0].astype(int)) <= 0).all()
    frame = np.random.default_rng(0).integers(0, 256, (720, 1280), np.uint8)
    assert images.behind_image(frame).index.shape == (360, 640)
    small = frame[:100, :100]
    np.testing.assert_array_equal(images.behind_image(small).index, images.frame_image(small).index)


@given(st.floats(1e-6, 1e6))
def test_the_next_round_value_is_near_and_not_below(value):
    assert value <= colormaps.nice_above(value) <= 2 * value


@given(st.floats(0.01, 10.0), st.floats(1.01, 100.0))
def test_round_values_lie_between(low, ratio):
    values = colormaps.nice_between(low, low * ratio)
    assert all(low < value < low * ratio for value in values)
    assert len(set(values)) == len(values)


@given(st.lists(st.floats(0, 1), max_size=30))
def test_ticks_never_crowd(positions):
    kept = [position for position, _ in colormaps.spaced([(p, "") for p in positions], gap=0.1)]
    assert all(b - a >= 0.1 for a, b in pairwise(kept))


@pytest.mark.parametrize(("near_m", "far_m"), [(0.45, 4.0), (4.0, 200.0), (1.0, 1.1)])
def test_every_depth_bar_is_labelled_at_both_ends(near_m, far_m):
    first, *_, last = colormaps.depth_scale((near_m, far_m)).ticks
    assert (first, last) == ((0.0, f"{far_m:g}"), (1.0, f"{near_m:g}"))


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
    drawing = plots.svg(plots.curves_figure, _curves(), "case0")
    told = ("tolerated error [cm]", 'id="case0-precision-curve-2"', "currentColor")
    for words in ("Alg1/H", "Alg1/A", "mine", *told):
        assert words in drawing
    assert drawing.split(">", 1)[0].count("width=") == 0
    assert plots.svg(plots.curves_figure, _curves(), "case0") == drawing


@pytest.mark.parametrize("order", [1, -1])
def test_a_slice_is_the_same_whichever_way_its_planes_run(order):
    rho = np.linspace(2.0, 0.25, 20)
    votes = np.random.default_rng(0).random((20, 30))
    depth_m, mask = np.full(30, 1.0), np.arange(30) % 2 == 0
    truth_m = np.where(np.arange(30) < 5, np.nan, 1.1)
    piece = plots.DsiSlice(12, rho[::order], votes[::order], depth_m, mask, truth_m)
    reference = plots.DsiSlice(12, rho, votes, depth_m, mask, truth_m)
    assert plots.svg(plots.slice_figure, piece) == plots.svg(plots.slice_figure, reference)
    assert "image row 12" in plots.svg(plots.slice_figure, piece)
    assert "true depth" in plots.svg(plots.slice_figure, piece)


def test_slices_of_a_window_look_as_if_laid_out_alone_and_may_be_empty():
    rng, rho = np.random.default_rng(1), np.linspace(2.0, 0.25, 20)
    truth_m, draw = np.full(30, 1.1), plots.SliceFigures()
    for depth_m in (0.6, 1.0, 3.0):
        mask = rng.random(30) < 0.5
        piece = plots.DsiSlice(12, rho, rng.random((20, 30)), np.full(30, depth_m), mask, truth_m)
        assert plots.svg(draw, piece) == plots.svg(plots.slice_figure, piece)
    piece = plots.DsiSlice(
        0, np.array([1.0, 0.5]), np.zeros((2, 4)), np.zeros(4), np.zeros(4, bool)
    )
    assert "true depth" not in plots.svg(plots.slice_figure, piece)
