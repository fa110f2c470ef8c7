"""Parameters come back from worlds of points that are known exactly; flat ones are refused."""

from dataclasses import replace
from functools import cache

import numba
import numpy as np
import pytest

import eventsweep.plugins.diagnose.calibrate.refine as module
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.utils.runtime import use_threads
from eventsweep.plugins.diagnose.calibrate.refine import RefineConfig, refine
from eventsweep.plugins.diagnose.parameters import Correction, parameters_of
from eventsweep.plugins.diagnose.windows import read_windows
from point_world import edge_points, pinhole, sideways, stereo_rig, swinging
from refusals import refused
from tiers import often

CAMERA = pinhole(120, 90, 100.0)
SMALL = {"windows": 5, "window_s": 0.15, "events": 2500}


@cache
def world(kind="swinging", cameras=2):
    trajectory = {
        "swinging": lambda: swinging(),
        "translating": lambda: swinging(turn_deg=(0, 0, 0)),
        "still": lambda: swinging((0, 0, 0), (1e-4, 1e-4, 1e-4)),
        "shaking": lambda: swinging((12.0, 14.0, 10.0)),
        "even": lambda: sideways(0.6, 1_200_000, 100),
    }[kind]()
    return edge_points(trajectory, stereo_rig(CAMERA, 0.1, cameras), points=500)


STEREO = {"cam1 pitch": 0.9, "cam1 yaw": -0.9, "cam1 roll": 0.8, "cam1 clock": 10.0}


def refined(names, errors, kind="swinging", cameras=2, **config):
    found, _ = _refined(names, tuple(errors.items()), kind, cameras, tuple(config.items()))
    left = {
        one.parameter.name: one.value + errors.get(one.parameter.name, 0.0)
        for one in found.estimates
        if not one.refused
    }
    return found, left


@cache
def _refined(names, errors, kind, cameras, config):
    recording = world(kind, cameras)
    parameters = parameters_of(names, cameras)
    spoilt = Correction.of(parameters, [dict(errors).get(one.name, 0.0) for one in parameters])
    config, steps = RefineConfig(names, **(SMALL | dict(config))), []
    return refine(spoilt.applied(recording), config, lambda *step: steps.append(step)), steps


def refusals(found):
    return {one.parameter.name: one.refused for one in found.estimates if one.refused}


def test_stereo_rotation_and_camera_clock_come_back_together():
    found, left = refined(("stereo", "delay"), STEREO)
    assert not refusals(found)
    assert abs(left["cam1 pitch"]) < 0.08
    assert abs(left["cam1 yaw"]) < 0.08
    assert abs(left["cam1 roll"]) < 0.12
    assert abs(left["cam1 clock"]) < 1.0
    assert found.sharpness[:, 1].mean() > 1.02 * found.sharpness[:, 0].mean()


@pytest.mark.slow
def test_a_lag_that_all_cameras_share_is_no_clock_between_them():
    """Events of both come 6 ms late: one camera alone would be sharper with its clock put back."""
    recording = world()
    late = AlteredRecording(recording, clock_us=(6000, 6000))
    found = refine(late, RefineConfig(("stereo", "delay"), **SMALL))
    clock = next(one for one in found.estimates if one.parameter.kind == "clock")
    assert not clock.refused
    assert abs(clock.value) < 0.5


@pytest.mark.slow
def test_turn_rates_that_would_make_windows_less_sharp_are_not_followed(monkeypatch):
    wild = np.r_[25.0, np.radians([4.0, -4.0, 4.0])]
    monkeypatch.setattr("eventsweep.plugins.diagnose.calibrate.refine.align", lambda *_: wild)
    _, left = refined(("pose-delay",), {"pose clock": 0.0})
    assert abs(left["pose clock"]) < 1.5


def test_the_truth_lies_within_the_stated_uncertainty():
    found, left = refined(("stereo", "delay"), STEREO)
    for one in found.estimates:
        assert abs(left[one.parameter.name]) <= one.uncertainty, one


@pytest.mark.parametrize(("name", "parameter", "error", "most"), [
    ("baseline", "cam1 baseline", 4.0, 1.0), ("focal", "focal length", 3.0, 1.0),
    pytest.param("pose-delay", "pose clock", 25.0, 1.5, marks=pytest.mark.slow),
])  # fmt: skip
def test_each_other_parameter_comes_back(name, parameter, error, most):
    found, left = refined((name,), {parameter: error})
    assert not refusals(found)
    assert abs(left[parameter]) < most


@pytest.mark.slow
def test_the_direction_of_the_baseline_comes_back():
    _, left = refined(("direction",), {"cam1 forward": 1.0, "cam1 across": -1.2})
    assert abs(left["cam1 across"]) < 0.4
    assert abs(left.get("cam1 forward", 0.0)) < 0.7


@pytest.mark.slow
def test_hand_eye_rotation_and_pose_clock_come_back_where_the_camera_turns():
    errors = {
        "pose clock": -12.0, "hand-eye pitch": 1.2, "hand-eye yaw": -1.2, "hand-eye roll": 1.0,
    }  # fmt: skip
    found, left = refined(("pose-delay", "hand-eye"), errors, "shaking", windows=10, window_s=0.1)
    assert abs(left["pose clock"]) < 1.5
    turns = [name for name in left if name.split()[-1] in ("pitch", "yaw", "roll")]
    assert turns, refusals(found)
    for name in turns:
        assert abs(left[name]) < 0.35, name


@pytest.mark.slow
def test_a_lever_is_refused_without_turning_and_says_why():
    found, left = refined(("lever",), {"lever x": 10.0}, "translating")
    assert {"lever x", "lever y", "lever z"} <= refusals(found).keys()
    assert "turns" in refusals(found)["lever x"]
    assert not {"lever x", "lever y", "lever z"} & left.keys()


@pytest.mark.slow
def test_a_pose_clock_is_refused_in_steady_motion():
    found, _ = refined(("pose-delay",), {"pose clock": 10.0}, "even")
    assert "too uniform" in refusals(found)["pose clock"]
    assert found.correction.values == {}


def test_what_a_camera_at_rest_cannot_see_is_refused():
    """Without motion there are next to no events; with few, no window."""
    refused("1000 events from every camera", refined, ("baseline",), {}, "still")


@pytest.mark.slow
def test_refused_parameters_keep_the_value_that_was_given():
    found, _ = refined(("lever",), {"lever x": 10.0}, "translating")
    assert found.applied(world("translating")).rig.T_body_cam[0][0, 3] == 0


@pytest.mark.slow
def test_one_camera_refines_the_clock_of_its_poses():
    found, left = refined(("delay",), {"pose clock": 10.0}, cameras=1)
    assert [one.parameter.name for one in found.estimates] == ["pose clock"]
    assert abs(left["pose clock"]) < 1.5


@pytest.mark.slow
def test_three_cameras_are_refined_together():
    errors = {"cam1 pitch": 0.4, "cam2 pitch": -0.4}
    _, left = refined(("stereo",), errors, cameras=3)
    assert abs(left["cam1 pitch"]) < 0.1
    assert abs(left["cam2 pitch"]) < 0.1


def test_any_number_of_threads_gives_the_same_bits():
    threads = numba.get_num_threads()
    try:
        one, two = (
            refined(("stereo",), {"cam1 pitch": 0.3}, threads=count, events=1000, windows=2)[0]
            for count in (1, 2)
        )
    finally:
        use_threads(threads)
    assert [e.value for e in one.estimates] == [e.value for e in two.estimates]
    assert (one.sharpness == two.sharpness).all()


def test_progress_tells_every_stage():
    _, steps = _refined(("stereo", "delay"), tuple(STEREO.items()), "swinging", 2, ())
    assert {stage for stage, _, _ in steps} == {"windows", "scan", "stereo", "curves"}
    assert all(0 <= done <= total for _, done, total in steps)


def test_a_rig_of_one_camera_has_no_stereo():
    refused("needs a rig of 2 cameras", refined, ("stereo",), {}, cameras=1)


def test_too_short_a_recording_is_refused():
    recording = world()
    cut = replace(recording, trajectory=type(recording.trajectory)(
        recording.trajectory.t_us[:80], recording.trajectory.positions_m[:80],
        recording.trajectory.quats_xyzw[:80],
    ))  # fmt: skip
    refused("margin for clock offsets", refine, cut, RefineConfig(("stereo",), **SMALL))


def test_windows_that_make_no_sense_are_refused():
    refused("at least 2 windows", RefineConfig, windows=1)
    assert np.isfinite(RefineConfig().window_s)


@pytest.mark.parametrize(
    ("motion", "times"), often([("translating", 1)], [("translating", 1), ("shaking", 2)])
)
def test_windows_of_a_calm_camera_are_read_once(motion, times, monkeypatch):
    read = []

    def counted(*arguments):
        read.append(arguments)
        return read_windows(*arguments)

    monkeypatch.setattr(module, "read_windows", counted)
    refined(("hand-eye",), {}, motion, windows=2, events=1000)
    assert len(read) == times
