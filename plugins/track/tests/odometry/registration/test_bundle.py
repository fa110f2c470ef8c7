"""Poses and depths found together: equations against slow twins, and errors that are planted."""

import numpy as np
from scipy.optimize import approx_fprime

import line_world
import point_world as world
from eventsweep.emvs.geometry import se3
from eventsweep.plugins.track.odometry.batches import Batch, Sizes
from eventsweep.plugins.track.odometry.motion import Motion
from eventsweep.plugins.track.odometry.registration.bundle import Equations, adjusted
from eventsweep.plugins.track.odometry.registration.fit import Registration
from eventsweep.plugins.track.odometry.registration.residuals_kernels import depths_to_events
from eventsweep.plugins.track.odometry.registration.views import LineFields, View

CAMERA = world.pinhole(width=160, height=120, f=130.0)
VIEW = View(CAMERA, se3.exp([0.05, -0.02, 0.03, 0.1, -0.2, 0.05]))
T_BODY_WORLD = se3.exp([0.3, -0.1, 0.2, 0.05, 0.1, -0.1])
MIDDLE_M = np.array([-0.2, 0.15, -0.1])
POINT = se3.transform(se3.inverse(VIEW.T_cam_body @ T_BODY_WORLD), np.array([0.2, -0.1, 1.3]))


def pixel(unknowns):
    """Where the point is seen, of (7,) a correction of the pose and the logarithm of its depth."""
    point = MIDDLE_M + np.exp(unknowns[6]) * (POINT - MIDDLE_M)
    T_cam_world = VIEW.T_cam_body @ se3.exp(unknowns[:6]) @ T_BODY_WORLD
    x, y, z = se3.transform(T_cam_world, point)
    fx, fy, cx, cy = VIEW.intrinsics
    return np.array([fx * x / z + cx, fy * y / z + cy])


def test_equations_of_a_point_are_those_of_its_residual_by_pose_and_depth():
    normal = np.array([0.6, 0.8])
    here, along = pixel(np.zeros(7)), np.array([0.8, -0.6])
    line = here + 0.7 * normal + np.arange(-30, 30, 0.25)[:, None] * along
    fields = LineFields([VIEW.size_px], 1)
    fields.begin()
    fields.fill(0, np.c_[line, np.ones(len(line))], len(line), 1)
    H, g, a, b, c = np.zeros((6, 6)), np.zeros(6), np.zeros(1), np.zeros((1, 6)), np.zeros(1)
    depths_to_events(
        POINT[None], normal[None], MIDDLE_M, VIEW.T_cam_body, T_BODY_WORLD, VIEW.intrinsics,
        VIEW.size, fields.places[0, 0], fields.field, 1e9, 5.0, H, g, a, b, c,
    )  # fmt: skip
    J = approx_fprime(np.zeros(7), lambda unknowns: pixel(unknowns) @ normal, 1e-7)
    weight = H[0, 0] / J[0] ** 2
    assert 0.7 < weight <= 1
    found = np.block([[H, b.T], [b, a[:, None]]])
    np.testing.assert_allclose(
        found, weight * np.outer(J, J), rtol=0.02, atol=0.02 * np.abs(found).max()
    )
    found = np.append(g, c)
    np.testing.assert_allclose(found, -0.7 * weight * J, rtol=0.05, atol=0.05 * np.abs(found).max())


def test_poses_and_depths_step_as_all_unknowns_at_once_would():
    """Slow twin: the whole system of K poses and N depths, each residual of one of both."""
    rng, K, N = np.random.default_rng(3), 4, 9
    equations, whole = Equations.none(K, N), np.eye(6 * K + N)
    whole[: 6 * K, : 6 * K] = 0
    gradient = np.zeros(6 * K + N)
    equations.a[:] = 1
    for k in range(K):
        for n in range(N):
            J, d, r = rng.normal(size=6), rng.normal(), rng.normal()
            equations.H[k] += np.outer(J, J)
            equations.g[k] += J * r
            equations.a[n] += d * d
            equations.b[k, n] += d * J
            equations.c[n] += d * r
            row = np.zeros(6 * K + N)
            row[6 * k : 6 * k + 6], row[6 * K + n] = J, d
            whole, gradient = whole + np.outer(row, row), gradient + r * row
    S, s = equations.reduced()
    xi = -np.linalg.solve(S.reshape(6 * K, 6 * K), s.ravel()).reshape(K, 6)
    step = -np.linalg.solve(whole, gradient)
    np.testing.assert_allclose(xi.ravel(), step[: 6 * K], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(equations.depths(xi), step[6 * K :], rtol=1e-8, atol=1e-10)


def stretch(bend):
    """True and planted motions at batches of a world of edges, with a registration of its points.

    Args:
        bend: share by which points are too far, times the sine of their angle to the right.
    """
    trajectory = world.swinging(way_m=(0.08, 0.05, 0.04), duration_us=300_000)
    recording = line_world.recorded(trajectory)
    times = np.arange(40_000, 260_000, 20_000)
    sizes = Sizes(recording.rig)
    views = list(map(View, recording.rig.cameras, recording.rig.T_body_cam))
    registration = Registration(views, sizes.levels, sizes.own_time)
    middle = trajectory.at(times[len(times) // 2])
    rays = line_world.edges() - middle[:3, 3]
    across = (rays @ middle[:3, 0]) / np.linalg.norm(rays, axis=1)
    points = middle[:3, 3] + (1 + bend * across)[:, None] * rays
    registration.use_map(points, points[::3].copy())
    batches = [
        Batch(int(t), tuple(recording.events(k, t - 6000, t + 6000) for k in (0, 1))) for t in times
    ]
    return trajectory, times, middle[:3, 3], registration, batches


def off(motions, trajectory):
    """Errors of motions (K, 6), m and rad."""
    return np.stack([
        se3.log(se3.inverse(trajectory.at(m.t_us)) @ m.T_world_body) for m in motions
    ])  # fmt: skip


def test_planted_errors_of_poses_and_depths_are_found_together():
    trajectory, times, middle_m, registration, batches = stretch(0.04)
    motions = []
    for t_us in times:
        share = (t_us - times[len(times) // 2]) / (times[-1] - times[0])
        error = se3.exp(share * np.array([0.004, -0.008, 0.004, 0.004, 0.002, -0.004]))
        motions.append(Motion.near(int(t_us), trajectory.at(t_us) @ error))
    found = adjusted(batches, motions, registration, middle_m)
    before, after = (np.sqrt((off(m, trajectory) ** 2).mean(axis=0)) for m in (motions, found))
    assert np.linalg.norm(after[:3]) < 0.35 * np.linalg.norm(before[:3])  # 0.49 by poses alone
    assert np.linalg.norm(after[3:]) < 0.35 * np.linalg.norm(before[3:])
    k = len(times) // 2
    np.testing.assert_allclose(found[k].T_world_body, motions[k].T_world_body, atol=1e-9)
    steps = trajectory.at([times[k] - 4000, times[k] + 4000])
    twist = se3.log(se3.inverse(steps[0]) @ steps[1]) / 0.008
    np.testing.assert_allclose(found[k].twist, twist, atol=0.1)


def test_two_poses_stay_as_they_are():
    trajectory, times, middle_m, registration, batches = stretch(0.0)
    motions = [Motion.near(int(t_us), trajectory.at(t_us)) for t_us in times[:2]]
    assert adjusted(batches[:2], motions, registration, middle_m) == motions
