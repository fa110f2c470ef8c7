"""Laws: the truth scores 100 %, what is moved by 1 cm says 1 cm, half is half, a scale is found."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from eventsweep.eval.scoring.method_scores import full_name
from eventsweep.eval.scoring.metrics import GEOMETRY_METRICS, SURFACES, WITHIN_CM, WITHIN_PERCENT
from eventsweep.plugins.geometry.readers import sample_mesh
from eventsweep.plugins.geometry.score import Judge, classes, f1, metric_versions
from eventsweep.plugins.geometry.surfels import KINDS, Surfels
from eventsweep.plugins.geometry.truth import SEEN
from naive_surfaces import nearest_disc
from refusals import refused
from room_world import POLE, ROOM, box_mesh, one_view


def judge_of(*names, cell_m=0.03):
    """A judge of one picture's surfaces, of some classes only, once where cells are small."""
    truth = one_view(cell_m)
    if names:
        chosen = np.isin(truth.kind, [KINDS.index(name) for name in names])
        truth = Surfels(*(values[chosen] for values in vars(truth).values()))
    return Judge(truth)


@pytest.fixture(scope="module")
def judge():
    return judge_of()


def values(judge, points, align="none"):
    found = judge.score(points, align)
    return {score.metric: score.value for score in judge.scores(found, align)}, found


def test_the_truth_scores_100_percent_in_every_class(judge):
    scores, _ = values(judge, judge.truth.points_world)
    counts = {name: chosen.sum() for name, chosen in classes(judge.truth).items()}
    for region in ("all", *SURFACES):
        for name, metric in GEOMETRY_METRICS.items():
            value = scores[full_name(name, region)]
            if counts.get(region) == 0:
                assert np.isnan(value) or value == 0, (region, name)
            elif metric.unit == "%":
                assert value == 100, (region, name)
            else:
                assert value < 1e-6, (region, name)


@pytest.mark.parametrize("off_m", [0.01, -0.01, 0.04])
def test_moved_along_its_normals_it_is_as_wrong_as_it_was_moved(off_m):
    """Walls that meet are left out: beside them another wall may be nearer."""
    judge = judge_of("plane")
    truth = judge.truth
    inner = (np.abs(truth.points_world[:, None] - ROOM).min(axis=1) > 0.1).sum(axis=1) == 2
    points = truth.points_world[inner] + off_m * truth.normals[inner]
    scores, found = values(judge, points)
    np.testing.assert_allclose(found.to_truth_m, abs(off_m), atol=2e-5)
    assert scores["accuracy"] == pytest.approx(abs(off_m), abs=2e-6)
    for cm in WITHIN_CM:
        if abs(off_m) != cm / 100:
            right = 100 if abs(off_m) < cm / 100 else 0
            assert scores[f"surface_precision_{cm}cm"] == right


def test_half_of_it_is_half_complete_and_wholly_right(judge):
    truth = judge.truth
    order = np.argsort(truth.points_world[:, 0])
    scores, _ = values(judge, truth.points_world[order[: len(order) // 2]])
    assert scores["surface_recall_1cm"] == pytest.approx(50, abs=1)
    assert scores["surface_precision_1cm"] == 100
    assert scores["accuracy"] < 1e-6
    assert scores["surface_f1_1cm"] == pytest.approx(f1(100, scores["surface_recall_1cm"]))
    assert scores["chamfer"] == (scores["accuracy"] + scores["completion"]) / 2


@pytest.mark.parametrize(("scale", "degrees"), [(2.0, 0), (0.5, 20), (3.0, 170)])
def test_a_scale_and_a_turn_are_found_and_reported(judge, scale, degrees):
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, 0, 0.8])).as_matrix()
    points = scale * judge.truth.points_world @ turn.T + [3.0, -1.0, 7.0]
    scores, found = values(judge, points, "sim3")
    assert scores["scale"] == pytest.approx(1 / scale, rel=1e-6)
    assert scores["accuracy"] < 1e-5
    assert scores["completion"] < 1e-5
    assert scores["surface_f1_1cm"] == 100
    assert f"{scale:.6g} times" in found.notes[0]


def test_a_rigid_alignment_leaves_the_size(judge):
    turn = Rotation.from_rotvec([0.02, 0.05, -0.03]).as_matrix()
    points = judge.truth.points_world @ turn.T + [0.1, 0.05, 0]
    scores, found = values(judge, points, "se3")
    assert found.world_own.scale == 1
    assert "scale" not in scores
    assert scores["accuracy"] < 1e-5


def test_part_of_it_with_noise_is_aligned_in_scale(judge):
    """Two thirds of the surfaces, 5 mm of noise, 3 % of points anywhere: the scale within 1 %."""
    rng = np.random.default_rng(0)
    points = judge.truth.points_world
    points = points[points[:, 0] < 0.5] + rng.normal(0, 0.005, (int((points[:, 0] < 0.5).sum()), 3))
    points[::33] = rng.uniform(*ROOM, points[::33].shape)
    scores, _ = values(judge, 1.5 * points, "sim3")
    assert scores["scale"] == pytest.approx(1 / 1.5, rel=0.01)
    assert scores["accuracy_median"] < 0.006


def test_a_mesh_of_the_room_lies_on_the_room_within_float(judge):
    """Where the camera looked; the mesh goes on behind it."""
    (room, walls), (pole, sides) = map(box_mesh, (ROOM, POLE))
    vertices, faces = np.concatenate([room, pole]), np.concatenate([walls, sides + len(room)])
    points, area_m2 = sample_mesh(vertices, faces, 500.0, 0)
    edges, pole_edges = (box[1] - box[0] for box in (ROOM, POLE))
    expected = sum(2 * (e[0] * e[1] + e[1] * e[2] + e[0] * e[2]) for e in (edges, pole_edges))
    assert area_m2 == pytest.approx(expected, rel=1e-12)
    assert len(points) == int(np.ceil(500 * area_m2))
    found = judge.score(points)
    points = found.points
    seen = (np.abs(points[:, :2]) < [1.2, 0.9]).all(axis=1) & (points[:, 2] == ROOM[1, 2])
    hidden = np.abs(points[:, 0] + 0.39) < 0.2  # behind the pole
    assert (seen & ~hidden).sum() > 500
    assert found.to_truth_m[seen & ~hidden].max() < 1e-6
    own = Judge(Surfels(points, *(np.zeros((len(points), *values.shape[1:]), values.dtype)
                                  for values in list(vars(one_view()).values())[1:])))  # fmt: skip
    scores, _ = values(own, sample_mesh(vertices, faces, 500.0, 0)[0])
    assert scores["accuracy"] == scores["completion"] == 0


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 60))
def test_distances_are_those_of_the_twin(seed, count):
    """Both ways, to 1e-6, of any points near the surfaces."""
    rng = np.random.default_rng(seed)
    whole = one_view(0.03)
    chosen = rng.choice(len(whole), 400, replace=False)
    truth = Surfels(*(values[chosen] for values in vars(whole).values()))
    points = truth.points_world[rng.integers(0, 400, count)] + rng.normal(0, 0.2, (count, 3))
    points = np.concatenate([points, truth.points_world[:1]])  # one that is surely near
    judge = Judge(truth)
    found, truth = judge.score(points), judge.truth
    forth, _ = nearest_disc(found.points, truth.points_world, truth.normals, truth.radius_m)
    back, _ = nearest_disc(truth.points_world, points)
    np.testing.assert_allclose(found.to_truth_m, forth, atol=1e-6)
    np.testing.assert_allclose(found.to_points_m, back, atol=1e-6)


def test_points_count_in_the_class_that_they_lie_nearest_to(judge):
    """All classes of one kind together have every point; a share of depth is one of its own."""
    truth = judge.truth
    points = truth.points_world + 0.02 * truth.normals
    found = judge.score(points)
    scores = {score.metric: score for score in judge.scores(found)}
    kinds = [scores[f"{name}_accuracy"] for name in KINDS]
    seen = [scores[f"{name}_accuracy"] for name, *_ in SEEN]
    assert sum(one.support for one in kinds) == sum(one.support for one in seen) == len(points)
    whole = sum(one.value * one.support for one in kinds if one.support) / len(points)
    assert whole == pytest.approx(scores["accuracy"].value, rel=1e-9)
    for percent in WITHIN_PERCENT:
        right = found.to_truth_m < percent / 100 * truth.depth_m[found.nearest]
        assert scores[f"surface_precision_{percent}pct"].value == pytest.approx(100 * right.mean())
    assert scores["surface_precision_1pct"].value < scores["surface_precision_5pct"].value


def test_what_lies_elsewhere_or_in_another_unit_is_refused(judge):
    points = judge.truth.points_world
    refused(["no point lies where", "align to 'sim3'"], judge.score, points + 100)
    refused("in another unit", judge.score, points * 1000)
    with_one_outlier = np.concatenate([points, [[1e5, 0, 0]]])
    assert np.sort(judge.score(with_one_outlier).to_truth_m)[-2] < 1e-6
    small = points[:50]  # a corner of it is no other unit
    assert judge.score(small).to_truth_m.max() < 1e-6
    _, found = values(judge, points + np.array([0, 0, 0.9]))
    assert any("is it in the truth's frame?" in note for note in found.notes)


def test_one_point_can_be_scored(judge):
    scores, _ = values(judge, judge.truth.points_world[:1])
    assert scores["surface_precision_1cm"] == 100
    assert 0 < scores["surface_recall_10cm"] < 5


def test_versions_cover_every_metric_of_every_class():
    regions = ("all", *(name for name in SURFACES))
    expected = {full_name(name, region) for region in regions for name in GEOMETRY_METRICS}
    assert set(metric_versions()) == expected
    assert len(set(metric_versions().values())) > 20
