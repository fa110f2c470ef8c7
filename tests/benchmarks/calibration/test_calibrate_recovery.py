"""The recovery command: what it spoils, and the tables that it makes of results."""

import numpy as np
import pytest

from calibrate_recovery import STUDIES, spoilt, tables
from emvs.calibrate.parameters import parameters_of


def result(name, left, refused=""):
    estimates = [
        {"parameter": "cam1 yaw", "kind": "stereo", "spoilt": 0.4, "left": left,
         "uncertainty": 0.05, "refused": refused}
    ]  # fmt: skip
    return {"scene": name, "study": "stereo", "seed": 0, "wall_s": 70.0, "cpu_s": 40.0,
            "estimates": estimates, "depth": [2.0, 9.0, 2.1]}  # fmt: skip


def test_tables_tell_what_is_left_what_was_covered_and_what_refused():
    text = tables([result("a", 0.01), result("b", -0.07), result("c", 0.4, "too little")])
    assert "| cam1 yaw | 0.40 deg | 0.040 deg | 0.070 deg | 0.050 deg | 1 of 2 | 1 of 3 |" in text
    assert "| b | 2.00 % | 9.00 % | 2.10 % | 40 s | 70 s |" in text


def test_what_was_always_refused_has_no_error():
    text = tables([result("a", 0.4, "flat")])
    assert "| cam1 yaw | 0.40 deg | – | – | 0.05 deg | – | 1 of 1 |" in text


@pytest.mark.parametrize("seed", range(5))
def test_calibrations_are_spoilt_by_as_much_as_the_page_says(seed):
    stereo = spoilt("stereo", seed, parameters_of(STUDIES["stereo"][0], 2))
    assert all(abs(value) <= (6 if one.kind == "clock" else 0.5) for one, value in stereo.items())
    poses = spoilt("poses", seed, parameters_of(STUDIES["poses"][0], 2))
    turn = [value for one, value in poses.items() if one.kind == "hand-eye"]
    assert np.linalg.norm(turn) == pytest.approx(2)
    assert [abs(value) for one, value in poses.items() if one.kind == "pose clock"] == [20]
