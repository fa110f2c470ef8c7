"""The recovery command: what it spoils, and the tables that it makes of results."""

import numpy as np
import pytest

import calibrate_recovery
from calibrate_recovery import STUDIES, TWINS, lag_ms, per_twin, spoilt, summary
from eventsweep.plugins.diagnose.calibrate.parameters import parameters_of


def result(name, left, refused="", lag_ms=None, what=("cam1 yaw", "stereo")):
    estimates = [
        {"parameter": what[0], "kind": what[1], "spoilt": 0.4, "left": left,
         "uncertainty": 0.05, "refused": refused}
    ]  # fmt: skip
    return {"scene": name, "study": "stereo", "seed": 0, "wall_s": 70.0, "cpu_s": 40.0,
            "estimates": estimates, "depth": [2.0, 9.0, 2.1], "lag_ms": lag_ms}  # fmt: skip


def test_tables_tell_what_is_left_what_was_covered_and_what_refused():
    results = [result("a", 0.01), result("b", -0.07), result("c", 0.4, "too little")]
    text = summary(results) + per_twin(results)
    assert "| cam1 yaw | 0.40 deg | 0.040 deg | 0.070 deg | 0.050 deg | 1/2 | 1/3 |" in text
    assert "| b | 2.00 % | 9.00 % | 2.10 % | 40 s | 70 s |" in text


def test_what_was_always_refused_has_no_error():
    text = summary([result("a", 0.4, "flat")])
    assert "| cam1 yaw | 0.40 deg | – | – | 0.05 deg | – | 1/1 |" in text


def test_a_pose_clock_is_also_compared_with_that_of_the_events():
    results = [result("a", 1.52, lag_ms=1.5, what=("pose clock", "pose clock"))]
    text = summary(results) + per_twin(results)
    assert "| pose clock | 0.40 ms | 1.520 ms | 1.520 ms | 0.050 ms | 0/1 | 0/1 |" in text
    assert (
        "| pose clock, from the events' | 0.40 ms | 0.020 ms | 0.020 ms | 0.050 ms | 1/1 |" in text
    )
    assert "| a | 2.00 % | 9.00 % | 2.10 % | 40 s | 70 s | 1.5 ms |" in text


def test_the_lag_is_how_late_events_come(monkeypatch):
    """Edges of several events each, stamped 3 ms late among noise of their own."""
    rng = np.random.default_rng(0)
    edges = 10**7 * rng.integers(0, 1000, 4000)[:, None] + rng.integers(0, 390_000, (4000, 1))
    edges = edges + rng.integers(0, 5000, (4000, 4))
    noise = 10**7 * rng.integers(0, 1000, (2, 4000)) + rng.integers(0, 390_000, (2, 4000))
    streams = {
        late: np.sort(np.r_[edges.ravel() + 3000 * late, noise[int(late)]]).astype(np.int64)
        for late in (False, True)
    }
    monkeypatch.setattr(calibrate_recovery, "twin", lambda name, quick, prompt: not prompt)
    monkeypatch.setattr(calibrate_recovery, "_in_order", streams.__getitem__)
    assert lag_ms("any", quick=False) == pytest.approx(3.0, abs=0.2)


def test_errors_differ_from_twin_to_twin():
    parameters = parameters_of(STUDIES["stereo"].refine, 2)
    drawn = {tuple(spoilt("stereo", name, 0, parameters).values()) for name in TWINS}
    assert len(drawn) == len(TWINS)


@pytest.mark.parametrize("seed", range(5))
def test_calibrations_are_spoilt_by_as_much_as_the_page_says(seed):
    stereo = spoilt("stereo", "desk", seed, parameters_of(STUDIES["stereo"].refine, 2))
    assert all(abs(value) <= (6 if one.kind == "clock" else 0.5) for one, value in stereo.items())
    poses = spoilt("poses", "desk", seed, parameters_of(STUDIES["poses"].refine, 2))
    turn = [value for one, value in poses.items() if one.kind == "hand-eye"]
    assert np.linalg.norm(turn) == pytest.approx(2)
    assert [abs(value) for one, value in poses.items() if one.kind == "pose clock"] == [20]
