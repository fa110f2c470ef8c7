"""The beginning expects a slow body or a fast one, and errors do not grow as it maps again."""

from dataclasses import replace

import numpy as np
import pytest

import line_world
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry import start
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.registration.fit import Fit


def fits(near):
    return [Fit(1000, near, 1000, near, 0.75)] * 5


@pytest.mark.parametrize(("fast", "slow", "chosen"), [
    (fits(500), fits(470), "fast"),
    (fits(500), fits(495), "slow"),  # as good: the slower one
    (fits(500), fits(530), "slow"),
    ("only 2 of 5 batches fit", fits(300), "slow"),
    (fits(300), "only 2 of 5 batches fit", "fast"),
    ("none fits", "only 2 of 5 batches fit", "only 2 of 5 batches fit"),
])  # fmt: skip
def test_a_fast_body_is_believed_only_where_it_agrees_better(monkeypatch, fast, slow, chosen):
    begun = Motion.unknown(0, np.eye(4), reach=3.0)

    def tracked(_batches, _k_start, _every, motion, *_rest):
        found = fast if motion.reach == begun.reach else slow
        return found if isinstance(found, str) else ([motion] * 5, found)

    monkeypatch.setattr(start, "_tracked", tracked)
    found = start._slow_or_fast([], 0, 1, begun, np.empty((0, 3)), None, None)
    if isinstance(found, str):
        assert found == chosen
    else:
        motions, agreement, _ = found
        assert agreement == {"fast": fast, "slow": slow}[chosen]
        assert (motions[0].covariance[6, 6] < begun.covariance[6, 6]) == (chosen == "slow")


def test_before_a_far_wall_a_body_nearly_at_rest_is_tried_too(monkeypatch):
    """Where a slow one follows what passes, as the fast one does, but not as well."""

    def chosen(reach):
        tried = {}

        def tracked(_batches, _k_start, _every, motion, *_rest):
            found = fits({reach: 500, 0.1 * reach: 450}.get(motion.reach, 490))
            tried[len(tried)] = motion.reach / reach
            return [motion] * 5, found

        monkeypatch.setattr(start, "_tracked", tracked)
        begun = Motion.unknown(0, np.eye(4), reach=reach)
        (motion, *_), *_ = start._slow_or_fast([], 0, 1, begun, np.empty((0, 3)), None, None)
        return motion.reach / reach, len(tried)

    assert chosen(3.0) == (pytest.approx(0.03), 3)
    assert chosen(1.0) == (1.0, 2)


@pytest.mark.parametrize(("reach", "slow_m", "is_observable", "tried"), [
    (3.0, 0.08, True, 2),
    (3.0, 0.02, False, 3),  # the way is what was expected: it may be that of what passes
    (1.0, 0.02, True, 2),  # near things show the way
])  # fmt: skip
def test_a_way_is_observable_where_all_is_near_or_whatever_was_expected(
    monkeypatch, reach, slow_m, is_observable, tried
):
    calls = []

    def tracked(_batches, _k_start, _every, motion, *_rest):
        calls.append(motion)
        end = np.eye(4)
        end[0, 3] = 0.1 if motion.reach == reach else slow_m
        return [motion, replace(motion, T_world_body=end)], fits(500 if len(calls) == 1 else 300)

    monkeypatch.setattr(start, "_tracked", tracked)
    begun = Motion.unknown(0, np.eye(4), reach=reach)
    found = start._slow_or_fast([], 0, 1, begun, np.empty((0, 3)), None, None)
    assert (found[2], len(calls)) == (is_observable, tried)


def test_mapping_the_stretch_again_makes_its_poses_no_worse(monkeypatch):
    """Of edges that are nearly upright, a turn with a shift along them hardly shows.

    A map on poses that err so shows the same error, and the poses on it would err more.
    """
    upright = line_world.edges(seed=1, near_m=1.5, along=(0.1, 1, 0.4))
    monkeypatch.setattr(line_world, "edges", lambda seed: upright)
    recording = line_world.swaying(300_000)

    def off_m(rounds):
        monkeypatch.setattr(start, "_ROUNDS", rounds)
        tracker, poses = line_world.tracker_of(recording)
        tracker.push([recording.events(camera, 0, 260_000) for camera in (0, 1)], 260_000)
        found = np.stack([pose.T_world_body for pose in poses])
        found = Trajectory.from_matrices([pose.t_us for pose in poses], found)
        return score_poses(recording.trajectory, found).values["ate_rmse"]

    assert off_m(8) < 1.25 * off_m(2) < 0.004
