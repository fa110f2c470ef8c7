"""Regions of ground truth, and why pixels are bad: by construction, by hand and by slow twin."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import naive_scoring
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.outlier_causes import (
    CAUSES,
    EventCounts,
    OutlierClassifier,
    count_events,
    counts_by_cause,
    first_causes,
    pixel_of,
    pooled_causes,
)
from eventsweep.eval.scoring.pairing import Truth, bad_pixels
from eventsweep.eval.scoring.regions import (
    away_from_border,
    grown,
    near_boundary,
    on_view,
    region_masks,
    texture_edges,
)

WIDTH, HEIGHT, FOCAL, BASELINE, WALL_M = 64, 48, 100.0, 0.1, 2.0
CAMERA = Camera(WIDTH, HEIGHT, FOCAL, FOCAL, 31.5, 23.5)
PERIOD_PX = 10


def rig():
    right = np.eye(4)
    right[0, 3] = BASELINE
    return Rig("test", (CAMERA, CAMERA), (np.eye(4), right))


def stripes(disparity_px):
    """Vertical sine stripes; steepest, and rising, where the column is a multiple of the period."""
    columns = np.arange(WIDTH) + disparity_px
    row = 128 + 100 * np.sin(2 * np.pi * columns / PERIOD_PX)
    return np.tile(row, (HEIGHT, 1)).astype(np.uint8)


def world(depths=None):
    """A striped wall: at 2 m the disparity is 5 px."""
    wall = np.full((HEIGHT, WIDTH), WALL_M, np.float32)
    depths = depths or (wall, wall)
    images = stripes(0), stripes(FOCAL * BASELINE / WALL_M)
    return SimpleNamespace(
        rig=rig(),
        trajectory=Trajectory.from_matrices([0, 1000], np.stack([np.eye(4)] * 2)),
        truth_depth_m=lambda camera, t_us: depths[camera],
        truth_intensity=lambda camera, t_us: images[camera],
    )


def counts(image, noise=None):
    """Counts in one piece of time, the camera in camera 0's or 1's place."""
    T = np.stack([np.eye(4)])
    return EventCounts(CAMERA, T, image[None], None if noise is None else noise[None])


def both_counts(left, right, noise=None):
    moved = np.eye(4)
    moved[0, 3] = -BASELINE
    other = EventCounts(CAMERA, moved[None], right[None], None if noise is None else noise[None])
    return counts(left, noise), other


def full(value):
    return np.full((HEIGHT, WIDTH), value, np.uint16)


def causes(disparity_px, event_counts, sequence=None, *, column=30, range_m=(0.5, 6.0), **regions):
    """Why one pixel with an estimate of that disparity is bad."""
    truth_m = np.full((HEIGHT, WIDTH), WALL_M, np.float32)
    classifier = OutlierClassifier(
        sequence or world(), 500, event_counts, truth_m, range_m, regions
    )
    bad = np.zeros((HEIGHT, WIDTH), bool)
    bad[24, column] = True
    estimate_m = np.full((HEIGHT, WIDTH), FOCAL * BASELINE / disparity_px)
    found = classifier.count(estimate_m, bad)
    assert sum(found.values()) == 1
    return next(cause for cause, count in found.items() if count)


def test_an_edge_one_period_away_is_repeated_structure_and_half_a_period_is_not():
    plenty = both_counts(full(9), full(9))
    assert causes(15, plenty) == "repeated"
    # Half a period away, the edge has the other sign; 1.5 px away, it is the same edge.
    assert causes(10, plenty) == "ambiguous"
    assert causes(6.5, plenty) == "ambiguous"


def test_fewer_events_for_the_wrong_point_blame_the_method():
    right = full(9)
    right[:, 19:22] = 2
    assert causes(10, both_counts(full(9), right)) == "other"


def test_too_few_events_in_one_camera_are_too_few():
    assert causes(10, both_counts(full(9), full(2))) == "few_events"
    assert causes(10, both_counts(full(2), full(9))) == "few_events"
    assert causes(10, both_counts(full(3), full(3))) == "ambiguous"


def test_noise_is_the_majority_of_labels_where_the_wrong_point_would_be_seen():
    assert causes(10, both_counts(full(8), full(8), full(5))) == "noise"
    assert causes(10, both_counts(full(8), full(8), full(4))) == "ambiguous"


def test_truth_beyond_the_planes_is_out_of_range_before_all_else():
    plenty, here = both_counts(full(9), full(9)), np.ones((HEIGHT, WIDTH), bool)
    assert causes(15, plenty, range_m=(0.5, 1.5), moving=here, boundary=here) == "out_of_range"
    assert causes(15, plenty, range_m=(2.5, 6.0)) == "out_of_range"
    assert causes(15, plenty, moving=here, boundary=here) == "moving"
    assert causes(15, plenty, boundary=here) == "occlusion"


def test_a_point_that_another_camera_does_not_see_is_occluded():
    wall = np.full((HEIGHT, WIDTH), WALL_M, np.float32)
    hidden = wall.copy()
    hidden[:, 20:30] = 1.0  # in front of where the right camera would see column 30
    assert causes(15, both_counts(full(9), full(9)), world((wall, hidden))) == "occlusion"


def test_a_point_outside_the_other_camera_is_not_compared_there():
    plenty = both_counts(full(9), full(9))
    assert causes(15, plenty, column=4) == "few_events"


def test_no_bad_pixels_have_no_causes():
    classifier = OutlierClassifier(
        world(), 500, both_counts(full(1), full(1)), np.ones((HEIGHT, WIDTH)), (1, 2)
    )
    found = classifier.count(np.ones((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH), bool))
    assert found == dict.fromkeys(CAUSES, 0)


flag_arrays = hnp.arrays(bool, 7)


@given(st.dictionaries(st.sampled_from(list(CAUSES)[:-1]), flag_arrays))
def test_each_pixel_has_the_first_cause_that_applies(flags):
    expected = dict.fromkeys(CAUSES, 0)
    for n in range(7):
        first = next((c for c in CAUSES if c in flags and flags[c][n]), "other")
        expected[first] += 1
    assert counts_by_cause(first_causes(flags, 7)) == expected
    assert sum(expected.values()) == 7


def test_pooled_causes_add_up_or_are_unknown():
    one, two = ({cause: k for k, cause in enumerate(CAUSES)} for _ in range(2))
    assert pooled_causes([one, two]) == {cause: 2 * k for k, cause in enumerate(CAUSES)}
    assert pooled_causes([one, None]) is None
    assert pooled_causes([]) is None


def test_bad_pixels_are_those_of_the_outlier_share():
    truth = Truth(np.full((1, 5), 2.0), np.array([[1, 1, 1, 1, 0]], bool), 100.0, 0.1)
    depth_m = np.array([[2.0, 2.3, 1.7, 2.1, 9.0]])
    mask = np.array([[1, 1, 1, 1, 1]], bool)
    np.testing.assert_array_equal(bad_pixels((depth_m, mask), truth), [[0, 1, 1, 0, 0]])


@pytest.mark.parametrize("seed", range(3))
def test_events_near_points_equal_their_slow_twin(seed):
    rng = np.random.default_rng(seed)
    single = rng.integers(0, 3, (4, HEIGHT, WIDTH))
    poses = np.stack([np.eye(4)] * 4)
    poses[:, 0, 3] = rng.normal(0, 0.1, 4)
    poses[:, 2, 3] = rng.normal(0, 0.1, 4)
    points = rng.uniform((-1.2, -0.9, -0.5), (1.2, 0.9, 3.0), (60, 3))

    def events(camera, t0_us, t1_us):
        rows, columns = np.nonzero(single[t0_us // 250])
        times = single[t0_us // 250][rows, columns]
        return Columns(np.repeat(columns, times), np.repeat(rows, times))

    T_world_body = np.linalg.inv(poses)
    sequence = SimpleNamespace(
        rig=Rig("one", (CAMERA,), (np.eye(4),)),
        trajectory=Trajectory.from_matrices([125, 375, 625, 875], T_world_body),
        events=events,
        manifest=SimpleNamespace(files={}),
    )
    found = count_events(sequence, 0, 0, 1000, slices=4)
    got, noise = found.near(points)
    np.testing.assert_array_equal(got, naive_scoring.events_near(CAMERA, poses, single, points))
    assert not noise.any()
    assert got.sum() > 0


class Columns(SimpleNamespace):
    """Events of which only the pixels matter."""

    def __init__(self, x, y):
        super().__init__(x=x.astype(np.uint16), y=y.astype(np.uint16))

    def __len__(self):
        return len(self.x)


def test_pixels_of_points_behind_or_beside_the_sensor_are_none():
    points = np.array([[0, 0, -1.0], [9, 0, 1.0], [0, 0, 1.0]])
    row, column, inside = pixel_of(CAMERA, points)
    np.testing.assert_array_equal(inside, [False, False, True])
    assert (row[2], column[2]) == (24, 32)
    assert (row[:2] == 0).all()


@given(hnp.arrays(np.uint8, (6, 7)), st.floats(0.01, 2))
def test_texture_edges_equal_their_slow_twin(intensity, contrast):
    got = texture_edges(intensity, contrast)
    np.testing.assert_array_equal(got, naive_scoring.edges(intensity, contrast))
    assert not (texture_edges(intensity, 2 * contrast) & ~got).any()


@given(hnp.arrays(bool, (6, 7)), st.integers(0, 8))
def test_grown_masks_equal_their_slow_twin(mask, radius):
    np.testing.assert_array_equal(grown(mask, radius), naive_scoring.grown(mask, radius))


def test_boundaries_reach_as_far_as_they_are_told_to():
    depth_m = np.full((9, 12), 3.0)
    depth_m[:, 6:] = 1.0
    for radius in (1, 2, 3):
        marked = near_boundary(depth_m, radius)
        expected = (np.arange(12) >= 6 - radius) & (np.arange(12) < 6 + radius)
        np.testing.assert_array_equal(marked, np.tile(expected, (9, 1)))


def test_a_border_may_be_left_out_and_may_leave_nothing():
    inside = away_from_border((4, 5), 1)
    assert inside.sum() == 6
    assert not away_from_border((4, 5), 9).any()
    truth = Truth(np.ones((4, 5)), np.ones((4, 5), bool), 100.0, 0.1, border_px=1)
    np.testing.assert_array_equal(truth.scored, inside)


@pytest.mark.parametrize("k1", [-0.2, 0.1])
def test_a_distorted_sensor_is_looked_up_where_the_view_s_rays_meet_it(k1):
    camera = Camera(40, 30, 30.0, 30.0, 19.5, 14.5, "radtan", (k1, 0.02, 0.0, 0.0))
    rows, columns = np.mgrid[:30, :40]
    number = (rows * 40 + columns + 1).astype(np.int32)
    found = on_view(number, camera)
    met = set()
    for row, column in np.ndindex(30, 40):
        bearing = camera.undistorted().unproject([column, row])
        u, v = np.rint(camera.project([*bearing, 1.0])).astype(int)
        met.add((u, v))
        there = 0 <= u < 40 and 0 <= v < 30
        assert found[row, column] == (number[v, u] if there else 0)
    if k1 > 0:  # the view shows the sensor's rim, and what lies beyond it
        assert {u for u, _ in met} > set(range(40))
        assert {v for _, v in met} > set(range(30))
    assert on_view(number, camera.undistorted()) is number


def test_regions_of_a_view_are_complements_and_need_what_they_need():
    depth_m = np.full((HEIGHT, WIDTH), WALL_M, np.float32)
    depth_m[:, 40:] = 1.0
    sequence = world()
    moving = np.zeros((HEIGHT, WIDTH), bool)
    moving[:4] = True
    sequence.truth_names = lambda camera: ("segmentation",)
    sequence.truth_dynamic = lambda camera, t_us: moving
    found = region_masks(sequence, 500, depth_m, EvalConfig())
    np.testing.assert_array_equal(found["interior"], ~found["boundary"])
    np.testing.assert_array_equal(found["static"], ~moving)
    np.testing.assert_array_equal(found["moving"], moving)
    assert found["boundary"].sum() == 4 * HEIGHT
    sequence.truth_names = lambda camera: ()
    assert set(region_masks(sequence, 500, depth_m, EvalConfig())) == {
        "interior", "boundary", "edges",
    }  # fmt: skip
