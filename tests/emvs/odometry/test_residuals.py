"""The residuals' Jacobians against finite differences, and a pose that is planted is recovered."""

from __future__ import annotations

import numpy as np
import pytest

import line_world
import point_world as world
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.odometry.batches import Sizes
from eventsweep.emvs.odometry.lines import LineField
from eventsweep.emvs.odometry.motion import Motion
from eventsweep.emvs.odometry.registration import Registration
from eventsweep.emvs.odometry.residuals_kernels import events_to_map, later, map_to_events, slope
from eventsweep.emvs.odometry.views import View

CAMERA = world.pinhole(width=160, height=120, f=130.0)
T_BODY_CAM = se3.exp([0.05, -0.02, 0.03, 0.1, -0.2, 0.05])
VIEW = View.of(CAMERA, T_BODY_CAM)
X_BODY = se3.transform(T_BODY_CAM, [0.2, -0.1, 1.3])


def projected(X_body):
    x, y, z = se3.transform(VIEW.T_cam_body, X_body)
    fx, fy, cx, cy = VIEW.intrinsics
    return np.array([fx * x / z + cx, fy * y / z + cy])


def differences(f, n=6, step=1e-6):
    """Central differences of a function of (n,) at 0."""
    steps = step * np.eye(n)
    return np.array([(f(d) - f(-d)) / (2 * step) for d in steps])


@pytest.mark.parametrize("normal", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.8)])
def test_the_slope_is_that_of_the_projection(normal):
    J = np.empty(6)
    at = se3.transform(VIEW.T_cam_body, X_BODY)
    slope(*normal, *at, tuple(X_BODY), VIEW.T_cam_body, VIEW.intrinsics, J)
    numeric = differences(lambda xi: projected(se3.transform(se3.exp(xi), X_BODY)) @ normal)
    np.testing.assert_allclose(J, numeric, rtol=1e-6, atol=1e-5)


def test_a_point_moves_as_the_twist_says_to_second_order():
    twist = np.array([0.5, -0.3, 0.2, 1.0, -2.0, 0.7])
    for dt_s in (-0.02, 0.01, 0.02):
        exact = se3.transform(se3.exp(-twist * dt_s), X_BODY)
        np.testing.assert_allclose(later(*X_BODY, twist, dt_s), exact, atol=3e-5)


def drawn_line(uv, normal, rho):
    """Moments of a long straight line of points through a place, drawn by our own field."""
    along = np.array([normal[1], -normal[0]])
    points = uv + np.arange(-30, 30, 0.25)[:, None] * along
    field = LineField(*VIEW.size_px, 0)
    field.fill(np.c_[points, np.full(len(points), rho)], len(points))
    return field


def test_normal_equations_of_a_map_point_are_those_of_its_residual():
    normal = np.array([0.6, 0.8])
    uv = projected(X_BODY)
    field = drawn_line(uv + 0.7 * normal, normal, 1.0)
    H, g = np.zeros((6, 6)), np.zeros(6)
    points = X_BODY[None]
    args = VIEW.T_cam_body, VIEW.intrinsics, VIEW.size, field.moments, 1.0, field.least, 1e9, 5.0
    assert map_to_events(points, np.eye(4), *args, H, g)[:2] == (1, 1)
    J = differences(lambda xi: projected(se3.transform(se3.exp(xi), X_BODY)) @ normal)
    # g is w J r and H is w J J^T, of the same weight in 0..1.
    weight = H[0, 0] / J[0] ** 2
    assert 0.7 < weight <= 1
    np.testing.assert_allclose(H, weight * np.outer(J, J), rtol=0.02, atol=0.02 * H.max())
    np.testing.assert_allclose(g, weight * J * -0.7, rtol=0.05, atol=0.05 * np.abs(g).max())


@pytest.mark.parametrize("dt_s", [-0.01, 0.0, 0.02])
def test_normal_equations_of_an_event_are_those_of_its_residual(dt_s):
    """At rest the Jacobian is exact: pose and twist against finite differences of the residual."""
    normal, depth_m = np.array([0.8, -0.6]), 1.3
    uv = projected(X_BODY)
    field = drawn_line(uv, normal, 1 / depth_m)
    event = uv + 0.5 * normal
    H, g = np.zeros((12, 12)), np.zeros(12)
    rho = np.full((40, 50), 1 / depth_m)
    counts = events_to_map(
        np.array([[*event, dt_s]]), 1, field.moments, 1.0, field.least, rho, 4.0, np.eye(4),
        np.zeros(6), VIEW.T_cam_body, VIEW.T_body_cam, VIEW.intrinsics, 1e9, 5.0, H, g,
    )  # fmt: skip
    assert counts[:2] == (1, 1)

    def residual(parameters):
        moving = se3.exp(-parameters[6:] * dt_s) @ se3.exp(parameters[:6])
        return normal @ (event - projected(se3.transform(moving, X_BODY)))

    J = differences(residual, 12)
    weight = H[0, 0] / J[0] ** 2
    assert 0.7 < weight <= 1
    np.testing.assert_allclose(H, weight * np.outer(J, J), rtol=0.02, atol=0.02 * H.max())
    np.testing.assert_allclose(g, weight * J * 0.5, rtol=0.05, atol=0.05 * np.abs(g).max())


def test_a_planted_pose_is_recovered():
    trajectory = world.swinging(way_m=(0.08, 0.05, 0.04), duration_us=120_000)
    recording = line_world.recorded(trajectory)
    t_us, sizes = 60_000, Sizes.of(recording.rig)
    views = [
        View.of(c, T) for c, T in zip(recording.rig.cameras, recording.rig.T_body_cam, strict=True)
    ]
    registration = Registration(views, sizes.levels, sizes.own_time)
    points = line_world.edges()
    registration.use_map(points, points[::3].copy())
    batch = [recording.events(k, t_us - 8000, t_us + 8000) for k in (0, 1)]
    truth = trajectory.at(t_us)
    planted = truth @ se3.exp([0.006, -0.005, 0.004, 0.004, -0.005, 0.003])
    motion, fit = registration(batch, Motion.near(t_us, planted))
    off = se3.log(se3.inverse(truth) @ motion.T_world_body)
    assert np.linalg.norm(off[:3]) < 0.0015
    assert np.linalg.norm(off[3:]) < 0.0015
    assert fit.events_share > 0.6
    steps = trajectory.at([t_us - 4000, t_us + 4000])
    twist = se3.log(se3.inverse(steps[0]) @ steps[1]) / 0.008
    np.testing.assert_allclose(motion.twist, twist, atol=0.25)
