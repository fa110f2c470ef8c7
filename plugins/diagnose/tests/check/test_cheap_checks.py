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
from eventsweep.plugins.diagnose.check.events import (
    check_events,
    occupied,
    pieces,
    read_streams,
    time_unit,
)
from eventsweep.plugins.diagnose.check.poses import check_parallax, check_poses
from eventsweep.plugins.diagnose.check.recording import check
from head_world import CAMERA, DURATION_US, head_motion, head_recording
from planting import EditedRecording
from point_world import Recorded
from refusals import refused

FACTORS = st.floats(0.05, 20.0)
POSES = head_motion()
FAR_US = 1_700_000_000_000_000
ONE = Chosen(head_recording(), (0,))


def by_name(findings):
    return {finding.name: finding for finding in findings}


def with_poses(poses):
    return AlteredRecording(head_recording(), trajectory=poses)


def checked_poses(poses, span_us=(0, DURATION_US)):
    return by_name(check_poses(poses, [(span_us[0], span_us[1] + 1)]))


def some_poses(kept):
    return Trajectory(POSES.t_us[kept], POSES.positions_m[kept], POSES.quats_xyzw[kept])


def checked_events(edit=None, recording=None):
    recording = recording or EditedRecording(head_recording(), edit)
    spans = occupied(recording)
    streams = read_streams(recording, pieces(spans, thorough=True))
    return by_name(check_events(recording, streams, spans))


@settings(max_examples=20, deadline=None)
@given(FACTORS)
def test_speed_and_acceleration_scale_as_positions_do(factor):
    changed = checked_poses(replace(POSES, positions_m=POSES.positions_m * factor))
    right = checked_poses(POSES)
    for name in ("poses-speed", "poses-acceleration"):
        assert changed[name].value == pytest.approx(factor * right[name].value, rel=1e-6)
    assert changed["poses-turning"].value == pytest.approx(right["poses-turning"].value)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(-50, 50))
def test_what_a_body_does_depends_on_no_frame(seed, far_m):
    rng = np.random.default_rng(seed)
    T_other_world = se3.from_rotation(Rotation.random(rng=rng), rng.uniform(-1, 1, 3) * far_m)
    moved = Trajectory.from_matrices(POSES.t_us, T_other_world @ POSES.at(POSES.t_us))
    right = checked_poses(POSES)
    for name, finding in checked_poses(moved).items():
        assert finding.verdict == right[name].verdict
        assert finding.value == pytest.approx(right[name].value, rel=1e-4, abs=1e-3)


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
    wide = with_poses(replace(POSES, positions_m=POSES.positions_m * factor))
    assert usual_px(wide) == pytest.approx(factor * right, rel=1e-6)
    assert usual_px(head_recording(), factor) == pytest.approx(right / factor)


def test_parallax_is_of_the_windows_that_will_be_mapped_and_turning_is_none():
    turning = with_poses(replace(POSES, positions_m=np.zeros_like(POSES.positions_m)))
    finding = check_parallax(turning, MapperConfig())[0]
    assert (finding.verdict, finding.value) == ("wrong", pytest.approx(0, abs=1e-6))
    short = check_parallax(head_recording(), MapperConfig(window_s=0.05))[0]
    whole = check_parallax(head_recording(), MapperConfig(start_s=0.0, duration_s=0.5))[0]
    assert whole.value > 5 * short.value
    refused("", check_parallax, head_recording(), MapperConfig(start_s=3.0))


@pytest.mark.parametrize(("power", "unit"), [(-2, "ps"), (-1, "ns"), (0, ""), (1, "ms"), (2, "s")])
@given(st.floats(0.04, 25))
def test_a_unit_of_time_is_told_by_powers_of_a_thousand(power, unit, off):
    said = f"event times in {unit}, read as µs" if unit else ""
    assert time_unit(off * 1000.0**power, "event") == said


@pytest.mark.parametrize("stretch", [0.001, 1000])
def test_times_in_another_unit_are_seen_beside_poses_that_are_right(stretch):
    poses = replace(POSES, t_us=(POSES.t_us * 1000).astype(np.int64))
    finding = checked_poses(poses, (0, round(DURATION_US * 1000 * stretch)))["poses-coverage"]
    assert finding.verdict == "wrong"
    assert re.search(r"as if .*(unit|read as)", finding.evidence)


def test_a_long_recording_of_poses_is_no_mistaken_unit():
    t_us = np.arange(60_000, dtype=np.int64) * 10_000
    long = Trajectory(t_us, np.resize(POSES.positions_m, (60_000, 3)),
                      np.resize(POSES.quats_xyzw, (60_000, 4)))  # fmt: skip
    assert checked_poses(long, (10_000_000, 10_600_000))["poses-coverage"].verdict == "good"


@settings(max_examples=10, deadline=None)
@given(st.floats(0.2, 8.0))
def test_noise_of_poses_is_measured(noise_mm):
    noise = np.random.default_rng(0).normal(0, noise_mm / 1e3, POSES.positions_m.shape)
    noisy = replace(POSES, positions_m=POSES.positions_m + noise)
    finding = checked_poses(noisy)["poses-noise"]
    assert finding.value == pytest.approx(noise_mm, rel=0.15)
    limits = {"wrong": 5, "doubtful": 1.5, "good": 0}
    assert finding.verdict == next(v for v, least in limits.items() if finding.value > least)


@pytest.mark.parametrize(("kept", "verdict", "suspect", "words"), [
    ((POSES.t_us < 200_000) | (POSES.t_us > 300_000), "doubtful", "gaps in the poses", "0.104 s"),
    (slice(None, None, 300), "wrong", "too few poses", "2 poses in all"),
], ids=["gap", "few"])  # fmt: skip
def test_gaps_between_poses_are_seen(kept, verdict, suspect, words):
    finding = checked_poses(some_poses(kept))["poses-rate"]
    assert (finding.verdict, finding.suspect) == (verdict, suspect)
    assert words in finding.evidence


def of_lens(**changes):
    return by_name(check_cameras(Rig("one", (replace(CAMERA, **changes),), (np.eye(4),))))


def of_pair(T_cam0_cam1):
    rig = replace(head_recording().rig, T_body_cam=(np.eye(4), T_cam0_cam1))
    return by_name(check_cameras(rig))


def turned(axis, angle_deg, x_m=0.0):
    turn = Rotation.from_euler(axis, angle_deg, degrees=True)
    return se3.from_rotation(turn, np.array([x_m, 0, 0]))


@pytest.mark.parametrize(("name", "changes", "verdict"), [
    *(("focal-ratio", {"fx_px": CAMERA.fy_px * ratio}, verdict) for ratio, verdict in (
        (1.0, "good"), (1.02, "good"), (1.1, "doubtful"), (1 / 1.1, "doubtful"), (1.4, "wrong"),
        (0.001, "wrong"))),
    *(("principal-point", {"cx_px": x, "cy_px": y}, verdict) for x, y, verdict in (
        (60.0, 45.0, "good"), (84.0, 45.0, "doubtful"), (0.0, 0.0, "wrong"), (60.0, 400.0, "wrong"),
        (59.5, 44.5, "good"))),
    ("field-of-view", {"fx_px": 40.0, "fy_px": 40.0, "model": "kb4", "distortion": (0.0,) * 4},
     "good"),  # a fisheye may see more than a pinhole
])  # fmt: skip
def test_a_lens_has_square_pixels_and_its_principal_point_near_the_middle(name, changes, verdict):
    assert of_lens(**changes)[name].verdict == verdict
    assert field_deg(Camera(100, 100, 50, 50, 50, 50)) == pytest.approx(90)


@given(st.floats(0.2, 5.0))
def test_the_verdict_on_focal_lengths_does_not_depend_on_their_order(ratio):
    there, back = (of_lens(fx_px=95.0 * r)["focal-ratio"].verdict for r in (ratio, 1 / ratio))
    limits = (1.03, 1.25, 0.8, 1 / 1.03)
    assert there == back or min(abs(ratio / limit - 1) for limit in limits) < 1e-6


@pytest.mark.parametrize(("centre", "words"), [
    ((44.0, 60.5), "as if cx and cy were exchanged"),
    *(((60 * times - 0.5, 45 * times - 0.5), f"as if of an image {times:.3g} times as large")
      for times in (0.25, 0.5, 2.0)),
])  # fmt: skip
def test_a_principal_point_of_another_order_or_resolution_is_called_that(centre, words):
    finding = of_lens(cx_px=centre[0], cy_px=centre[1])["principal-point"]
    assert finding.verdict == "wrong"
    assert words in finding.evidence


@pytest.mark.parametrize("times", [0.25, 0.5, 2.0])
def test_a_calibration_of_another_resolution_is_mended(times):
    """Pixel centres are at whole numbers: the image's edge is at -0.5."""
    right = replace(CAMERA, cx_px=58.0, cy_px=46.0)
    told = replace(right.zoomed(times), cx_px=58.5 * times - 0.5, cy_px=46.5 * times - 0.5)
    recording = AlteredRecording(ONE, rig=Rig("one", (told,), (np.eye(4),)))
    (mended,) = (a for a in of_poses(recording) if a.name == "calibration of another resolution")
    (camera,) = mended.change(recording).rig.cameras
    assert (camera.fx_px, camera.cx_px, camera.cy_px) == pytest.approx((right.fx_px, 58.0, 46.0))
    assert image_times(told) == times
    assert not any("resolution" in a.name for a in of_poses(ONE))


@pytest.mark.parametrize(("name", "T_cam0_cam1", "verdict"), [
    *(("baseline", turned("y", 0, x_m), verdict) for x_m, verdict in (
        (0.1, "good"), (0.006, "doubtful"), (1.5, "doubtful"), (0.0, "wrong"), (60.0, "wrong"))),
    *(("cameras-overlap", turned("y", angle_deg, 0.1), verdict) for angle_deg, verdict in (
        (10, "good"), (45, "doubtful"), (120, "wrong"))),
])  # fmt: skip
def test_a_rig_is_that_of_a_head_or_a_car_and_its_cameras_share_a_view(name, T_cam0_cam1, verdict):
    assert of_pair(T_cam0_cam1)[name].verdict == verdict


def rectification(axis, angle_deg):
    rig = head_recording().rig
    T_0, T_1 = rig.T_body_cam
    changed = replace(rig, T_body_cam=(T_0, T_1 @ turned(axis, angle_deg)))
    return check_rectification(AlteredRecording(head_recording(), rig=changed), 0, 400_000)


@pytest.mark.parametrize("pitch_deg", [-4.0, 0.0, 3.0])
def test_the_residual_of_the_rectification_is_that_of_the_pitch(pitch_deg):
    # x to the right and y down: a camera changed to be pitched up sees its rows too high
    residual_px = -CAMERA.fy_px * np.tan(np.radians(pitch_deg))
    assert rectification("x", pitch_deg).value == pytest.approx(residual_px, abs=1.5)


@pytest.mark.filterwarnings("error")
def test_cameras_whose_rectified_rows_hold_no_pixel_share_none():
    finding = rectification("x", 120)
    assert finding.verdict == "good"
    assert "share 0 rows" in finding.evidence


def test_coarse_stamps_are_measured():
    edited = checked_events(lambda _camera, e: replace(e, t_us=e.t_us // 1000 * 1000))
    finding = edited["events-time-step"]
    assert (finding.value, finding.verdict) == (1000, "doubtful")


def test_quick_pieces_are_a_second_of_a_long_recording_and_thorough_ones_all():
    quick, whole = (pieces([(5_000_000, 65_000_001)], thorough=t) for t in (False, True))
    assert sum(b - a for a, b in quick) == 1_000_000
    assert whole[0][0] == quick[0][0] == 5_000_000
    assert whole[-1][1] == quick[-1][1] == 65_000_001
    assert sum(b - a for a, b in whole) == 60_000_001


def of_stream(**changes):
    (stream,) = read_streams(ONE, [(0, DURATION_US)])
    return by_name(check_events(ONE, (replace(stream, **changes),)))


def test_a_saturated_bus_is_doubtful_and_a_steady_rate_is_not():
    rng = np.random.default_rng(0)
    due = rng.uniform(5_000, 90_000, 400)
    for rates, verdict in ((np.minimum(due, 50_000), "doubtful"), (due, "good"),
                           (rng.poisson(900, 400), "good")):  # fmt: skip
        assert of_stream(rates=(rates,))["events-ceiling"].verdict == verdict


def test_long_rests_of_pixels_are_doubtful():
    rested = of_stream(intervals_us=np.full(5000, 20_000))
    assert rested["events-refractory"].verdict == "doubtful"


def test_events_off_the_sensor_that_fit_another_camera_are_swapped():
    small = replace(CAMERA, width_px=100, height_px=80)
    rig = replace(head_recording().rig, cameras=(small, CAMERA))
    altered = AlteredRecording(head_recording(), rig=rig)
    finding = checked_events(recording=altered)["events-sensor"]
    assert (finding.verdict, finding.suspect) == ("wrong", "events off the sensor")
    assert "but on that of" in finding.evidence
    both = replace(rig, cameras=(small, small))
    report = check(AlteredRecording(head_recording(), rig=both))
    assert report.finding("events-sensor").suspect == "events off the sensor"
    assert report.finding("rectification") is None
    assert not any(finding.name.startswith("mapping") for finding in report.findings)


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize(("first", "last", "verdict"), [
    (0.0, 0.4, "wrong"), (0.5, 1.0, "wrong"), (0.1, 1.0, "doubtful"), (0.0, 0.97, "good"),
    (0.4, 0.6, "wrong"),
])  # fmt: skip
def test_a_camera_that_is_silent_while_another_is_not_is_seen(camera, first, last, verdict):
    def part(which, events):
        kept = (events.t_us >= first * DURATION_US) & (events.t_us <= last * DURATION_US)
        return events.take(kept) if which == camera else events

    finding = checked_events(part)["events-gaps"]
    assert finding.verdict == verdict
    silent = 1 - (last - first) if verdict != "good" else 0  # under 20 ms
    assert finding.value == pytest.approx(silent, abs=0.03)


def test_what_all_cameras_leave_out_at_the_ends_is_no_gap():
    middle = checked_events(
        lambda _camera, e: e.take(np.abs(e.t_us - DURATION_US / 2) < DURATION_US / 8)
    )
    assert middle["events-gaps"].value == 0


def test_time_that_runs_backwards_is_counted_and_numbers_are_set_apart_in_thousands():
    def edit(_camera, e):
        t_us = e.t_us.copy()
        if len(t_us) > 11:
            t_us[[10, 11]] = t_us[[11, 10]] + [1, 0]
        return replace(e, t_us=t_us)

    findings = checked_events(edit)
    order = findings["events-order"]
    assert (order.verdict, order.value) == ("wrong", 1)
    assert re.search(r"\d,\d{3} events", order.evidence)
    assert "e+" not in findings["events-ceiling"].evidence


@pytest.mark.parametrize(
    ("lens", "drawn"),
    [({}, False), ({"model": "radtan", "distortion": (0.0,) * 4}, False),
     ({"model": "radtan", "distortion": (-0.1, 0.0, 0.0, 0.0)}, True)],
)  # fmt: skip
def test_only_a_lens_that_distorts_gets_a_picture_of_it(lens, drawn):
    assert (of_lens(**lens)["distortion"].series is not None) == drawn


class LaterClock(EditedRecording):
    """The head's recording, a moment later."""

    def event_span_us(self, camera):
        first_us, last_us = super().event_span_us(camera)
        return first_us + FAR_US, last_us + FAR_US

    def events(self, camera, t0_us, t1_us):
        return super().events(camera, t0_us - FAR_US, t1_us - FAR_US).shifted(FAR_US)


def test_findings_do_not_depend_on_where_the_clock_begins():
    later = LaterClock(head_recording(), lambda _camera, e: e)
    events = checked_events(recording=head_recording())
    poses = replace(POSES, t_us=POSES.t_us + FAR_US)
    there = checked_events(recording=later)
    there |= checked_poses(poses, (FAR_US, FAR_US + DURATION_US))
    for name, finding in (events | checked_poses(POSES)).items():
        assert there[name].verdict == finding.verdict
        assert there[name].value == pytest.approx(finding.value, rel=1e-4, abs=1e-6), name


@pytest.mark.parametrize("jump_us", [3_600_000_000, FAR_US])
def test_a_clock_that_jumps_is_named_and_its_silence_costs_nothing(jump_us):
    def jumping(_camera, e):
        return replace(e, t_us=e.t_us + jump_us * (e.t_us >= DURATION_US // 2))

    here = head_recording().events(0, 0, DURATION_US)
    later = Recorded(ONE.rig, POSES, (jumping(0, here),))
    findings = checked_events(recording=later)
    assert findings["events-gaps"].verdict == "wrong"
    assert f"no event of any camera for {jump_us / 1e6:,.0f}" in findings["events-gaps"].evidence
    assert findings["events-rate"].verdict == "good"
