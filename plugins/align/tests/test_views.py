"""Depth and pictures between cameras of other size, lens and place, against a world by formula."""

import cv2
import numpy as np
import pytest

import panel_world as world
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.align.views import View, carried, inverse, known_depth_m, shown_in
from eventsweep.plugins.align.views_kernels import OCCLUDED, OUTSIDE, SEEN, UNKNOWN

T_EYE, T_GREY = world.at(0.02, 0.01, -0.1, (1, 2, 0)), world.at(0.12, -0.06, -0.05, (-1, 1, 3))
BEYOND = Camera(640, 480, 130.0, 129.0, 320.0, 240.0)


@pytest.fixture(scope="module")
def seen():
    """Both cameras; exact depth and light; and the grey one's picture as the eye sees it."""
    eye, grey = View(world.EYE, T_EYE), View(world.GREY, T_GREY)
    depth_m, light, _ = world.hits(world.EYE, T_EYE)
    # The panel hides things from the grey camera that the eye does not look at: both know.
    wide = View(BEYOND, T_EYE)
    both = [(inverse(world.hits(BEYOND, T_EYE)[0].astype(np.float32)), wide)]
    rho = inverse(depth_m.astype(np.float32))
    picture = (255 * world.hits(world.GREY, T_GREY)[1]).astype(np.float32)
    image, mask = shown_in(eye, rho, picture, grey, carried(both, grey))
    return eye, grey, depth_m, light, image, mask


def points_of(view, depth_m):
    rays = view.camera.ray_table() * depth_m[..., None]
    return rays @ view.T_world_cam[:3, :3].T + view.T_world_cam[:3, 3]


def test_a_frame_falls_on_the_event_cameras_pixels_within_a_tenth_of_a_pixel(seen):
    """The displacement that explains the difference from light by formula, patch by patch."""
    _, _, _, light, image, mask = seen
    by_row, by_column = np.gradient(255 * light)
    difference = image - 255 * light
    panel = world.hits(world.EYE, T_EYE)[2].astype(np.uint8)
    edge = cv2.dilate(panel, np.ones((5, 5))) != cv2.erode(panel, np.ones((5, 5)))
    smooth = (mask == SEEN) & ~edge
    shifts = []
    for y in range(0, 120, 20):
        for x in range(0, 160, 20):
            some = np.zeros(mask.shape, bool)
            some[y : y + 20, x : x + 20] = True
            some &= smooth
            if some.sum() > 100:
                slope = np.stack([by_column[some], by_row[some]], -1)
                shifts.append(np.linalg.lstsq(slope, difference[some], rcond=None)[0])
    assert len(shifts) > 20
    assert np.abs(shifts).max() < 0.1


def test_hidden_pixels_are_marked_and_others_are_not(seen):
    """Against the segment from each point to the other camera's centre."""
    eye, grey, depth_m, _, _, mask = seen
    points = points_of(eye, depth_m)
    hidden = world.hidden(points, T_GREY)
    uv_px, _ = grey.seen(points)
    inside = np.isfinite(uv_px).all(-1) & (uv_px >= 0).all(-1)
    inside &= (uv_px[..., 0] <= world.GREY.width_px - 1) & (
        uv_px[..., 1] <= world.GREY.height_px - 1
    )
    assert (hidden & inside).sum() > 300
    assert (mask[hidden & inside] == OCCLUDED).mean() >= 0.99
    assert (mask[~hidden & inside] == SEEN).mean() >= 0.98  # the rest: a pixel along the panel
    assert (mask[~inside] == OUTSIDE).all()
    assert not (mask == UNKNOWN).any()


@pytest.mark.parametrize("target", [world.GREY, world.EYE, BEYOND])
def test_carried_depth_is_that_of_the_ray_through_each_pixel(target):
    """On planes it is exact, whatever the lens; panel and wall never mix."""
    source = View(world.EYE, T_EYE)
    rho = inverse(world.hits(world.EYE, T_EYE)[0].astype(np.float32))
    view = View(target, T_GREY)
    depth_m = known_depth_m(carried([(rho, source)], view))
    true_m, _, panel = world.hits(target, T_GREY)
    known = np.isfinite(depth_m)
    assert known.sum() > 10_000
    error = np.abs(depth_m[known] / true_m[known] - 1)
    assert np.percentile(error, 90) < 1e-3
    # One of the two surfaces, never between them.
    eye_z = true_m.copy()
    eye_z[panel] = np.nan
    middle = (depth_m > true_m[panel].max() * 1.2) & (depth_m < np.nanmin(eye_z) * 0.8)
    assert not middle[known].any()


def test_gaps_of_semi_dense_depth_stay_gaps():
    """A single pixel becomes a patch of the ratio's size, and nothing else."""
    camera = Camera(40, 30, 30.0, 30.0, 20.0, 15.0)
    larger = Camera(120, 90, 90.0, 90.0, 61.0, 46.0)  # three of its pixels are one
    rho = np.full((30, 40), -1.0)
    rho[10, 12] = 0.5
    out = carried([(rho, View(camera, np.eye(4)))], View(larger, np.eye(4)))
    rows, columns = np.nonzero(out >= 0)
    assert sorted(set(rows)) == [30, 31, 32]
    assert sorted(set(columns)) == [36, 37, 38]
    np.testing.assert_allclose(out[rows, columns], 0.5)


def test_what_is_infinitely_far_only_turns():
    camera = Camera(40, 30, 30.0, 30.0, 20.0, 15.0)
    rho = inverse(np.full((30, 40), np.inf, np.float32), sky=True)
    moved = carried([(rho, View(camera, np.eye(4)))], View(camera, world.at(5.0, 3.0, -2.0)))
    np.testing.assert_array_equal(moved, 0.0)
    assert (inverse(np.full((2, 2), np.inf, np.float32)) < 0).all()


def test_a_lens_that_folds_shows_nothing_from_beyond_its_view():
    """Beyond the turning point of its polynomial, directions come back into the picture."""
    camera = Camera(100, 80, 80.0, 80.0, 50.0, 40.0, "radtan", (-0.25, 0.0, 0.0, 0.0))
    x = np.linspace(0, 3, 400)
    points = np.stack([x, np.zeros(400), np.ones(400)], -1)
    folded = camera.project(points)
    assert ((folded[:, 0] < 99) & (x > 1.5)).any()
    uv_px, _ = View(camera, np.eye(4)).seen(points)
    inside = np.isfinite(uv_px[:, 0])
    assert 0.7 < x[inside].max() < 1.155  # the turning point
    np.testing.assert_allclose(camera.unproject(uv_px[inside])[:, 0], x[inside], atol=1e-6)


def test_a_lens_there_and_back_is_where_it_was():
    for camera in (world.EYE, world.GREY):
        view = View(camera, T_GREY)
        points = points_of(view, np.full((camera.height_px, camera.width_px), 1.7))
        uv_px, rho = view.seen(points)
        rows, columns = np.indices((camera.height_px, camera.width_px))
        np.testing.assert_allclose(uv_px, np.stack([columns, rows], -1), atol=1e-5)
        np.testing.assert_allclose(rho, 1 / 1.7)
