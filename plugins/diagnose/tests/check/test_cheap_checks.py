"""Checks without mapping: laws of their units, and thresholds."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check.alternatives import Chosen, of_poses
from eventsweep.plugins.diagnose.check.cameras import (
    check_cameras,
    check_rectification,
    field_deg,
    image_times,
)
from eventsweep.plugins.diagnose.check.events import check_events, time_unit
from eventsweep.plugins.diagnose.check.parallax import check_parallax
from eventsweep.plugins.diagnose.check.poses import check_poses
from eventsweep.plugins.diagnose.check.recording import check
from eventsweep.plugins.diagnose.check.streams import pieces, read_streams
from head_world import CAMERA, DURATION_US, head_recording
from planting import EditedRecording
from refusals import refused

FACTORS = st.floats(0.05, 20.0)


def _by_name(findings):
    return {one.name: one for one in findings}


def _with_poses(poses):
    return AlteredRecording(head_recording(), trajectory=poses)


def _poses(**changes):
    return replace(head_recording().trajectory, **changes)


def _checked_poses(poses):
    return _by_name(check_poses(_with_poses(poses), (0, DURATION_US)))


def _checked_events(recording):
    return _by_name(
        check_events(recording, read_streams(recording, pieces(recording, thorough=True)))
    )


@settings(max_examples=20, deadline=None)
@given(FACTORS)
def test_speed_and_acceleration_scale_as_positions_do(factor):
    poses = head_recording().trajectory
    changed = _checked_poses(_poses(positions_m=poses.positions_m * factor))
    right = _checked_poses(poses)
    for name in ("poses-speed", "poses-acceleration"):
        assert changed[name].value == pytest.approx(factor * right[name].value, rel=1e-6)
    assert changed["poses-turning"].value == pytest.approx(right["poses-turning"].value)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(-50, 50))
def test_what_a_body_does_depends_on_no_frame(seed, far_m):
    rng = np.random.default_rng(seed)
    T_other_world = se3.from_rotation(Rotation.random(rng=rng), rng.uniform(-1, 1, 3) * far_m)
    T_world_body = head_recording().trajectory.at(head_recording().trajectory.t_us)
    moved = Trajectory.from_matrices(head_recording().trajectory.t_us, T_other_world @ T_world_body)
    for name, one in _checked_poses(moved).items():
        right = _checked_poses(head_recording().trajectory)[name]
        assert one.verdict == right.verdict
        assert one.value == pytest.approx(right.value, rel=1e-4, abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(FACTORS)
def test_parallax_scales_with_focal_length_and_way_and_falls_with_depth(factor):
    def usual_px(recording, near_m=1.0):
        config = MapperConfig(min_depth_m=near_m, max_depth_m=100.0)
        return check_parallax(recording, config)[0].value

    right = usual_px(head_recording())
    lens = replace(CAMERA, fx_px=CAMERA.fx_px * factor)
    rig = replace(head_recording().rig, cameras=(lens, lens))
    assert usual_px(AlteredRecording(head_recording(), rig=rig)) == pytest.approx(factor * right)
    wide = _with_poses(_poses(positions_m=head_recording().trajectory.positions_m * factor))
    assert usual_px(wide) == pytest.approx(factor * right, rel=1e-6)
    assert usual_px(head_recording(), factor) == pytest.approx(right / factor)


def test_turning_is_no_parallax():
    turning = _poses(positions_m=np.zeros((len(head_recording().trajectory), 3)))
    found = check_parallax(_with_poses(turning), MapperConfig())[0]
    assert (found.verdict, found.value) == ("wrong", pytest.approx(0, abs=1e-6))


def test_parallax_is_of_the_windows_that_will_be_mapped():
    short = check_parallax(head_recording(), MapperConfig(window_s=0.05))[0]
    whole = check_parallax(head_recording(), MapperConfig(start_s=0.0, duration_s=0.5))[0]
    assert whole.value > 5 * short.value
    refused("", check_parallax, head_recording(), MapperConfig(start_s=3.0))


@pytest.mark.parametrize(("power", "unit"), [(-2, "ps"), (-1, "ns"), (1, "ms"), (2, "s")])
@given(st.floats(0.04, 25))
def test_a_unit_of_time_is_told_by_powers_of_a_thousand(power, unit, off):
    assert time_unit(off * 1000.0**power, "event") == f"event times in {unit}, read as µs"


@given(st.floats(0.04, 25))
def test_a_usual_rate_is_no_mistaken_unit(off):
    assert time_unit(off, "event") == ""


@pytest.mark.parametrize("stretch", [0.001, 1000])
def test_times_in_another_unit_are_seen_beside_poses_that_are_right(stretch):
    poses = _poses(t_us=(head_recording().trajectory.t_us * 1000).astype(np.int64))
    found = _by_name(check_poses(_with_poses(poses), (0, round(DURATION_US * 1000 * stretch))))
    assert found["poses-coverage"].verdict == "wrong"
    assert re.search(r"as if .*(unit|read as)", found["poses-coverage"].evidence)


def test_a_long_recording_of_poses_is_no_mistaken_unit():
    poses = head_recording().trajectory
    t_us = np.arange(60_000, dtype=np.int64) * 10_000
    long = Trajectory(t_us, np.resize(poses.positions_m, (60_000, 3)),
                      np.resize(poses.quats_xyzw, (60_000, 4)))  # fmt: skip
    found = _by_name(check_poses(_with_poses(long), (10_000_000, 10_600_000)))
    assert found["poses-coverage"].verdict == "good"


@settings(max_examples=10, deadline=None)
@given(st.floats(0.2, 8.0))
def test_noise_of_poses_is_measured(noise_mm):
    poses = head_recording().trajectory
    noise = np.random.default_rng(0).normal(0, noise_mm / 1e3, poses.positions_m.shape)
    found = _checked_poses(_poses(positions_m=poses.positions_m + noise))["poses-noise"]
    assert found.value == pytest.approx(noise_mm, rel=0.15)
    assert found.verdict == (
        "wrong" if found.value > 5 else "doubtful" if found.value > 1.5 else "good"
    )


def test_a_gap_between_poses_is_doubtful():
    poses = head_recording().trajectory
    kept = (poses.t_us < 200_000) | (poses.t_us > 300_000)
    gap = Trajectory(poses.t_us[kept], poses.positions_m[kept], poses.quats_xyzw[kept])
    found = _checked_poses(gap)["poses-rate"]
    assert (found.verdict, found.suspect) == ("doubtful", "gaps in the poses")
    assert "0.104 s" in found.evidence


def test_two_poses_are_too_few():
    poses = head_recording().trajectory
    ends = Trajectory(poses.t_us[::300], poses.positions_m[::300], poses.quats_xyzw[::300])
    assert _checked_poses(ends)["poses-rate"].suspect == "too few poses"


def _lens(**changes):
    rig = Rig("one", (replace(CAMERA, **changes),), (np.eye(4),))
    return _by_name(check_cameras(rig))


@pytest.mark.parametrize(
    ("ratio", "verdict"), [(1.0, "good"), (1.02, "good"), (1.1, "doubtful"), (1 / 1.1, "doubtful"),
                           (1.4, "wrong"), (0.001, "wrong")]
)  # fmt: skip
def test_focal_lengths_must_be_alike(ratio, verdict):
    assert _lens(fx_px=CAMERA.fy_px * ratio)["focal-ratio"].verdict == verdict


@given(st.floats(0.2, 5.0))
def test_the_verdict_on_focal_lengths_does_not_depend_on_their_order(ratio):
    there, back = (_lens(fx_px=95.0 * r)["focal-ratio"].verdict for r in (ratio, 1 / ratio))
    assert (
        there == back or min(abs(ratio / limit - 1) for limit in (1.03, 1.25, 0.8, 1 / 1.03)) < 1e-6
    )


@pytest.mark.parametrize(
    ("centre", "verdict"),
    [((60, 45), "good"), ((84, 45), "doubtful"), ((0, 0), "wrong"), ((60, 400), "wrong")],
)
def test_the_principal_point_is_near_the_middle(centre, verdict):
    found = _lens(cx_px=float(centre[0]), cy_px=float(centre[1]))["principal-point"]
    assert found.verdict == verdict


def test_an_exchanged_principal_point_is_called_that():
    found = _lens(cx_px=44.0, cy_px=60.5)["principal-point"]
    assert found.verdict == "wrong"
    assert "as if cx and cy were exchanged" in found.evidence


@pytest.mark.parametrize("times", [0.25, 0.5, 2.0])
def test_a_calibration_of_another_resolution_is_called_that(times):
    right = _lens(cx_px=59.5, cy_px=44.5)["principal-point"]
    found = _lens(cx_px=60 * times - 0.5, cy_px=45 * times - 0.5)["principal-point"]
    assert right.verdict == "good"
    assert found.verdict == "wrong"
    assert f"as if of an image {times:.3g} times as large" in found.evidence
    assert image_times(replace(CAMERA, cx_px=60 * times - 0.5, cy_px=45 * times - 0.5)) == times


@pytest.mark.parametrize("times", [0.25, 0.5, 2.0])
def test_a_calibration_of_another_resolution_is_mended(times):
    """Pixel centres are at whole numbers: the image's edge is at -0.5."""
    right = replace(CAMERA, cx_px=58.0, cy_px=46.0)
    told = replace(right.zoomed(times), cx_px=58.5 * times - 0.5, cy_px=46.5 * times - 0.5)
    rig = Rig("one", (told,), (np.eye(4),))
    recording = AlteredRecording(_one(), rig=rig)
    (mended,) = (a for a in of_poses(recording) if a.name == "calibration of another resolution")
    (camera,) = mended.change(recording).rig.cameras
    assert (camera.fx_px, camera.cx_px, camera.cy_px) == pytest.approx((right.fx_px, 58.0, 46.0))
    assert not any("resolution" in a.name for a in of_poses(_one()))


def test_a_fisheye_may_see_more_than_a_pinhole():
    wide = {"fx_px": 40.0, "fy_px": 40.0}
    fisheye = _lens(**wide, model="kb4", distortion=(0.0, 0.0, 0.0, 0.0))
    assert fisheye["field-of-view"].verdict == "good"
    assert field_deg(Camera(100, 100, 50, 50, 50, 50)) == pytest.approx(90)


@pytest.mark.parametrize(
    ("baseline_m", "verdict"),
    [(0.1, "good"), (0.006, "doubtful"), (1.5, "doubtful"), (0.0, "wrong"), (60.0, "wrong")],
)
def test_a_baseline_is_that_of_a_head_or_a_car(baseline_m, verdict):
    right = np.eye(4)
    right[0, 3] = baseline_m
    rig = replace(head_recording().rig, T_body_cam=(np.eye(4), right))
    assert _by_name(check_cameras(rig))["baseline"].verdict == verdict


@pytest.mark.parametrize(("angle", "verdict"), [(10, "good"), (45, "doubtful"), (120, "wrong")])
def test_cameras_that_look_apart_share_no_view(angle, verdict):
    T = se3.from_rotation(Rotation.from_euler("y", angle, degrees=True), np.array([0.1, 0, 0]))
    rig = replace(head_recording().rig, T_body_cam=(np.eye(4), T))
    assert _by_name(check_cameras(rig))["cameras-overlap"].verdict == verdict


@pytest.mark.parametrize("pitch_deg", [-4.0, 0.0, 3.0])
def test_the_residual_of_the_rectification_is_that_of_the_pitch(pitch_deg):
    rig = head_recording().rig
    turn = se3.from_rotation(Rotation.from_euler("x", pitch_deg, degrees=True), np.zeros(3))
    changed = replace(rig, T_body_cam=(rig.T_body_cam[0], rig.T_body_cam[1] @ turn))
    found = check_rectification(AlteredRecording(head_recording(), rig=changed), 0, 400_000)
    # x to the right and y down: a camera changed to be pitched up sees its rows too high
    assert found.value == pytest.approx(-CAMERA.fy_px * np.tan(np.radians(pitch_deg)), abs=1.5)


@pytest.mark.filterwarnings("error")
def test_cameras_whose_rectified_rows_hold_no_pixel_share_none():
    rig = head_recording().rig
    turn = se3.from_rotation(Rotation.from_euler("x", 120, degrees=True), np.zeros(3))
    apart = replace(rig, T_body_cam=(rig.T_body_cam[0], rig.T_body_cam[1] @ turn))
    found = check_rectification(AlteredRecording(head_recording(), rig=apart), 0, 400_000)
    assert found.verdict == "good"
    assert "share 0 rows" in found.evidence


def test_coarse_stamps_are_measured():
    coarse = EditedRecording(
        head_recording(), lambda _camera, e: replace(e, t_us=e.t_us // 1000 * 1000)
    )
    found = _checked_events(coarse)["events-time-step"]
    assert (found.value, found.verdict) == (1000, "doubtful")


def test_quick_pieces_are_a_second_of_a_long_recording_and_thorough_ones_all():
    class Long:
        rig = head_recording().rig

        def event_span_us(self, _camera):
            return 5_000_000, 65_000_000

    quick, whole = (pieces(Long(), thorough=t) for t in (False, True))
    assert sum(b - a for a, b in quick) == 1_000_000
    assert whole[0][0] == quick[0][0] == 5_000_000
    assert whole[-1][1] == quick[-1][1] == 65_000_001
    assert sum(b - a for a, b in whole) == 60_000_001


def test_a_saturated_bus_is_doubtful_and_a_steady_rate_is_not():
    def verdict(rates):
        stream = replace(_stream(), rates=(np.asarray(rates),))
        return _by_name(check_events(_one(), (stream,)))["events-ceiling"].verdict

    rng = np.random.default_rng(0)
    wanted = rng.uniform(5_000, 90_000, 400)
    assert verdict(np.minimum(wanted, 50_000)) == "doubtful"
    assert verdict(wanted) == "good"
    assert verdict(rng.poisson(900, 400)) == "good"


def _one():
    return Chosen(head_recording(), (0,))


def _stream():
    return read_streams(_one(), [(0, DURATION_US)])[0]


def test_long_rests_of_pixels_are_doubtful():
    stream = replace(_stream(), intervals_us=np.full(5000, 20_000))
    assert _by_name(check_events(_one(), (stream,)))["events-refractory"].verdict == "doubtful"


def test_events_off_the_sensor_that_fit_another_camera_are_swapped():
    small = replace(CAMERA, width_px=100, height_px=80)
    rig = replace(head_recording().rig, cameras=(small, CAMERA))
    found = _checked_events(AlteredRecording(head_recording(), rig=rig))["events-sensor"]
    assert (found.verdict, found.suspect) == ("wrong", "events off the sensor")
    assert "but on that of" in found.evidence
    both = replace(rig, cameras=(small, small))
    report = check(AlteredRecording(head_recording(), rig=both))
    assert report.finding("events-sensor").suspect == "events off the sensor"
    assert report.finding("rectification") is None
    assert not any(one.name.startswith("mapping") for one in report.findings)


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize(("first", "last", "verdict"), [
    (0.0, 0.4, "wrong"), (0.5, 1.0, "wrong"), (0.1, 1.0, "doubtful"), (0.0, 0.97, "good"),
    (0.4, 0.6, "wrong"),
])  # fmt: skip
def test_a_camera_that_is_silent_while_another_is_not_is_seen(camera, first, last, verdict):
    def part(which, events):
        kept = (events.t_us >= first * DURATION_US) & (events.t_us <= last * DURATION_US)
        return events.take(kept) if which == camera else events

    found = _checked_events(EditedRecording(head_recording(), part))["events-gaps"]
    assert found.verdict == verdict
    silent = 1 - (last - first) if verdict != "good" else 0  # under 20 ms
    assert found.value == pytest.approx(silent, abs=0.03)


def test_what_all_cameras_leave_out_at_the_ends_is_no_gap():
    def part(_camera, events):
        return events.take(np.abs(events.t_us - DURATION_US / 2) < DURATION_US / 8)

    both = EditedRecording(head_recording(), part)
    assert _checked_events(both)["events-gaps"].value == 0


def test_time_that_runs_backwards_is_counted():
    def edit(_camera, e):
        t_us = e.t_us.copy()
        t_us[[10, 11]] = t_us[[11, 10]] + [1, 0]
        return replace(e, t_us=t_us)

    found = _checked_events(EditedRecording(head_recording(), edit))["events-order"]
    assert (found.verdict, found.value) == ("wrong", 1)


def test_numbers_are_set_apart_in_thousands_and_never_have_an_exponent():
    busy = _checked_events(head_recording())
    ceiling = busy["events-ceiling"].evidence
    assert "e+" not in ceiling
    assert re.search(r"\d,\d{3} events", busy["events-order"].evidence)


@pytest.mark.parametrize(
    ("lens", "drawn"),
    [({}, False), ({"model": "radtan", "distortion": (0.0,) * 4}, False),
     ({"model": "radtan", "distortion": (-0.1, 0.0, 0.0, 0.0)}, True)],
)  # fmt: skip
def test_only_a_lens_that_distorts_gets_a_picture_of_it(lens, drawn):
    camera = replace(CAMERA, **lens)
    found = _by_name(check_cameras(Rig("one", (camera,), (np.eye(4),))))
    assert (found["distortion"].series is not None) == drawn
