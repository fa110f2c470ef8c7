import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import naive_sweep
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from made_events import random_events
from point_world import pinhole
from refusals import refused
from volumes import event_rays

# Strong enough that the corners have no ray.
CAMERA = Camera(40, 30, 25.0, 26.0, 19.0, 15.5, "radtan", (-0.35, 0.02, 0.001, -0.001))


def random_motion(seed, poses=5, turn=0.5):
    rng = np.random.default_rng(seed)
    t_us = np.cumsum(rng.integers(1, 5000, poses)) + 1_000_000
    quats = Rotation.from_rotvec(rng.normal(0, turn, (poses, 3))).as_quat()
    return Trajectory(t_us, rng.normal(0, 0.5, (poses, 3)), quats)


def random_rigid(rng, turn):
    return se3.from_rotation(Rotation.from_rotvec(rng.normal(0, turn, 3)), rng.normal(0, 0.3, 3))


def events_on(rng, camera, first_us, last_us, n):
    return random_events(rng, n, camera.width_px, camera.height_px, first_us, last_us + 1)


@given(seed=st.integers(0, 2**32 - 1), turn=st.sampled_from([0.0, 0.3, 2.0]))
def test_kernel_equals_twin(seed, turn):
    rng = np.random.default_rng(seed)
    motion = random_motion(seed, turn=turn)
    T_body_cam, T_world_rv = random_rigid(rng, turn), random_rigid(rng, turn)
    first_us, last_us = motion.span_us
    events = events_on(rng, CAMERA, first_us - 500, last_us + 500, 200)
    events.t_us[50:52] = events.t_us[50]
    rays = event_rays(events, CAMERA, T_body_cam, motion, T_world_rv, pinhole())
    twin = naive_sweep.rays(events, CAMERA, T_body_cam, motion, T_world_rv, pinhole())
    fates = [row[0] for row in twin]
    counts = rays.counts
    assert (counts.without_pose, counts.without_ray, counts.backwards, counts.rays) == tuple(
        fates.count(fate) for fate in ("pose", "ray", "backwards", "votes")
    )
    expected = np.array([row[1:] for row in twin if row[0] == "votes"]).reshape(-1, 5)
    got = np.stack([rays.a_u, rays.b_u, rays.a_v, rays.b_v, rays.c_z], axis=1)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-4)


def test_every_pose_of_the_span_is_covered_and_nothing_beyond():
    motion = random_motion(1, turn=0.0)
    first_us, last_us = motion.span_us
    t_us = np.array([first_us - 1, first_us, *motion.t_us[1:-1], last_us, last_us + 1])
    n = len(t_us)
    events = Events(np.full(n, 20, np.uint16), np.full(n, 15, np.uint16), t_us,
                    np.zeros(n, np.uint8))  # fmt: skip
    rays = event_rays(events, pinhole(), np.eye(4), motion, motion.at(first_us), pinhole())
    assert rays.counts.without_pose == 2
    np.testing.assert_allclose(
        rays.c_z, motion.positions_m[:, 2] - motion.positions_m[0, 2], atol=1e-6
    )


def test_ray_of_the_reference_view_itself_stays_on_its_pixel():
    motion = random_motion(3, turn=0.5)
    camera = pinhole()
    t_us = int(motion.t_us[2])
    events = Events(np.array([7], np.uint16), np.array([9], np.uint16), np.array([t_us]),
                    np.zeros(1, np.uint8))  # fmt: skip
    rays = event_rays(events, camera, np.eye(4), motion, motion.at(t_us), camera)
    np.testing.assert_allclose([rays.a_u[0], rays.a_v[0]], [7, 9], atol=1e-5)
    np.testing.assert_allclose([rays.b_u[0], rays.b_v[0], rays.c_z[0]], 0, atol=1e-5)


def test_a_point_projects_where_its_ray_says():
    """Law: a point seen at any pose lies on its event's ray, at its own inverse depth."""
    motion, camera = random_motion(5, turn=0.1), pinhole()
    T_world_rv = motion.at(int(motion.t_us[1]))
    t_us = int(motion.t_us[2]) + 7
    T_world_cam = motion.at(t_us)
    bearing = camera.bearing_table()[20, 30]
    p_world = se3.transform(T_world_cam, 2.5 * np.array([*bearing, 1.0]))
    p_rv = se3.transform(se3.inverse(T_world_rv), p_world)
    events = Events(np.array([30], np.uint16), np.array([20], np.uint16), np.array([t_us]),
                    np.zeros(1, np.uint8))  # fmt: skip
    rays = event_rays(events, camera, np.eye(4), motion, T_world_rv, camera)
    rho = 1 / p_rv[2]
    uv = [rays.a_u[0] + rho * rays.b_u[0], rays.a_v[0] + rho * rays.b_v[0]]
    np.testing.assert_allclose(uv, camera.project(p_rv), atol=1e-4)


def test_packets_share_the_pose_of_event_512_and_the_tail_is_dropped():
    motion = random_motion(4, turn=0.1)
    rng = np.random.default_rng(1)
    events = events_on(rng, pinhole(), *motion.span_us, 3 * 1024)
    T_world_rv = motion.at(int(motion.t_us[1]))
    rays = event_rays(events, pinhole(), np.eye(4), motion, T_world_rv, pinhole(), packets=True)
    pose_us = np.repeat(events.t_us[[512, 1024 + 512]], 1024)
    twin = naive_sweep.rays(
        events.slice(0, 2048), pinhole(), np.eye(4), motion, T_world_rv, pinhole(), pose_us
    )
    assert rays.counts.dropped == 1024
    expected = np.array([row[1:] for row in twin if row[0] == "votes"])
    np.testing.assert_allclose(rays.b_u, expected[:, 1], rtol=1e-5, atol=1e-4)


def test_no_events_give_no_rays():
    motion = random_motion(0)
    for packets in (False, True):
        rays = event_rays(Events.empty(), CAMERA, np.eye(4), motion, np.eye(4), pinhole(),
                          packets=packets)  # fmt: skip
        assert len(rays) == rays.counts.events == len(rays.c_z_max) == 0


@pytest.mark.parametrize(("x", "poses", "words"), [(99, 5, "outside"), (9, 1, "one pose")])
def test_one_pose_and_events_outside_the_sensor_are_refused(x, poses, words):
    events = Events(np.array([x], np.uint16), np.array([0], np.uint16), np.array([5]),
                    np.zeros(1, np.uint8))  # fmt: skip
    motion = random_motion(0, poses=poses)
    refused(words, event_rays, events, CAMERA, np.eye(4), motion, np.eye(4), pinhole())
