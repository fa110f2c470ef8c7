"""Parameters come back from worlds of points that are known exactly; flat ones are refused."""

from dataclasses import replace
from functools import cache

import numba
import numpy as np
import pytest

import eventsweep.plugins.diagnose.calibrate.refine as module
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.geometry.trajectory import Trajectory
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
    """The refinement, and by name what is left of the errors of those that are not refused."""
    refinement, _ = _refined(names, tuple(errors.items()), kind, cameras, tuple(config.items()))
    known = [estimate for estimate in refinement.estimates if not estimate.refused]
    left = {e.parameter.name: e.value + errors.get(e.parameter.name, 0.0) for e in known}
    return refinement, left


@cache
def _refined(names, errors, kind, cameras, config):
    recording = world(kind, cameras)
    parameters = parameters_of(names, cameras)
    spoilt = Correction.of(parameters, [dict(errors).get(p.name, 0.0) for p in parameters])
    config, steps = RefineConfig(names, **(SMALL | dict(config))), []
    return refine(spoilt.applied(recording), config, lambda *step: steps.append(step)), steps


def refusals(refinement):
    return {e.parameter.name: e.refused for e in refinement.estimates if e.refused}


def test_stereo_rotation_and_camera_clock_come_back_together_within_the_stated_uncertainty():
    refinement, left = refined(("stereo", "delay"), STEREO)
    assert not refusals(refinement)
    most = {"cam1 pitch": 0.08, "cam1 yaw": 0.08, "cam1 roll": 0.12, "cam1 clock": 1.0}
    for estimate in refinement.estimates:
        name = estimate.parameter.name
        assert abs(left[name]) < min(most[name], estimate.uncertainty), estimate
    before, after = refinement.sharpness.mean(axis=0)
    assert after > 1.02 * before


@pytest.mark.slow
def test_a_lag_that_all_cameras_share_is_no_clock_between_them():
    """Events of both come 6 ms late: one camera alone would be sharper with its clock put back."""
    recording = world()
    late = AlteredRecording(recording, clock_us=(6000, 6000))
    refinement = refine(late, RefineConfig(("stereo", "delay"), **SMALL))
    clock = next(e for e in refinement.estimates if e.parameter.kind == "clock")
    assert not clock.refused
    assert abs(clock.value) < 0.5


@pytest.mark.slow
def test_turn_rates_that_would_make_windows_less_sharp_are_not_followed(monkeypatch):
    wild = np.r_[25.0, np.radians([4.0, -4.0, 4.0])]
    monkeypatch.setattr("eventsweep.plugins.diagnose.calibrate.refine.align", lambda *_: wild)
    _, left = refined(("pose-delay",), {"pose clock": 0.0})
    assert abs(left["pose clock"]) < 1.5


@pytest.mark.parametrize(("name", "parameter", "error", "most"), [
    ("baseline", "cam1 baseline", 4.0, 1.0), ("focal", "focal length", 3.0, 1.0),
    pytest.param("pose-delay", "pose clock", 25.0, 1.5, marks=pytest.mark.slow),
])  # fmt: skip
def test_each_other_parameter_comes_back(name, parameter, error, most):
    refinement, left = refined((name,), {parameter: error})
    assert not refusals(refinement)
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
    refinement, left = refined(
        ("pose-delay", "hand-eye"), errors, "shaking", windows=10, window_s=0.1
    )
    assert abs(left["pose clock"]) < 1.5
    turns = [name for name in left if name.split()[-1] in ("pitch", "yaw", "roll")]
    assert turns, refusals(refinement)
    for name in turns:
        assert abs(left[name]) < 0.35, name


@pytest.mark.slow
def test_a_lever_is_refused_without_turning_says_why_and_keeps_its_value():
    refinement, left = refined(("lever",), {"lever x": 10.0}, "translating")
    assert {"lever x", "lever y", "lever z"} <= refusals(refinement).keys()
    assert "turns" in refusals(refinement)["lever x"]
    assert not left
    assert refinement.applied(world("translating")).rig.T_body_cam[0][0, 3] == 0


@pytest.mark.slow
def test_a_pose_clock_is_refused_in_steady_motion():
    refinement, _ = refined(("pose-delay",), {"pose clock": 10.0}, "even")
    assert "too uniform" in refusals(refinement)["pose clock"]
    assert refinement.correction.values == {}


@pytest.mark.slow
def test_one_camera_refines_the_clock_of_its_poses():
    refinement, left = refined(("delay",), {"pose clock": 10.0}, cameras=1)
    assert [e.parameter.name for e in refinement.estimates] == ["pose clock"]
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
        alone, both = (
            refined(("stereo",), {"cam1 pitch": 0.3}, threads=count, events=1000, windows=2)[0]
            for count in (1, 2)
        )
    finally:
        use_threads(threads)
    assert [e.value for e in alone.estimates] == [e.value for e in both.estimates]
    assert (alone.sharpness == both.sharpness).all()


def test_progress_tells_every_stage():
    _, steps = _refined(("stereo", "delay"), tuple(STEREO.items()), "swinging", 2, ())
    assert {stage for stage, _, _ in steps} == {"windows", "scan", "stereo", "curves"}
    assert all(0 <= done <= total for _, done, total in steps)


def short():
    poses = world().trajectory
    part = Trajectory(poses.t_us[:80], poses.positions_m[:80], poses.quats_xyzw[:80])
    return replace(world(), trajectory=part)


@pytest.mark.parametrize(("words", "call"), [
    ("needs a rig of 2 cameras", lambda: refined(("stereo",), {}, cameras=1)),
    # Without motion there are next to no events; with few, no window.
    ("1000 events from every camera", lambda: refined(("baseline",), {}, "still")),
    ("margin for clock offsets", lambda: refine(short(), RefineConfig(("stereo",), **SMALL))),
    ("at least 2 windows", lambda: RefineConfig(windows=1)),
])  # fmt: skip
def test_what_cannot_be_refined_is_refused(words, call):
    refused(words, call)


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
