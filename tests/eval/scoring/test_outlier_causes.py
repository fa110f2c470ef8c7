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
from eventsweep.eval.scoring import outlier_causes
from eventsweep.eval.scoring import regions as areas
from eventsweep.eval.scoring.method_scores import cause_scores
from eventsweep.eval.scoring.pairing import Truth, bad_pixels

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


def both_counts(left, right, noise=None):
    """Counts in one piece of time, the cameras in their places."""
    moved = np.eye(4)
    moved[0, 3] = -BASELINE
    labels = None if noise is None else full(noise)[None]
    return tuple(
        outlier_causes.EventCounts(
            CAMERA, T[None], (full(n) if isinstance(n, int) else n)[None], labels
        )
        for T, n in ((np.eye(4), left), (moved, right))
    )


def full(value):
    return np.full((HEIGHT, WIDTH), value, np.uint16)


def causes(disparity_px, event_counts, sequence=None, *, column=30, range_m=(0.5, 6.0), **regions):
    """Why one pixel with an estimate of that disparity is bad."""
    truth_m, bad = np.full((HEIGHT, WIDTH), WALL_M, np.float32), np.zeros((HEIGHT, WIDTH), bool)
    about = (event_counts, truth_m, range_m, regions)
    classifier = outlier_causes.OutlierClassifier(sequence or world(), 500, *about)
    bad[24, column] = True
    found = classifier.count(np.full((HEIGHT, WIDTH), FOCAL * BASELINE / disparity_px), bad)
    assert sum(found.values()) == 1
    return next(cause for cause, count in found.items() if count)


HERE = np.ones((HEIGHT, WIDTH), bool)
FEW = full(9)
FEW[:, 19:22] = 2
BOTH = {"moving": HERE, "boundary": HERE}


@pytest.mark.parametrize(("disparity_px", "events", "more", "cause"), [
    (15, (9, 9), {}, "repeated"),  # an edge one period away
    # Half a period away, the edge has the other sign; 1.5 px away, it is the same edge.
    (10, (9, 9), {}, "ambiguous"), (6.5, (9, 9), {}, "ambiguous"),
    # Fewer events for the wrong point blame the method.
    (10, (9, FEW), {}, "other"),
    # Too few events in one camera are too few.
    (10, (9, 2), {}, "few_events"), (10, (2, 9), {}, "few_events"), (10, (3, 3), {}, "ambiguous"),
    # Noise is the majority of labels where the wrong point would be seen.
    (10, (8, 8, 5), {}, "noise"), (10, (8, 8, 4), {}, "ambiguous"),
    # Truth beyond the planes is out of range before all else.
    (15, (9, 9), {"range_m": (0.5, 1.5), **BOTH}, "out_of_range"),
    (15, (9, 9), {"range_m": (2.5, 6.0)}, "out_of_range"), (15, (9, 9), BOTH, "moving"),
    (15, (9, 9), {"boundary": HERE}, "occlusion"),
    # A point outside the other camera is not compared there.
    (15, (9, 9), {"column": 4}, "few_events"),
])  # fmt: skip
def test_the_cause_of_an_error_is_that_by_construction(disparity_px, events, more, cause):
    assert causes(disparity_px, both_counts(*events), **more) == cause


def test_a_point_that_another_camera_does_not_see_is_occluded_and_no_pixel_has_no_cause():
    wall = np.full((HEIGHT, WIDTH), WALL_M, np.float32)
    hidden = wall.copy()
    hidden[:, 20:30] = 1.0  # in front of where the right camera would see column 30
    assert causes(15, both_counts(9, 9), world((wall, hidden))) == "occlusion"
    ones = np.ones((HEIGHT, WIDTH))
    about = world(), 500, both_counts(1, 1), ones, (1, 2)
    known = outlier_causes.OutlierClassifier(*about, {"moving": ones == 0})
    assert known.count(ones, ones == 0) == dict.fromkeys(outlier_causes.CAUSES, 0)
    assert "moving" not in outlier_causes.OutlierClassifier(*about).count(ones, ones == 0)


flag_arrays = hnp.arrays(bool, 7)


@given(st.dictionaries(st.sampled_from(list(outlier_causes.CAUSES)[:-1]), flag_arrays))
def test_each_pixel_has_the_first_cause_that_applies(flags):
    expected = dict.fromkeys(outlier_causes.CAUSES, 0)
    for n in range(7):
        first = next((c for c in outlier_causes.CAUSES if c in flags and flags[c][n]), "other")
        expected[first] += 1
    assert outlier_causes.counts_by_cause(outlier_causes.first_causes(flags, 7)) == expected
    assert sum(expected.values()) == 7


def test_bad_pixels_are_those_of_the_outlier_share_and_pooled_causes_add_up():
    one, two = ({cause: k for k, cause in enumerate(outlier_causes.CAUSES)} for _ in range(2))
    assert outlier_causes.pooled_causes([one, two]) == {
        cause: 2 * k for k, cause in enumerate(outlier_causes.CAUSES)
    }
    assert outlier_causes.pooled_causes([one, None]) is None
    without = {cause: n for cause, n in two.items() if cause != "moving"}
    assert "moving" not in outlier_causes.pooled_causes([one, without])
    shares = {score.metric: score.value for score in cause_scores(without)}
    assert np.isnan(shares["cause_moving"])
    assert shares["cause_noise"] > 0
    assert outlier_causes.pooled_causes([]) is None
    truth = Truth(np.full((1, 5), 2.0), np.array([[1, 1, 1, 1, 0]], bool), 100.0, 0.1)
    depth_m = np.array([[2.0, 2.3, 1.7, 2.1, 9.0]])
    mask = np.array([[1, 1, 1, 1, 1]], bool)
    np.testing.assert_array_equal(bad_pixels((depth_m, mask), truth), [[0, 1, 1, 0, 0]])


@pytest.mark.parametrize("seed", range(3))
def test_events_near_points_equal_their_slow_twin(seed):
    rng = np.random.default_rng(seed)
    single = rng.integers(0, 3, (4, HEIGHT, WIDTH))
    poses = np.stack([np.eye(4)] * 4)
    for axis in (0, 2):
        poses[:, axis, 3] = rng.normal(0, 0.1, 4)
    points = rng.uniform((-1.2, -0.9, -0.5), (1.2, 0.9, 3.0), (60, 3))

    def events(camera, t0_us, t1_us):
        rows, columns = np.nonzero(single[t0_us // 250])
        times = single[t0_us // 250][rows, columns]
        return Columns(np.repeat(columns, times), np.repeat(rows, times))

    sequence = SimpleNamespace(
        rig=Rig("one", (CAMERA,), (np.eye(4),)), events=events,
        trajectory=Trajectory.from_matrices([125, 375, 625, 875], np.linalg.inv(poses)),
        manifest=SimpleNamespace(files={}),
    )  # fmt: skip
    got, noise = outlier_causes.count_events(sequence, 0, 0, 1000, slices=4).near(points)
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
    row, column, inside = outlier_causes.pixel_of(CAMERA, points)
    np.testing.assert_array_equal(inside, [False, False, True])
    assert (row[2], column[2]) == (24, 32)
    assert (row[:2] == 0).all()


@given(hnp.arrays(np.uint8, (6, 7)), st.floats(0.01, 2))
def test_texture_edges_equal_their_slow_twin(intensity, contrast):
    got = areas.texture_edges(intensity, contrast)
    np.testing.assert_array_equal(got, naive_scoring.edges(intensity, contrast))
    assert not (areas.texture_edges(intensity, 2 * contrast) & ~got).any()


@given(hnp.arrays(bool, (6, 7)), st.integers(0, 8))
def test_grown_masks_equal_their_slow_twin(mask, radius):
    np.testing.assert_array_equal(areas.grown(mask, radius), naive_scoring.grown(mask, radius))


def test_boundaries_and_borders_reach_as_far_as_they_are_told_to():
    depth_m = np.full((9, 12), 3.0)
    depth_m[:, 6:] = 1.0
    for radius in (1, 2, 3):
        marked = areas.near_boundary(depth_m, radius)
        expected = (np.arange(12) >= 6 - radius) & (np.arange(12) < 6 + radius)
        np.testing.assert_array_equal(marked, np.tile(expected, (9, 1)))
    inside = areas.away_from_border((4, 5), 1)
    assert inside.sum() == 6
    assert not areas.away_from_border((4, 5), 9).any()
    truth = Truth(np.ones((4, 5)), np.ones((4, 5), bool), 100.0, 0.1, border_px=1)
    np.testing.assert_array_equal(truth.scored, inside)


@pytest.mark.parametrize("k1", [-0.2, 0.1])
def test_a_distorted_sensor_is_looked_up_where_the_view_s_rays_meet_it(k1):
    camera = Camera(40, 30, 30.0, 30.0, 19.5, 14.5, "radtan", (k1, 0.02, 0.0, 0.0))
    rows, columns = np.mgrid[:30, :40]
    number = (rows * 40 + columns + 1).astype(np.int32)
    found = areas.on_view(number, camera)
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
    assert areas.on_view(number, camera.undistorted()) is number


def test_regions_of_a_view_are_complements_and_need_what_they_need():
    depth_m = np.full((HEIGHT, WIDTH), WALL_M, np.float32)
    depth_m[:, 40:] = 1.0
    sequence = world()
    moving = np.zeros((HEIGHT, WIDTH), bool)
    moving[:4] = True
    sequence.truth_names = lambda camera: ("segmentation",)
    sequence.truth_dynamic = lambda camera, t_us: moving
    found = areas.region_masks(sequence, 500, depth_m, EvalConfig())
    np.testing.assert_array_equal(found["interior"], ~found["boundary"])
    np.testing.assert_array_equal(found["static"], ~moving)
    np.testing.assert_array_equal(found["moving"], moving)
    assert found["boundary"].sum() == 4 * HEIGHT
    sequence.truth_names = lambda camera: ()
    assert set(areas.region_masks(sequence, 500, depth_m, EvalConfig())) == {
        "interior", "boundary", "edges",
    }  # fmt: skip
