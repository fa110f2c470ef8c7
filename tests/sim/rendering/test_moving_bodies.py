"""Bodies that move by themselves: their flow, and how far their pixels go between frames."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mujoco_scenes as made
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry import se3
from eventsweep.sim.config import SimConfig
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.rendering.moving_bodies import MovingBodies
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.simulate import simulate

HALF_M, START = 0.15, np.array([1.2, 0.15, 1.0])
SPEED_M_S, RATE_RAD_S = np.array([0.4, -1.1, 0.3]), np.array([0.8, 2.0, -5.0])
GEOMS = (
    '<geom name="wall" type="box" size=".1 3 3" pos="2.5 0 1" material="noise"/>'
    f'<body name="die" pos="{START[0]} {START[1]} {START[2]}"{{mocap}}>{{joint}}'
    f'<geom name="die" type="box" size="{HALF_M} {HALF_M} {HALF_M}" material="noise"/></body>'
)


def T_world_die(t_s):
    """The law that the die follows: constant velocity, constant rate of turn."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(RATE_RAD_S * t_s).as_matrix()
    pose[:3, 3] = START + SPEED_M_S * t_s
    return pose


@dataclass(frozen=True)
class Thrown:
    """Puts the die where the law says, by its joint or as a mocap body."""

    max_interval_us: int = 10_000

    def __call__(self, model, data, t_s):
        pose = T_world_die(t_s)
        quat = np.roll(Rotation.from_matrix(pose[:3, :3]).as_quat(), 1)
        if model.nmocap:
            data.mocap_pos[0], data.mocap_quat[0] = pose[:3, 3], quat
        else:
            data.qpos[:] = np.concatenate([pose[:3, 3], quat])


def scene_in(folder, *, mocap=False):
    scene = made.noise_scene(folder)
    joint = "" if mocap else '<freejoint name="die"/>'
    geoms = GEOMS.format(mocap=' mocap="true"' if mocap else "", joint=joint)
    scene.mjcf.write_text(f"<mujoco>{made.DARK}{made.NOISE}<worldbody>{geoms}</worldbody></mujoco>")
    return replace(scene, animate=Thrown())


def on_the_die(rig, k, T_world_body, t_s):
    """Ray casting by hand: the z-depth of each pixel's ray on the die, m; inf where it misses."""
    camera = rig.cameras[k]
    bearing = camera.bearing_table()
    T_die_cam = se3.inverse(T_world_die(t_s)) @ T_world_body @ rig.T_body_cam[k]
    rays = np.dstack([bearing, np.ones(bearing.shape[:2])]) @ T_die_cam[:3, :3].T
    with np.errstate(divide="ignore"):
        faces = np.stack([(side * HALF_M - T_die_cam[:3, 3]) / rays for side in (-1, 1)])
    enter, leave = faces.min(0).max(-1), faces.max(0).min(-1)
    return np.where(enter < leave, enter, np.inf)


@pytest.mark.parametrize("mocap", [False, True])
def test_flow_follows_points_of_a_moving_body(tmp_path, mocap):
    scene, rig = scene_in(tmp_path, mocap=mocap), made.small_rig()
    config = SimConfig(
        duration_s=0.02, truth_interval_s=0.01, truth=("flow", "segmentation"), supersample=1
    )
    sequence = Sequence.open(simulate(scene, rig, config, 0, tmp_path / "s"))
    motion = scene.motion(0.02, 0)
    for k, camera in enumerate(rig.cameras):
        for now_s, later_s in ((0.0, 0.01), (0.01, 0.02)):
            now_us = round(now_s * 1e6)
            depth_m = on_the_die(rig, k, motion.T_world_body(now_s), now_s)
            shown = sequence.truth_dynamic(k, now_us) & np.isfinite(depth_m)
            rows, columns = np.nonzero(shown)
            assert len(rows) > 200
            bearing = camera.bearing_table()[shown]
            points = np.column_stack([bearing, np.ones(len(rows))]) * depth_m[shown][:, None]
            T_world_cam = motion.T_world_body(now_s) @ rig.T_body_cam[k]
            on_die = se3.transform(se3.inverse(T_world_die(now_s)) @ T_world_cam, points)
            T_world_later = motion.T_world_body(later_s) @ rig.T_body_cam[k]
            there = se3.transform(se3.inverse(T_world_later) @ T_world_die(later_s), on_die)
            expected = camera.project(there) - np.stack([columns, rows], -1)
            flow = sequence.truth_flow_px(k, now_us)
            # A GPU rounds the body's corners to 1/256 px at both times.
            assert np.abs(flow[shown] - expected).max() < 4e-3
            assert np.linalg.norm(expected, axis=1).max() > 0.5
            assert np.isfinite(flow).all()


def test_flow_leads_to_the_body_later(tmp_path):
    """Followed by its flow, a pixel of the die finds the die there, at its point's depth."""
    scene, rig = scene_in(tmp_path), made.small_rig()
    config = SimConfig(
        duration_s=0.02, truth_interval_s=0.01, truth=("flow", "segmentation", "boundary")
    )
    sequence = Sequence.open(simulate(scene, rig, config, 0, tmp_path / "s"))
    shown = sequence.truth_dynamic(0, 0) & ~sequence.truth_boundary(0, 0)
    rows, columns = np.nonzero(shown)
    u, v = (
        np.rint(np.stack([columns, rows], -1) + sequence.truth_flow_px(0, 0)[shown]).astype(int).T
    )
    later_m = on_the_die(rig, 0, scene.motion(0.02, 0).T_world_body(0.01), 0.01)
    found = sequence.truth_dynamic(0, 10_000)[v, u]
    assert found.mean() > 0.97
    there_m = sequence.truth_depth_m(0, 10_000)[v, u][found]
    assert np.quantile(np.abs(there_m / later_m[v, u][found] - 1), 0.99) < 1e-3


def exact_way_px(rig, motion, a, b):
    """The furthest that any pixel on the die goes from exposure a to b, by ray casting."""
    ways = []
    for k, camera in enumerate(rig.cameras):
        a_s, b_s = a.t_us * 1e-6, b.t_us * 1e-6
        depth_m = on_the_die(rig, k, a.T_world_body, a_s)
        shown = np.isfinite(depth_m)
        rays = np.dstack([camera.bearing_table(), np.ones(depth_m.shape)])
        points = rays[shown] * depth_m[shown][:, None]
        T_a = se3.inverse(T_world_die(a_s)) @ motion.T_world_body(a_s) @ rig.T_body_cam[k]
        T_b = se3.inverse(T_world_die(b_s)) @ motion.T_world_body(b_s) @ rig.T_body_cam[k]
        rows, columns = np.nonzero(shown)
        there = camera.project(se3.transform(se3.inverse(T_b) @ T_a, points))
        ways.append(np.linalg.norm(there - np.stack([columns, rows], -1), axis=1).max())
    return max(ways)


def test_no_pixel_of_a_moving_body_goes_too_far_before_a_head_at_rest(tmp_path):
    """The head's motion alone would allow the longest interval."""
    scene, rig = scene_in(tmp_path), made.small_rig()
    still = HeadSway(look_at((0, 0, 1), (2, 0, 1)), ())
    config = SimConfig(sampling="linear")
    with StereoRenderer(
        scene.spec(), rig, 2, scene.depth_range_m, animate=scene.animate
    ) as renderer:
        bodies = MovingBodies(renderer)
        blind = list(adaptive_frames(renderer, still, [0, 20_000], config))
        taken = list(adaptive_frames(renderer, still, [0, 20_000], config, bodies=bodies))
    ways_px = [
        exact_way_px(rig, still, *pair) for a, b in pairwise(taken) for pair in ((a, b), (b, a))
    ]
    assert len(blind) == 3
    assert max(ways_px) < 0.5 + 1e-3
    assert max(ways_px) > 0.8 * 0.5


def test_poses_depend_on_the_time_alone(tmp_path):
    scene = scene_in(tmp_path)
    with StereoRenderer(
        scene.spec(), made.tiny_rig(), 1, scene.depth_range_m, animate=scene.animate
    ) as renderer:
        bodies = MovingBodies(renderer)
        assert bodies.moves.tolist() == [False, True, False]
        for t_us in (7_000, 0, 500_000, 7_000):
            np.testing.assert_allclose(bodies.poses(t_us)[1], T_world_die(t_us * 1e-6), atol=1e-12)
        moved = bodies.moved(0, 7_000)
    np.testing.assert_allclose(moved[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(moved[1] @ T_world_die(0.0), T_world_die(0.007), atol=1e-12)
