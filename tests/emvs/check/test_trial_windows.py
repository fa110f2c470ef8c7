"""Free turns: nothing is gained under right poses, and wrong ones that nothing mends are seen."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eventsweep.emvs.check.alternatives import Chosen, of_pair
from eventsweep.emvs.check.recording import check
from eventsweep.emvs.check.trial_windows import TrialWindows
from eventsweep.emvs.check.trials import CameraTrials, Trial
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.altered import AlteredRecording
from eventsweep.emvs.geometry.trajectory import Trajectory
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


def test_poses_that_no_alternative_mends_are_not_blamed_on_one():
    """A tracker that overstates how far the head turns: no convention, clock or lens does that."""

    def overstated(s):
        return np.column_stack([0.5 * np.sin(7 * s), 0.4 * np.cos(9 * s), 0.5 * np.sin(5 * s + 1)])

    finding = check(turned(head_recording(), overstated)).finding("mapping-1")
    assert finding.verdict != "good"
    assert finding.suspect == "no single cause found"
    assert "turn freely" in finding.evidence


def test_windows_may_lie_where_poses_are_rare():
    poses = head_recording().trajectory
    few = Trajectory(poses.t_us[::25], poses.positions_m[::25], poses.quats_xyzw[::25])
    gains = free_gains(AlteredRecording(Chosen(head_recording(), (0, 1)), trajectory=few), (0, 1))
    assert np.isfinite(gains).all()
    assert (gains >= 0).all()


def test_a_later_pair_has_no_convention_that_camera_0_alone_could_name():
    """Conventions of the poses are tried with the first pair only."""
    trials = CameraTrials(TrialWindows.of(head_recording(), MapperConfig()), (0, 1))
    of_cameras = [Trial(one, np.zeros(3), one.change) for one in of_pair()]
    assert trials.sharpest_alone(of_cameras) is None
