"""The covariance of poses: its laws, and a random walk that it must cover."""

import numpy as np

from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry import drift as module
from eventsweep.plugins.track.odometry.drift import Drift
from eventsweep.plugins.track.odometry.motion import Motion

BATCH = np.diag(np.repeat([1e-3, 2e-3], 3) ** 2)


def at(place_m, turn=(0, 0, 0)):
    """A motion there, that a batch leaves open by `BATCH`."""
    covariance = np.zeros((12, 12))
    covariance[:6, :6] = BATCH
    return Motion(0, se3.exp([*place_m, *turn]), np.zeros(6), covariance)


def test_asking_twice_changes_nothing():
    drift = Drift()
    drift.at(at([0, 0, 0]), 0)
    once, way_m = drift.at(at([0.1, 0.2, 0]), 1), drift.way_m
    np.testing.assert_array_equal(drift.at(at([0.1, 0.2, 0]), 1), once)
    assert drift.way_m == way_m == np.hypot(0.1, 0.2)


def test_a_turn_of_the_world_swings_what_is_far_from_where_it_was_taken():
    """Law: a turn known to s rad leaves a place at distance d, across, open by s d."""
    drift = Drift()
    near = drift.at(at([0, 0, 0]), 0)
    far = drift.at(at([10, 0, 0]), 0)
    grown_m = np.sqrt(far[1, 1] - near[1, 1])
    assert np.isclose(grown_m, np.sqrt(near[3, 3] / 2) * 10)
    assert np.allclose(far[3:, 3:], near[3:, 3:])


def test_a_calibration_turns_the_path_alike_in_a_world_of_any_size():
    """Law: with lengths that grow by a factor, turns stay as sure, and places by that less."""
    turns, places = [], []
    for factor in (1.0, 10.0):
        drift, exact = Drift(), Drift()
        for k in range(20):
            pose = at([0.05 * k * factor, 0, 0])
            added = drift.at(pose, 1 / factor) - exact.at(pose, 0)
        turns.append(np.sqrt(added[3, 3]))
        places.append(np.sqrt(added[0, 0]))
    assert np.allclose(turns, module._TURN * 0.95)
    assert np.allclose(places, turns[0] * 0.95 / 2 * np.array([1, 10]))


def test_every_map_adds_a_step_and_the_state_goes_on_alike():
    drift, traces = Drift(), []
    for k in range(6):
        traces.append(np.trace(drift.at(at([0.1 * k, 0, 0], [0, 0.1 * k, 0]), 1)))
        drift.next_map(0.01)
    assert (np.diff(traces) > 0).all()
    again = Drift()
    again.restore(drift.state())
    later = at([1, 0, 0])
    np.testing.assert_array_equal(again.at(later, 1), drift.at(later, 1))


def test_errors_of_a_random_walk_lie_within_it_as_often_as_it_says():
    """Steps of the world, a draw per map, and a draw per pose, as large as it assumes."""
    rng, inside = np.random.default_rng(0), []
    for _ in range(400):
        drift, off = Drift(), rng.normal(size=6) * np.sqrt(np.diag(BATCH)) * module._BATCH
        for k in range(5):
            covariance = drift.at(at([0.3 * k, 0, 0]), 0)
            drift.next_map(0.0)
            step = rng.normal(size=6) * np.sqrt(np.diag(BATCH)) * module._MAP
            own = rng.normal(size=6) * np.sqrt(np.diag(BATCH)) * module._BATCH
            if k:
                off[:3] += np.cross(off[3:], [0.3, 0, 0])
            error = off + own
            off = off + step
        inside.append(error @ np.linalg.solve(covariance, error) < 12.59)
    assert 0.92 < np.mean(inside) < 0.99
