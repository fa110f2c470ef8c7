"""What is refused, each in one line that says what to do: clocks, units, too few poses."""

import numpy as np
import pytest

import eventsweep as es
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
