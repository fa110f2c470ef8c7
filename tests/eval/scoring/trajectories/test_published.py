"""A published estimate: its statistics, as its authors' tool computed them, and evo's."""

import numpy as np
import pytest

import eventsweep as es

# ES-PTAM on `boxes` of rpg_eccv18: rpg_trajectory_evaluation wrote these, align_type se3 over all.
ABSOLUTE = {
    "ate_rmse": 0.04061932746064053, "ate_mean": 0.034973750933477536,
    "ate_median": 0.03166928772942368, "ate_max": 0.30525668567720937,
    "ate_rotation_rmse": 6.624733924627054, "ate_rotation_mean": 6.5233172187954915,
    "ate_rotation_median": 6.559471576573923, "ate_rotation_max": 10.91069913883533,
}  # fmt: skip
RELATIVE = {
    "rmse": (0.038359501681412986, 1.7227079993554015),
    "mean": (0.031267592053689085, 1.4808963473163517),
    "median": (0.02560507505269898, 1.2785303587053476),
    "max": (0.2291885389421755, 10.425432404449511),
}
# `evo_ape tum GT EST -a --t_max_diff 0.02` of evo 1.38.1, and with `-r angle_deg`; -s; without -a.
EVO = {"se3": (0.0406675874, 6.84648321), "sim3": (0.0404691397, 6.84648321),
       "none": (0.0708311119, 1.78864916)}  # fmt: skip


@pytest.fixture(scope="module")
def case(shared_reference):
    return shared_reference / "trajectories" / "esptam_boxes"


def scored(case, **settings):
    files = (case / name for name in ("stamped_traj_estimate.txt", "stamped_groundtruth.txt"))
    return es.score_trajectory(*files, es.TrajectoryConfig(**settings))


def test_pairs_and_errors_are_those_of_rpg_trajectory_evaluation(case):
    found = scored(case)
    of_estimate, of_truth = np.loadtxt(case / "stamped_est_gt_matches.txt", dtype=int).T
    estimate = es.read_poses(case / "stamped_traj_estimate.txt")
    truth = es.read_poses(case / "stamped_groundtruth.txt")
    np.testing.assert_array_equal(found.matched.t_us, estimate.t_us[of_estimate])
    late_us = estimate.t_us[of_estimate] - truth.t_us[of_truth]
    np.testing.assert_array_equal(found.matched.late_us, late_us)
    values = found.values
    assert {name: values[name] for name in ABSOLUTE} == pytest.approx(ABSOLUTE, abs=1e-9)
    (found, *_) = scored(case, rpe_distances_m=(0.7,)).errors.steps.values()
    assert len(found) == 1938
    for name, expected in RELATIVE.items():
        statistic = getattr(np, name, lambda e: np.sqrt(np.mean(e**2)))
        got = statistic(found.translation_m), statistic(found.rotation_deg)
        assert got == pytest.approx(expected, abs=1e-8)
    found = scored(case, associate="interpolate")
    assert len(found.matched) == 2207
    assert found.values["ate_rmse"] == pytest.approx(0.04060, abs=1e-5)


@pytest.mark.parametrize("align", EVO)
def test_with_the_other_rule_absolute_errors_are_those_of_evo(case, align):
    found = scored(case, associate="nearest", align=align)
    assert len(found.matched) == 2208
    got = found.values["ate_rmse"], found.values["ate_rotation_rmse"]
    assert got == pytest.approx(EVO[align], rel=1e-8)
