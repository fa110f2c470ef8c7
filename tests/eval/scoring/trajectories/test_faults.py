"""What is refused, each in one line that says what to do: clocks, units, too few poses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import eventsweep as es
from eventsweep.eval.report.trajectory_page import sentences
from made_trajectories import moved, noisy, on_clock, part, room
from refusals import line_of

TRUTH = room(6.0, 50)
EPOCH_US = 1_518_196_269_772_422
AT_EPOCH = on_clock(TRUTH, shift_us=EPOCH_US)


def refused(estimate, truth=TRUTH, **settings):
    message = line_of(lambda: scored(estimate, truth, **settings))
    assert len(message) < 500
    return message


def scored(estimate, truth=TRUTH, **settings):
    return es.score_trajectory(estimate, truth, es.TrajectoryConfig(**settings))


def test_clocks_that_do_not_overlap_are_refused_with_an_offset_that_helps():
    said = refused(TRUTH, AT_EPOCH)
    told = ("times from 0 to 6 s", "do not overlap", "offset_s, such as 1518196269.77242")
    assert [words for words in told if words not in said] == []
    offset_s = float(said.split("such as ")[1].split()[0])
    assert scored(TRUTH, AT_EPOCH, offset_s=offset_s).values["ate_rmse"] < 1e-4


@pytest.mark.parametrize("truth", [TRUTH, AT_EPOCH], ids=["from zero", "long ago"])
@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_another_unit_of_time_is_named(tmp_path, factor, unit, truth):
    """The cure that is named works."""
    path = tmp_path / "other.txt"
    times = [f"{t_us * factor / 1e6:.0f}" for t_us in truth.t_us]
    rows = zip(times, np.hstack([truth.positions_m, truth.quats_xyzw]), strict=True)
    path.write_text("\n".join(f"{t} {' '.join(f'{v:.12f}' for v in row)}" for t, row in rows))
    said = refused(path, truth)
    assert said.startswith(f"{path}: ")
    assert f"set unit to {unit!r}" in said
    assert scored(path, truth, unit=unit).values["ate_rmse"] < 0.002
    assert f"set truth_unit to {unit!r}" in refused(truth, path)


@pytest.mark.parametrize(
    ("factor", "name"), [(1e2, "centi"), (1e3, "milli"), (1e6, "micro"), (1e9, "nano")]
)
@pytest.mark.parametrize("align", ["se3", "none"])
def test_another_unit_of_length_is_named(factor, name, align):
    large = moved(noisy(TRUTH), scale=factor)
    assert f"it looks like {name}metres; multiply its positions by" in refused(large, align=align)
    assert f"the truth looks like {name}metres" in refused(TRUTH, large, align=align)


def test_a_free_scale_has_no_unit_and_an_estimate_gone_astray_is_scored():
    assert scored(moved(TRUTH, scale=1000), align="sim3").values["ate_rmse"] < 1e-6
    rng = np.random.default_rng(0)
    astray = es.Trajectory(TRUTH.t_us, 1000 * rng.normal(size=(301, 3)), TRUTH.quats_xyzw)
    assert scored(astray).values["ate_rmse"] > 100


def test_too_few_pairs_are_refused_with_the_difference_that_they_would_need():
    late = on_clock(part(TRUTH, slice(0, None, 30)), shift_us=9000)
    said = refused(late, max_difference_s=0.005)
    assert "0 of 11 poses have a true one" in said
    assert "0.009 s away" in said
    assert len(scored(late).matched) == 11
    assert "2 of 2 poses" in refused(part(TRUTH, [0, 5]))
    # Two true poses would be interpolated for any number of estimates.
    assert "and 2 true ones" in refused(TRUTH, part(TRUTH, [0, 300]), associate="interpolate")


@pytest.mark.parametrize("rule", ["one-to-one", "nearest", "interpolate"])
def test_one_pose_is_too_few_and_no_fault_of_the_program(rule):
    assert "needs 3" in refused(part(TRUTH, [3]), associate=rule)
    assert "needs 3" in refused(room(1.0), part(TRUTH, [3]), associate=rule)


def test_unsorted_times_are_refused(tmp_path):
    rows = ["0 0 0 0 0 0 0 1", "2 1 1 0 0 0 0 1", "1 1 0 0 0 0 0 1"]
    (tmp_path / "est.txt").write_text("\n".join(rows))
    said = refused(tmp_path / "est.txt")
    assert "does not come after" in said
    assert said.count(str(tmp_path / "est.txt")) == 1


@pytest.mark.parametrize(("call", "words"), [
    (lambda: es.score_trajectory(3, TRUTH), "estimate is 3: needs a Trajectory or a path"),
    (lambda: es.score_trajectory(TRUTH, 3), "truth is 3: needs a Trajectory, a recording"),
    (lambda: es.TrajectoryConfig(align="SE3"), "align is 'SE3'"),
    (lambda: es.TrajectoryConfig(rpe_times_s=(0,)), "rpe_times_s"),
])  # fmt: skip
def test_what_is_no_trajectory_is_refused(call, words):
    assert words in line_of(call)


STILL = es.Trajectory(TRUTH.t_us, np.zeros_like(TRUTH.positions_m), TRUTH.quats_xyzw)


@pytest.mark.parametrize("align", ["se3", "none"])
def test_a_truth_that_does_not_move_leaves_the_absolute_error(align):
    found = scored(TRUTH, STILL, align=align)
    centre_m = TRUTH.positions_m.mean(axis=0) * (align == "se3")
    spread_m = np.sqrt(np.mean(np.sum((TRUTH.positions_m - centre_m) ** 2, axis=1)))
    assert found.values["ate_rmse"] == pytest.approx(spread_m)
    undefined = {name for name, value in found.values.items() if np.isnan(value)}
    assert undefined > {"ate_share", "drift", "drift_rotation", "scale", "scale_error"}
    assert np.isfinite(found.values["rpe_translation_1s"])
    assert any("the truth does not move" in note for note in found.notes)


@pytest.mark.parametrize(("estimate", "truth"), [(TRUTH, STILL), (STILL, TRUTH)])
def test_no_scale_is_found_where_one_of_both_does_not_move(estimate, truth):
    """A scale of 0 would put all of the estimate where the truth is, without any error."""
    assert "set align to 'se3'" in refused(estimate, truth, align="sim3")


def test_too_few_poses_at_the_same_times_are_not_said_to_be_far_apart():
    assert refused(part(TRUTH, np.r_[0:2])).endswith("in the median: give more poses")


PLACES = st.sampled_from([-1e6, 0.0, 1e-9, 1.0, 2.0])
STEPS_US = st.sampled_from([1, 1000, 10**5, 10**7])
ROTATIONS = st.sampled_from([(0, 0, 0, 1), (1, 0, 0, 0), (0.5, 0.5, 0.5, 0.5)])


@st.composite
def few_poses(draw):
    """A trajectory of which anything may be degenerate."""
    poses = draw(st.lists(st.tuples(STEPS_US, PLACES, PLACES, ROTATIONS), min_size=1, max_size=7))
    steps_us, x_m, y_m, quats = zip(*poses, strict=True)
    z_m = np.zeros(len(poses))
    return es.Trajectory(np.cumsum(steps_us), np.stack([x_m, y_m, z_m], axis=1), np.array(quats))


@given(
    truth=few_poses(), estimate=few_poses(), same=st.sampled_from(["", "times", "all"]),
    align=st.sampled_from(["se3", "sim3", "none"]),
    associate=st.sampled_from(["one-to-one", "nearest", "interpolate"]),
    lengths_m=st.sampled_from([(), (1e-12,), (1.0, 1e9)]),
)  # fmt: skip
def test_whatever_the_poses_are_numbers_are_finite_or_undefined(
    truth, estimate, same, align, associate, lengths_m
):
    if same:
        found = estimate if same == "times" else truth
        places = np.resize(found.positions_m, truth.positions_m.shape)
        estimate = es.Trajectory(truth.t_us, places, truth.quats_xyzw)
    wanted = es.TrajectoryConfig(
        align=align, associate=associate, max_difference_s=10, rpe_distances_m=lengths_m
    )
    try:
        found = es.score_trajectory(estimate, truth, wanted)
    except es.InputError:
        return
    assert not np.isinf([*found.values.values()]).any()
    text = " ".join((*found.notes, *sentences({"a": found})))
    assert "nan" not in text
    assert "inf" not in text
