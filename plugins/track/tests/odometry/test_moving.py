"""Independently moving bodies: their edges are detected, and do not disturb the pose."""

import numpy as np
import pytest

import line_world
import point_world as world
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.track.odometry.batches import Sizes
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.registration.fit import Registration
from eventsweep.plugins.track.odometry.registration.views import DrawnEvents, DrawnMap, View

T_US, HALF_US = 60_000, 8000
LIKELY = 12.592  # chi-squared of 6 degrees of freedom, 95 %
BODY_M_S = np.array([1.5, 0.9, 0.0])
WAY = world.swinging(way_m=(0.08, 0.05, 0.04), duration_us=120_000)
AT_REST = line_world.recorded(WAY)
VIEWS = list(map(View, AT_REST.rig.cameras, AT_REST.rig.T_body_cam))


def body():
    """(N, 3) points of a body where it is at `T_US`, m: short edges on the left, near."""
    points = line_world.edges(segments=10, seed=3, near_m=0.9, far_m=1.1)
    return points * [0.35, 0.5, 1.0] - [0.25, 0.0, 0.0]


def batch_of(points, velocity_m_s):
    """Events of both cameras around `T_US`, of points that move so by themselves."""
    away_m = (WAY.t_us[:, None] - T_US) * 1e-6 * velocity_m_s
    seen_by = Trajectory(WAY.t_us, WAY.positions_m - away_m, WAY.quats_xyzw)
    span_us = T_US - HALF_US, T_US + HALF_US
    return [
        world._entered(points, seen_by, view_camera, T).between(*span_us)
        for view_camera, T in zip(AT_REST.rig.cameras, AT_REST.rig.T_body_cam, strict=True)
    ]


def both(first, second):
    mixed = [Events.concat(pair) for pair in zip(first, second, strict=True)]
    return [events.take(np.argsort(events.t_us, kind="stable")) for events in mixed]


def twist_at(t_us):
    return se3.log(se3.inverse(WAY.at(t_us - 1000)) @ WAY.at(t_us + 1000)) / 0.002


@pytest.mark.parametrize(("points", "velocity_m_s", "least", "most"), [
    pytest.param(line_world.edges(), np.zeros(3), 0.0, 0.1, id="at rest"),
    pytest.param(body(), np.zeros(3), 0.0, 0.1, id="body at rest"),
    pytest.param(body(), BODY_M_S, 0.4, 1.0, id="moving body"),
])  # fmt: skip
def test_events_of_what_moves_by_itself_take_no_part(points, velocity_m_s, least, most):
    drawn, events = DrawnMap(VIEWS, 1), DrawnEvents(VIEWS, 1, 800)
    drawn.draw(points, se3.inverse(WAY.at(T_US)), 1)
    events.draw(batch_of(points, velocity_m_s), T_US, drawn, twist_at(T_US), 1, judged=True)
    taken = np.concatenate([rows[:n] for rows, n in zip(events.events, events.counts, strict=True)])
    assert least <= np.mean(taken[:, 7] == 0) <= most


def drawn_events(drawn, fields, batch):
    fields.draw(batch, T_US, drawn, twist_at(T_US), 1, judged=True)
    return [rows[:n].copy() for rows, n in zip(fields.events, fields.counts, strict=True)]


def test_what_was_drawn_before_moves_no_event():
    """Where a line has drifted, too few events of the next batch lie to say anything."""
    drawn, used = DrawnMap(VIEWS, 1), DrawnEvents(VIEWS, 1, 800)
    drawn.draw(line_world.edges(), se3.inverse(WAY.at(T_US)), 1)
    moving = batch_of(body(), BODY_M_S)
    drawn_events(drawn, used, moving)
    few = [events.take(np.arange(len(events)) % 40 == 0) for events in moving]
    fresh = drawn_events(drawn, DrawnEvents(VIEWS, 1, 800), few)
    for rows, alone in zip(drawn_events(drawn, used, few), fresh, strict=True):
        np.testing.assert_array_equal(rows, alone)


def registration_with(points):
    sizes = Sizes(AT_REST.rig)
    registration = Registration(VIEWS, sizes.levels, sizes.own_time)
    registration.use_map(points, points[::3].copy())
    return registration


def test_unless_it_is_asked_what_drifts_takes_part_and_says_that_the_rig_turned_back():
    """All of a world at rest drifts if the twist is the opposite of what was to be expected."""
    registration = registration_with(line_world.edges())
    covariance = np.diag(np.repeat([0.005, 0.005, 0.15, 0.5], 3) ** 2)
    expected = Motion(T_US, WAY.at(T_US), -twist_at(T_US), covariance)
    batch = batch_of(line_world.edges(), np.zeros(3))
    (plain, seen), (judged, left) = (
        registration.nearby(batch, expected, **how) for how in ({}, {"judged": True})
    )
    assert seen.inliers > 1.5 * left.inliers
    assert plain.surprise(expected) > 1.5 * judged.surprise(expected)


def found_among_moving(judged):
    """The motion found where a body of the map moves on, and its error (6,), m and rad."""
    registration = registration_with(np.concatenate([line_world.edges(), body()]))
    batch = both(batch_of(line_world.edges(), np.zeros(3)), batch_of(body(), BODY_M_S))
    near = Motion.near(T_US, WAY.at(T_US))
    expected = Motion(T_US, WAY.at(T_US), twist_at(T_US), near.covariance)
    motion, _ = registration._from_level(1, batch, expected, judged=judged)
    return motion, se3.log(se3.inverse(WAY.at(T_US)) @ motion.T_world_body)


def test_a_moving_body_in_the_map_leaves_the_pose_within_its_covariance():
    motion, xi = found_among_moving(judged=True)
    assert xi @ np.linalg.solve(motion.covariance[:6, :6], xi) < LIKELY
    off, followed = (
        np.linalg.norm(found_among_moving(judged)[0].twist - twist_at(T_US))
        for judged in (True, False)
    )
    assert off < 0.15 < 1.0 < followed
