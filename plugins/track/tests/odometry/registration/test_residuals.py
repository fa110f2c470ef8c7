"""The residuals' Jacobians against finite differences, and a pose that is planted is recovered."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import line_world
import point_world as world
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.batches import Sizes
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.registration.fit import Registration
from eventsweep.plugins.track.odometry.registration.gauss_newton_kernels import (
    motion_of,
    solve,
    to_body,
)
from eventsweep.plugins.track.odometry.registration.residuals_kernels import (
    events_to_map,
    later,
    map_to_events,
    slope,
)
from eventsweep.plugins.track.odometry.registration.views import (
    DrawnEvents,
    DrawnMap,
    LineFields,
    View,
)

CAMERA = world.pinhole(width=160, height=120, f=130.0)
T_BODY_CAM = se3.exp([0.05, -0.02, 0.03, 0.1, -0.2, 0.05])
VIEW = View(CAMERA, T_BODY_CAM)
X_CAM = np.array([0.2, -0.1, 1.3])


def projected(X_cam):
    x, y, z = X_cam
    fx, fy, cx, cy = VIEW.intrinsics
    return np.array([fx * x / z + cx, fy * y / z + cy])


def seen(uv, depth_m):
    """The point that a pixel sees at a depth."""
    fx, fy, cx, cy = VIEW.intrinsics
    return depth_m * np.array([(uv[0] - cx) / fx, (uv[1] - cy) / fy, 1.0])


def differences(f, n=6, step=1e-6):
    """Central differences of a function of (n,) at 0."""
    steps = step * np.eye(n)
    return np.array([(f(d) - f(-d)) / (2 * step) for d in steps])


@pytest.mark.parametrize("normal", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_the_slope_is_that_of_the_projection(normal):
    J = slope(*(normal * VIEW.intrinsics[:2]), *X_CAM, 1 / X_CAM[2])
    numeric = differences(lambda xi: projected(se3.transform(se3.exp(xi), X_CAM)) @ normal)
    np.testing.assert_allclose(J, numeric, rtol=1e-6, atol=1e-5)


def test_a_point_moves_as_the_twist_says_to_second_order():
    twist = np.array([0.5, -0.3, 0.2, 1.0, -2.0, 0.7])
    for dt_s in (-0.02, 0.01, 0.02):
        exact = se3.transform(se3.exp(-twist * dt_s), X_CAM)
        np.testing.assert_allclose(later(*X_CAM, twist, dt_s), exact, atol=3e-5)


@given(st.integers(0, 1000), st.sampled_from([1e-9, 1e-5, 0.1, 2.0]))
def test_the_motion_of_a_twist_is_its_exponential(seed, size):
    xi, T = size * np.random.default_rng(seed).normal(size=6), np.empty((4, 4))
    motion_of(xi, T)
    np.testing.assert_allclose(T, se3.exp(xi), rtol=1e-9, atol=1e-12)


@given(st.integers(0, 1000))
def test_normal_equations_are_solved(seed):
    rng = np.random.default_rng(seed)
    A, g, x = rng.normal(size=(20, 12)), rng.normal(size=12), np.empty(12)
    H = A.T @ A + 1e-3 * np.eye(12)
    solve(H, g, np.zeros((12, 12)), x)
    np.testing.assert_allclose(x, np.linalg.solve(H, -g), rtol=1e-6, atol=1e-9)


def test_what_a_camera_sees_says_the_same_of_the_body():
    """A camera at the body's frame moved by xi is at its own moved by the adjoint of xi."""
    J_cam = np.random.default_rng(2).normal(size=(30, 12))
    r = np.random.default_rng(3).normal(size=30)
    H, g = np.zeros((12, 12)), np.zeros(12)
    to_body(J_cam.T @ J_cam, J_cam.T @ r, VIEW.adjoint, H, g)
    J = J_cam @ np.kron(np.eye(2), VIEW.adjoint)
    np.testing.assert_allclose(H, J.T @ J, atol=1e-9)
    np.testing.assert_allclose(g, J.T @ r, atol=1e-9)
    xi = np.array([0.1, 0.2, -0.1, 0.3, -0.2, 0.1])
    moved = VIEW.T_cam_body @ se3.exp(xi) @ VIEW.T_body_cam
    np.testing.assert_allclose(moved, se3.exp(VIEW.adjoint @ xi), atol=1e-12)


def drawn_line(uv, normal, rho):
    """A long straight line of points through a place: place of its image, and the field."""
    along = np.array([normal[1], -normal[0]])
    points = uv + np.arange(-30, 30, 0.25)[:, None] * along
    fields = LineFields([VIEW.size_px], 1)
    fields.begin()
    fields.fill(0, np.c_[points, np.full(len(points), rho)], len(points), 1)
    return fields.places[0, 0], fields.field


def test_normal_equations_of_a_map_point_are_those_of_its_residual():
    normal = np.array([0.6, 0.8])
    uv = projected(X_CAM)
    lines = drawn_line(uv + 0.7 * normal, normal, 1.0)
    H, g = np.zeros((6, 6)), np.zeros(6)
    args = X_CAM[None], -normal[None], np.eye(4), VIEW.intrinsics, VIEW.size, *lines, 1e9, 5.0, H, g
    assert map_to_events(*args)[:2] == (1, 1)
    J = differences(lambda xi: projected(se3.transform(se3.exp(xi), X_CAM)) @ normal)
    # g is w J r and H is w J J^T, of the same weight in 0..1.
    weight = H[0, 0] / J[0] ** 2
    assert 0.7 < weight <= 1
    np.testing.assert_allclose(H, weight * np.outer(J, J), rtol=0.02, atol=0.02 * H.max())
    np.testing.assert_allclose(g, weight * J * -0.7, rtol=0.05, atol=0.05 * np.abs(g).max())


@pytest.mark.parametrize("dt_s", [-0.01, 0.0, 0.02])
def test_normal_equations_of_an_event_are_those_of_its_residual(dt_s):
    """At rest the Jacobian is exact: pose and twist against finite differences of the residual."""
    normal, depth_m = np.array([0.8, -0.6]), 1.3
    uv = projected(X_CAM)
    lines = drawn_line(uv, normal, 1 / depth_m)
    event = uv + 0.5 * normal
    H, g = np.zeros((12, 12)), np.zeros(12)
    counts = events_to_map(
        np.array([[*event, dt_s, *normal, *seen(event, depth_m)]]), 1, *lines, np.eye(4),
        np.zeros(6), VIEW.intrinsics, 1e9, 5.0, H, g,
    )  # fmt: skip
    assert counts[:2] == (1, 1)

    def residual(parameters):
        moving = se3.exp(-parameters[6:] * dt_s) @ se3.exp(parameters[:6])
        return normal @ (event - projected(se3.transform(moving, X_CAM)))

    J = differences(residual, 12)
    weight = H[0, 0] / J[0] ** 2
    assert 0.7 < weight <= 1
    np.testing.assert_allclose(H, weight * np.outer(J, J), rtol=0.02, atol=0.02 * H.max())
    np.testing.assert_allclose(g, weight * J * 0.5, rtol=0.05, atol=0.05 * np.abs(g).max())


@pytest.mark.parametrize("degrees", [0, 30, 60, 90, 120])
def test_edges_of_like_direction_count_most(degrees):
    """Law: the share falls with the angle between two lines, from 1 to a quarter where they cross.

    3/4 of the squared cosine is 3/8 of 1 and the cosine of twice the angle.
    """
    angle = np.radians(degrees)
    normal, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    lines = drawn_line(projected(X_CAM) + 0.7 * normal, normal, 1 / 1.3)

    def weight_of(own):
        H, H_map, g = np.zeros((12, 12)), np.zeros((6, 6)), np.zeros(12)
        uv, still = projected(X_CAM), (np.eye(4), np.zeros(6))
        event = np.array([[*uv, 0.0, *own, *seen(uv, 1.0)]])
        lens, rest = VIEW.intrinsics, (1e9, 5.0)
        assert events_to_map(event, 1, *lines, *still, lens, *rest, H, g)[1] == 1
        args = X_CAM[None], own[None], np.eye(4), lens, VIEW.size, *lines, *rest, H_map, np.zeros(6)
        assert map_to_events(*args)[1] == 1
        return np.array([H[0, 0], H_map[0, 0]])

    share = weight_of(np.cos(angle) * normal + np.sin(angle) * across) / weight_of(normal)
    np.testing.assert_allclose(share, 5 / 8 + 3 / 8 * np.cos(2 * angle), rtol=1e-6)


def test_events_and_points_know_the_lines_that_they_lie_on():
    """Of a world of edges, nearly all that are in view do."""
    trajectory = world.swinging(way_m=(0.08, 0.05, 0.04), duration_us=120_000)
    recording = line_world.recorded(trajectory)
    views = list(map(View, recording.rig.cameras, recording.rig.T_body_cam))
    drawn, T_body_world = DrawnMap(views, 1), se3.inverse(trajectory.at(60_000))
    points = line_world.edges()
    drawn.draw(points, T_body_world, 1)
    own = drawn.normals(points, T_body_world)
    length = np.linalg.norm(own, axis=-1)
    np.testing.assert_allclose(length[length > 0], 1.0, rtol=1e-5)
    assert ((length > 0).sum(axis=1) > 0.9 * np.array(drawn.counts)).all()
    events, batch = (
        DrawnEvents(views, 1, 500),
        [recording.events(k, 52_000, 68_000) for k in (0, 1)],
    )
    twist = se3.log(se3.inverse(trajectory.at(59_000)) @ trajectory.at(61_000)) / 0.002
    events.draw(batch, 60_000, drawn, twist, 1)
    length = np.linalg.norm(events.events[..., 3:5], axis=-1)
    np.testing.assert_allclose(length[length > 0], 1.0, rtol=1e-5)
    assert (length > 0).mean() > 0.9


PLANTED = [0.006, -0.005, 0.004, 0.004, -0.005, 0.003]


def registered(planted, step):
    """True and found motion at 60 ms, of a world of edges, from a pose that is wrong by so much.

    `step` makes a motion and its fit out of a registration, a batch and what is expected.
    """
    trajectory = world.swinging(way_m=(0.08, 0.05, 0.04), duration_us=120_000)
    recording = line_world.recorded(trajectory)
    t_us, sizes = 60_000, Sizes(recording.rig)
    views = list(map(View, recording.rig.cameras, recording.rig.T_body_cam))
    registration = Registration(views, sizes.levels, sizes.own_time)
    points = line_world.edges()
    registration.use_map(points, points[::3].copy())
    batch = [recording.events(k, t_us - 8000, t_us + 8000) for k in (0, 1)]
    expected = Motion.near(t_us, trajectory.at(t_us) @ se3.exp(planted))
    return trajectory, *step(registration, batch, expected)


@pytest.mark.parametrize("step", [Registration.__call__, Registration.nearby])
def test_a_planted_pose_is_recovered(step):
    trajectory, motion, fit = registered(PLANTED, step)
    off = se3.log(se3.inverse(trajectory.at(60_000)) @ motion.T_world_body)
    assert np.linalg.norm(off[:3]) < 0.0015
    assert np.linalg.norm(off[3:]) < 0.0015
    assert fit.events_near > 0.6 * fit.events
    steps = trajectory.at([56_000, 64_000])
    twist = se3.log(se3.inverse(steps[0]) @ steps[1]) / 0.008
    np.testing.assert_allclose(motion.twist, twist, atol=0.25)


@pytest.mark.parametrize(("share", "coarse"), [(0.02, False), (1.0, True)])
def test_coarser_levels_are_asked_only_far_from_what_is_expected(share, coarse, monkeypatch):
    levels, plain = [], Registration._from_level

    def counted(registration, number, *known, **how):
        levels.append(number)
        return plain(registration, number, *known, **how)

    monkeypatch.setattr(Registration, "_from_level", counted)
    registered(share * np.array(PLANTED), Registration.nearby)
    assert levels == ([1, 2] if coarse else [1])
