"""Free turns: nothing is gained under right poses, and wrong ones that nothing mends are seen."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check.alternatives import Chosen, amounts, of_poses
from eventsweep.plugins.diagnose.check.recording import check
from eventsweep.plugins.diagnose.check.trial_windows import TrialWindows
from eventsweep.plugins.diagnose.check.trials import CameraTrials, Trial
from head_world import head_recording


def turned(recording, turn_of):
    """The recording with poses turned on the spot: `turn_of` gives rotation vectors at times, s."""
    poses = recording.trajectory
    more = Rotation.from_rotvec(turn_of(poses.t_us / 1e6))
    quats = (Rotation.from_quat(poses.quats_xyzw) * more).as_quat()
    return AlteredRecording(recording, trajectory=Trajectory(poses.t_us, poses.positions_m, quats))


def free_gains(recording, cameras):
    _, coarse = TrialWindows.of(recording, MapperConfig())
    return coarse.free_turn_gains(lambda r: r, cameras)


@pytest.mark.parametrize("cameras", [(0, 1), (1, 0), (0,)])
def test_right_poses_leave_next_to_nothing_to_gain(cameras):
    assert (free_gains(head_recording(), cameras) < 0.02).all()


@pytest.mark.parametrize("axis", range(3))
def test_a_rate_that_was_planted_is_taken_out_again(axis):
    """Turned at 0.3 rad/s, which is a multiple of the smallest step: all sharpness comes back."""
    rate = 0.3 * np.eye(3)[axis]
    spoilt = turned(head_recording(), lambda s: s[:, None] * rate)
    _, right = TrialWindows.of(head_recording(), MapperConfig())
    _, coarse = TrialWindows.of(spoilt, MapperConfig())
    lost = right.log_sharpness(lambda r: r, (0, 1)) - coarse.log_sharpness(lambda r: r, (0, 1))
    assert (lost > 0.1).all()
    np.testing.assert_allclose(coarse.free_turn_gains(lambda r: r, (0, 1)), lost, atol=0.05)


@pytest.mark.parametrize("amount", amounts("stereo"))
def test_a_turn_of_the_second_camera_that_was_planted_is_taken_out_again(amount):
    """By 1.2 deg, which is a sum of steps: what was lost comes back."""
    _, right = TrialWindows.of(head_recording(), MapperConfig())
    before = right.log_sharpness(lambda r: r, (0, 1))
    lost = before - right.log_sharpness(lambda r: amount.change(r, 1.2), (0, 1))
    gains = right.free_squint_gains(lambda r: amount.change(r, 1.2), (0, 1))
    assert (lost > 0.06).all()
    np.testing.assert_allclose(gains, lost, atol=0.05)


def test_camera_0_alone_sees_a_convention_of_the_poses_and_nothing_between_the_cameras():
    names = ("poses inverted", "rotations inverted", "quaternions w first")
    few = [a for a in of_poses(head_recording()) if a.name in names]
    inverted = next(a.change for a in few if a.name == "poses inverted")
    _, yaw, _ = amounts("stereo")

    def alone(recording):
        return CameraTrials(TrialWindows.of(recording, MapperConfig()), (0, 1)).gain_alone(few)

    assert alone(yaw.change(head_recording(), 3.0)) <= 0
    assert alone(inverted(head_recording())) > 0.04


def test_an_amount_that_each_window_wants_otherwise_is_no_cause():
    (clock,), gains = amounts("delay"), np.full(3, 0.1)

    def trial(uneven):
        tried = {40.0: gains, 60.0: np.array([0.1 + 3 * uneven, 0.0, 0.0])}
        return Trial(clock, gains, lambda r: r, 0.015, 40.0, tried)

    assert trial(0.003).uneven == pytest.approx(0.003)
    assert trial(0.003).is_cause
    assert not trial(0.005).is_cause


def test_the_leading_window_alone_is_as_sharp_as_among_the_others():
    _, coarse = TrialWindows.of(head_recording(), MapperConfig())
    alone = coarse.leading.log_sharpness(lambda r: r, (0, 1))
    among = coarse.log_sharpness(lambda r: r, (0, 1))
    assert alone == among[coarse.leading_at]


def test_pixels_of_a_large_sensor_are_joined():
    """Events stay as many, so that on more pixels they would only lie thinner."""
    rig = head_recording().rig
    cameras = tuple(replace(c, width_px=1280, height_px=720) for c in rig.cameras)
    wide = AlteredRecording(head_recording(), rig=replace(rig, cameras=cameras))
    scales = [[w.sharpness.level.scale for w in TrialWindows.of(r, MapperConfig())]
              for r in (head_recording(), wide)]  # fmt: skip
    assert scales == [[1, 2], [3, 6]]


@pytest.mark.slow
def test_poses_that_no_alternative_mends_are_not_blamed_on_one():
    """A tracker that overstates how far the head turns: no convention, clock or lens does that."""

    def overstated(s):
        return np.column_stack([0.5 * np.sin(7 * s), 0.4 * np.cos(9 * s), 0.5 * np.sin(5 * s + 1)])

    finding = check(turned(head_recording(), overstated)).finding("mapping-1")
    assert finding.verdict != "good"
    assert finding.suspect == "no single cause found"
    assert "turn freely" in finding.evidence


@pytest.mark.slow
def test_windows_may_lie_where_poses_are_rare():
    poses = head_recording().trajectory
    few = Trajectory(poses.t_us[::25], poses.positions_m[::25], poses.quats_xyzw[::25])
    gains = free_gains(AlteredRecording(Chosen(head_recording(), (0, 1)), trajectory=few), (0, 1))
    assert np.isfinite(gains).all()
    assert (gains >= 0).all()


def test_cameras_that_fit_agree_as_well_as_halves_of_one_do_unless_one_is_mirrored():
    def mirrored(recording):
        class Mirrored(AlteredRecording):
            def events(self, camera, t0_us, t1_us):
                e, rows = super().events(camera, t0_us, t1_us), recording.rig.cameras[1].height_px
                return e if camera == 0 else replace(e, y=(rows - 1 - e.y).astype(np.uint16))

        return Mirrored(recording)

    _, coarse = TrialWindows.of(head_recording(), MapperConfig())
    assert (coarse.agreement(lambda r: r, (0, 1)) > -0.08).all()
    assert (coarse.agreement(mirrored, (0, 1)) < -0.2).all()
