"""Errors of trajectories: laws that hold whatever the numbers are, and slow twins."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

import eventsweep as es
import naive_trajectories as naive
from eventsweep.emvs.geometry import se3
from eventsweep.eval.scoring.trajectories.errors import Step, relative_errors, steps_of
from made_trajectories import made, moved, noisy, on_clock, part, room
from refusals import line_of

seeds = st.integers(0, 10**6)
TRUTH = room(6.0, rate_hz=20)
NO_SIZE = {"scale", "scale_error"}
NOISY = noisy(TRUTH)


def scored(estimate, truth=TRUTH, **settings):
    return es.score_trajectory(estimate, truth, es.TrajectoryConfig(**settings)).values


@cache
def unmoved(align="se3"):
    return scored(NOISY, align=align)


def alike(one, two, leave_out=frozenset(), tolerance=1e-7):
    for name, value in one.items():
        if name not in leave_out:
            assert two[name] == pytest.approx(value, rel=tolerance, abs=tolerance), name


@pytest.mark.parametrize("associate", ["one-to-one", "nearest", "interpolate"])
def test_the_truth_itself_has_no_error(associate):
    values = scored(TRUTH, associate=associate)
    assert {name: value for name, value in values.items() if abs(value) > 1e-9} == {
        "scale": pytest.approx(1), "way": values["way"], "duration": 6.0, "paired_poses": 121,
        "time_covered": 100,
    }  # fmt: skip


@given(seeds)
def test_no_rigid_motion_has_any_effect_and_relative_errors_need_no_alignment(seed):
    alike(unmoved(), scored(moved(NOISY, seed)))
    alike(unmoved(), scored(NOISY, moved(TRUTH, seed)))
    aligned, raw = unmoved(), scored(moved(NOISY, seed), align="none")
    names = [name for name in aligned if name.startswith(("rpe", "drift"))]
    assert len(names) == 20
    alike({name: aligned[name] for name in names}, raw)


@given(seeds, st.floats(0.05, 20))
def test_with_a_free_scale_no_similarity_has_any_effect(seed, scale):
    one, other = unmoved("sim3"), scored(moved(NOISY, seed, scale), align="sim3")
    alike(one, other, NO_SIZE)
    assert other["scale"] * scale == pytest.approx(one["scale"])


def test_errors_need_no_alignment_and_after_it_poses_lie_upon_the_truth():
    away_m = TRUTH.positions_m + np.array([0, 0.3, 0.4])
    values = scored(es.Trajectory(TRUTH.t_us, away_m, TRUTH.quats_xyzw), align="none")
    found = [values[f"ate_{name}"] for name in ("rmse", "mean", "median", "max")]
    assert (found, values["drift"]) == (pytest.approx([0.5] * 4), pytest.approx(0, abs=1e-9))
    score = es.score_trajectory(moved(TRUTH), TRUTH)
    T = score.world_odom.poses(score.matched.T_odom_body)
    np.testing.assert_allclose(se3.inverse(T) @ score.matched.T_world_body,
                               np.broadcast_to(np.eye(4), T.shape), atol=1e-9)  # fmt: skip


def straight(t_s, speed_m_s=1.0):
    t_s = np.asarray(t_s)
    position_m = np.stack([speed_m_s * t_s, 0 * t_s, 0 * t_s], axis=1)
    return made(t_s, position_m, Rotation.identity(len(t_s)))


@given(st.floats(0.01, 20), st.booleans(), hnp.arrays(float, 60, elements=st.floats(0.02, 0.2)))
def test_a_pure_drift_of_p_percent_is_p_percent(percent, too_long, steps_s):
    """However the poses are spaced, along the way or across it."""
    t_s = np.round(np.cumsum(steps_s), 6)
    truth, error = straight(t_s), percent / 100
    along = straight(t_s, 1 + error if too_long else 1 - error)
    across = truth.positions_m + np.outer(error * t_s, [0, 0.6, 0.8])
    for estimate in (along, es.Trajectory(truth.t_us, across, truth.quats_xyzw)):
        assert scored(estimate, truth)["drift"] == pytest.approx(percent, rel=1e-6)
    assert scored(along, truth)["scale"] == pytest.approx(1 / (1 + (error, -error)[not too_long]))


@given(st.floats(0.1, 20))
def test_a_pure_drift_of_rotation_is_found_in_degrees_a_metre(rate_deg_m):
    t_s = np.linspace(0, 5, 101)
    turned = Rotation.from_rotvec(np.radians(rate_deg_m) * np.outer(t_s, [0, 0, 1]))
    estimate = made(t_s, straight(t_s).positions_m, turned)
    assert scored(estimate, straight(t_s))["drift_rotation"] == pytest.approx(rate_deg_m)


@given(hnp.arrays(float, st.integers(1, 40), elements=st.sampled_from([0.0, 0.1, 0.5, 1.0, 2.0])),
       st.sampled_from([0.1, 0.5, 0.55, 1.0, 3.0, 100.0]))  # fmt: skip
def test_steps_equal_their_slow_twin(increments, length):
    """Standing still and ties included; no length has no steps."""
    progress = np.cumsum(increments)
    start, end = steps_of(progress, length)
    assert list(zip(start.tolist(), end.tolist(), strict=True)) == naive.steps(progress, length)
    assert [len(one) for one in steps_of(np.zeros(5), 0.0)] == [0, 0]


@pytest.mark.parametrize("step", [Step(20, "pct"), Step(0.5, "m"), Step(0.4, "s"), Step(9, "deg")])
def test_relative_errors_equal_their_slow_twin(step):
    score = es.score_trajectory(moved(noisy(TRUTH), scale=1.1), TRUTH)
    found = relative_errors(score.matched, step, scale=0.9)
    T = score.matched.T_world_body
    turns = [naive.angle_deg((np.linalg.inv(a) @ b)[:3, :3]) for a, b in pairwise(T)]
    ways = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)
    steps = {"s": np.full(len(T) - 1, 0.05), "deg": np.array(turns)}.get(step.unit, ways)
    progress = np.concatenate([[0], np.cumsum(steps)])
    length = step.value / 100 * ways.sum() if step.unit == "pct" else step.value
    pairs = naive.steps(progress, length)
    assert list(zip(found.start, found.end, strict=True)) == pairs
    assert len(pairs) > 20
    translation, rotation = naive.relative(T, score.matched.T_odom_body, pairs, scale=0.9)
    np.testing.assert_allclose(found.translation_m, translation, atol=1e-12)
    np.testing.assert_allclose(found.rotation_deg, rotation, atol=1e-7)


@pytest.mark.parametrize("align", ["se3", "sim3"])
def test_absolute_errors_equal_their_slow_twin(align):
    estimate = moved(noisy(TRUTH), scale=1.05)
    values = scored(estimate, align=align)
    T_odom, T_world = (one.at(one.t_us) for one in (estimate, TRUTH))
    scale, R, t = naive.horn(T_world[:, :3, 3], T_odom[:, :3, 3], with_scale=align == "sim3")
    off_m = np.linalg.norm(scale * T_odom[:, :3, 3] @ R.T + t - T_world[:, :3, 3], axis=1)
    turned = [
        naive.angle_deg(one[:3, :3].T @ R @ two[:3, :3])
        for one, two in zip(T_world, T_odom, strict=True)
    ]
    for stem, errors in (("ate", off_m), ("ate_rotation", np.array(turned))):
        expected = [np.sqrt(np.mean(errors**2)), errors.mean(), np.median(errors), errors.max()]
        found = [values[f"{stem}_{name}"] for name in ("rmse", "mean", "median", "max")]
        assert found == pytest.approx(expected, abs=1e-9)
    assert values["ate_share"] == pytest.approx(100 * values["ate_rmse"] / values["way"])


def test_time_that_is_not_covered_is_counted_however_the_track_was_lost():
    truth = room(10.0)
    late, early = part(truth, slice(200, None)), part(truth, slice(None, 701))
    torn = part(truth, np.r_[0:301, 500:1001])
    found = [scored(one, truth)["time_covered"] for one in (truth, late, early, torn)]
    assert found == pytest.approx([100, 80, 70, 80.1], abs=0.2)
    longer = room(12.0)
    assert scored(longer, truth)["time_covered"] <= 100
    # Few poses cover all of it if they come regularly.
    assert scored(part(truth, slice(None, None, 20)), truth)["time_covered"] == pytest.approx(100)


def test_what_makes_errors_small_or_large_is_told():
    estimate, slow = room(10.0, 200), room(10.0, 15)
    paired = es.score_trajectory(estimate, slow)
    assert len(paired.matched) == 151
    assert any("1850 of 2001" in one and "'interpolate'" in one for one in paired.notes)
    between = es.score_trajectory(estimate, slow, es.TrajectoryConfig(associate="interpolate"))
    assert (len(between.matched), between.notes) == (2001, ())
    assert between.values["ate_rmse"] < 0.001
    truth = room(10.0, 100)
    late = es.score_trajectory(on_clock(truth, shift_us=4000), truth)
    assert late.values["ate_rmse"] < 0.01
    (note,) = late.notes
    assert "0.004 s before or after" in note
    score = es.score_trajectory(moved(TRUTH, scale=0.8), TRUTH, es.TrajectoryConfig(align="sim3"))
    assert score.values["ate_rmse"] < 1e-9
    assert score.values["scale_error"] == pytest.approx(25)
    assert any("1.25" in note for note in score.notes)


def test_what_a_line_or_standing_still_leaves_open_is_undefined():
    truth = straight(np.linspace(0, 3, 61))
    score = es.score_trajectory(moved(truth), truth)
    assert np.isnan(score.values["ate_rotation_rmse"])
    assert score.values["ate_rmse"] < 1e-9
    assert score.values["rpe_rotation_1s"] < 1e-6
    assert any("on a line" in note for note in score.notes)
    still = made(np.linspace(0, 3, 61), np.ones((61, 3)), Rotation.identity(61))
    values = scored(still, still)
    assert values["ate_rmse"] == 0
    assert all(np.isnan(values[name]) for name in ("drift", "ate_share", "scale"))
    asked = {"align": "sim3", "rpe_times_s": (1,)}
    assert "no scale to find" in line_of(scored, still, TRUTH, **asked)


@pytest.mark.parametrize(("bow_m", "is_noted"), [(0.002, True), (0.5, False)])
def test_rotation_about_a_nearly_straight_path_is_called_uncertain(bow_m, is_noted):
    t_s = np.linspace(0, 3, 61)
    truth = made(t_s, np.stack([t_s, bow_m * np.sin(t_s), 0 * t_s], 1), Rotation.identity(61))
    beside_m = np.stack([0 * t_s, 0 * t_s, 0.001 * (-1.0) ** np.arange(61)], 1)
    estimate = es.Trajectory(truth.t_us, truth.positions_m + beside_m, truth.quats_xyzw)
    notes = es.score_trajectory(estimate, truth).notes
    assert any("so straight" in note for note in notes) == is_noted
