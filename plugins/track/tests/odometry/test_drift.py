"""The covariance of poses: its laws, and a random walk that it must cover."""

import numpy as np
import pytest

from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry import drift as module
from eventsweep.plugins.track.odometry.drift import MOST_SHARE, Drift, Way
from eventsweep.plugins.track.odometry.motion import Motion

WINDOW_US = 100_000, 400_000
BATCH = np.diag(np.repeat([1e-3, 2e-3], 3) ** 2)


def at(place_m, turn=(0, 0, 0), factor=1.0):
    """A motion there, that a batch leaves open by `BATCH`, lengths times a factor."""
    covariance = np.zeros((12, 12))
    covariance[:6, :6] = np.outer(*[np.repeat([factor, 1], 3)] * 2) * BATCH
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


@pytest.mark.parametrize("is_pair", [True, False])
def test_a_calibration_turns_the_path_alike_in_a_world_of_any_size(is_pair):
    """Law: with lengths that grow by a factor, turns stay as sure, and places by that less."""
    turns, places = [], []
    for factor in (1.0, 10.0):
        drift, exact = Drift(module._NO_BASELINE * factor * is_pair), Drift()
        for k in range(20):
            pose = at([0.05 * k * factor, 0, 0])
            added = drift.at(pose, 1 / factor) - exact.at(pose, 0)
        turns.append(np.sqrt(added[3, 3]))
        places.append(np.sqrt(added[0, 0]))
    assert np.allclose(turns, module._TURN * 0.95 / module._NO_BASELINE)
    assert np.allclose(places, turns[0] * 0.95 / 2 * np.array([1, 10]))


def test_an_angle_between_cameras_looks_like_a_turn_by_as_much_per_way_over_baseline():
    """Derived anew by projections: a pair maps points with an angle wrong by `eps`, and the flow of
    a move across is explained best, on that map, by the move and a turn of eps times way over
    baseline: whatever the depths are."""
    eps, baseline_m, way_m = 1e-4, 0.07, 0.02
    x, Z = np.random.default_rng(0).uniform([-0.2, 1.0], [0.2, 9.0], (500, 2)).T
    Z_wrong = baseline_m / (baseline_m / Z + eps * (1 + x**2))
    seen = x - way_m / Z
    J = np.column_stack([-1 / Z_wrong, 1 + x**2])  # by a move, and by a turn
    moved_m, turned = np.linalg.lstsq(J, seen - x, rcond=None)[0]
    assert moved_m == pytest.approx(way_m, rel=1e-3)
    assert turned == pytest.approx(eps * way_m / baseline_m, rel=1e-2)


def test_a_scale_that_is_off_stretches_all_of_the_way_alike_and_the_way_back_undoes_it():
    """Law: over any number of maps, 2 % of 0.6 m along it, and nothing back at the start."""
    along, exact = Drift(1.0), Drift(1.0)
    there = [0.1 * k for k in range(7)]
    for each, sigma in ((along, 0.02), (exact, 0.0)):
        each.next_map(sigma, WINDOW_US)
    for x_m in there + there[::-1]:
        added = along.at(at([x_m, 0, 0]), 0) - exact.at(at([x_m, 0, 0]), 0)
        assert added[0, 0] == pytest.approx((0.02 * x_m) ** 2)
        assert np.trace(added) == pytest.approx(added[0, 0])
        for each, sigma in ((along, 0.02), (exact, 0.0)):
            each.next_map(sigma, WINDOW_US)


def test_every_map_adds_a_step_and_the_state_goes_on_alike():
    drift, traces = Drift(), []
    for k in range(6):
        traces.append(np.trace(drift.at(at([0.1 * k, 0, 0], [0, 0.1 * k, 0]), 1)))
        drift.next_map(0.01, WINDOW_US)
    assert (np.diff(traces) > 0).all()
    again = Drift()
    again.restore(drift.state())
    later = at([1, 0, 0])
    np.testing.assert_array_equal(again.at(later, 1), drift.at(later, 1))


def test_a_map_of_twice_the_time_adds_half_of_what_batches_leave_open():
    added = []
    for length_us in (50_000, 100_000):
        drift = Drift()
        before = drift.at(at([0, 0, 0]), 0)
        drift.next_map(0.0, (0, length_us))
        added.append(drift.at(at([0, 0, 0]), 0) - before)
    np.testing.assert_allclose(added[0], 2 * added[1])


def test_a_way_on_which_events_and_map_disagreed_counts_once_a_map_was_made_on_it():
    """Law: of the poses at 0.1 to 0.9 m those from 0.4 on are doubted, the map ends at 0.6 m."""
    drift, plain = Drift(), Drift()
    for k in range(10):
        for each in (drift, plain):
            each.at(at([0.1 * k, 0, 0]), 0)
        drift.note(1000 * k, is_doubted=k >= 4)
    assert not drift.is_astray
    for each in (drift, plain):
        each.next_map(0.0, (0, 6000))
    added = drift.at(at([0.9, 0, 0]), 0) - plain.at(at([0.9, 0, 0]), 0)
    assert np.isclose(np.trace(added), (module._DOUBTED * 0.3) ** 2)
    assert drift.is_astray
    again = Drift()
    again.restore(drift.state())
    again.next_map(0.0, (0, 9000))
    drift.found_again()
    drift.next_map(0.0, (0, 9000))
    later = [np.trace(each.at(at([0.9, 0, 0]), 0)[:3, :3]) for each in (drift, again)]
    assert later[0] < later[1]


def test_a_path_that_went_astray_is_known_again_once_that_is_a_small_share_of_it():
    drift = Drift()
    drift.at(at([0, 0, 0]), 0)
    drift.at(at([0.1, 0, 0]), 0)
    drift.note(1000, is_doubted=True)
    drift.next_map(0.0, (0, 1000))
    known_m = module._DOUBTED * 0.1 / MOST_SHARE
    drift.at(at([0.99 * known_m, 0, 0]), 0)
    assert drift.is_astray
    drift.at(at([1.01 * known_m, 0, 0]), 0)
    assert not drift.is_astray


def test_errors_of_a_random_walk_lie_within_it_as_often_as_it_says():
    """Steps of the world, a draw per map, and a draw per pose, as large as it assumes."""
    rng, inside = np.random.default_rng(0), []
    for _ in range(400):
        drift, off = Drift(), rng.normal(size=6) * np.sqrt(np.diag(BATCH)) * module._BATCH
        for k in range(5):
            covariance = drift.at(at([0.3 * k, 0, 0]), 0)
            drift.next_map(0.0, WINDOW_US)
            step = rng.normal(size=6) * np.sqrt(np.diag(BATCH) * module._ALIKE_S / 0.3)
            own = rng.normal(size=6) * np.sqrt(np.diag(BATCH)) * module._BATCH
            if k:
                off[:3] += np.cross(off[3:], [0.3, 0, 0])
            error = off + own
            off = off + step
        inside.append(error @ np.linalg.solve(covariance, error) < 12.59)
    assert 0.92 < np.mean(inside) < 0.99


SIGMA_M = np.trace(BATCH[:3, :3]) ** 0.5


def walked(length_m, poses=200, factor=1.0):
    """Along a straight path."""
    way = Way()
    for x_m in np.linspace(0, length_m, poses):
        way.add(at([x_m, 0, 0], factor=factor))
    return way


@pytest.mark.parametrize("factor", [0.01, 1.0, 1000.0])
def test_a_way_is_known_once_its_poses_are_to_a_share_of_it_in_a_world_of_any_size(factor):
    """Law: of lengths only ratios count; and the true length is found but for a step of noise."""
    just_m = factor * SIGMA_M / MOST_SHARE
    assert not walked(0.95 * just_m, factor=factor).is_known
    assert walked(1.1 * just_m, factor=factor).is_known
    assert walked(just_m, factor=factor).length_m == pytest.approx(just_m, rel=0.05)


def test_noise_is_no_way_however_long_it_lasts():
    """As large as the errors of twins are at most, without a break: 10 s at one place."""
    rng, way = np.random.default_rng(0), Way()
    for _ in range(1000):
        way.add(at(0.5 * rng.normal(size=3) * np.sqrt(np.diag(BATCH)[:3])))
    assert way.length_m < 0.2 * SIGMA_M / MOST_SHARE
    assert not Way().is_known


def test_an_interruption_begins_what_is_not_known_anew_and_leaves_no_step():
    just_m = SIGMA_M / MOST_SHARE
    short, known = walked(0.9 * just_m), walked(2 * just_m)
    for way in (short, known):
        way.interrupt()
        way.add(at([10, 0, 0]))
    assert short.length_m == 0
    assert known.length_m == pytest.approx(2 * just_m, rel=0.05)
    again = Way()
    again.restore(known.state())
    assert again.is_known
    assert vars(again) == vars(known)
