"""Render times: no pixel of any camera moves further than it may."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mujoco_scenes as made
import naive_sensor
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.motion.curves import HeadSway, Wave, look_at
from eventsweep.sim.rendering.adaptive_sampling import (
    adaptive_frames,
    largest_displacement_px,
    longest_step,
    truth_times_us,
)
from eventsweep.sim.rendering.base import Frame
from eventsweep.sim.rendering.renderer import StereoRenderer
from refusals import refused


class Walls:
    """A source of frames without graphics: each camera faces a plane of its own depth at z = 0."""

    def __init__(self, rig, depths_m):
        self.rig, self.depths_m, self.count = rig, depths_m, 0

    def at(self, t_s):
        pass

    def frame(self, camera, T_world_body):
        self.count += 1
        seen = self.rig.cameras[camera]
        depth_m = np.full((seen.height_px, seen.width_px), self.depths_m[camera], np.float32)
        return Frame(np.full_like(depth_m, 0.5), depth_m)


def sideways(speed_m_s: float) -> HeadSway:
    return HeadSway(np.eye(4), (), (speed_m_s, 0.0, 0.0))


def moved_both_ways(rig, a, b):
    """Largest exact displacement of any pixel of any camera, forwards and backwards."""
    both = [
        naive_sensor.displacements_px(
            rig, [f.nearest_depth_m for f in x.frames], x.T_world_body, y.T_world_body
        )
        for x, y in ((a, b), (b, a))
    ]
    return max(moved.max() for direction in both for moved in direction)


def test_no_pixel_of_a_rendered_sequence_moves_too_far(tmp_path):
    scene, rig = made.noise_scene(tmp_path), made.small_rig()
    config = SimConfig(max_displacement_px=0.7)
    with StereoRenderer(scene.spec(), rig, 2, scene.depth_range_m) as renderer:
        taken = list(adaptive_frames(renderer, scene.motion(0.05, 1), [0, 25_000, 50_000], config))
    moved_px = [moved_both_ways(rig, a, b) for a, b in pairwise(taken)]
    assert len(taken) > 10
    assert max(moved_px) <= 0.7 + 1e-6
    # And not needlessly many: most steps use most of what is allowed.
    assert np.median(moved_px) > 0.8 * 0.7


def test_the_camera_that_moves_most_decides():
    """Only camera 1 stands near its wall: camera 0 alone would allow ten times the interval."""
    rig, config = made.tiny_rig(), SimConfig(max_displacement_px=0.5)
    for depths_m in [(5.0, 0.5), (0.5, 5.0)]:
        times_us = [
            e.t_us
            for e in adaptive_frames(Walls(rig, depths_m), sideways(1.0), [0, 90_000], config)
        ]
        allowed_us = 0.5 * 0.5 / 40 * 1e6
        assert 0.8 * allowed_us < np.median(np.diff(times_us)) <= allowed_us


def test_every_stop_is_exposed_and_intervals_are_bounded():
    stops_us = [0, 3_000, 3_001, 20_000, 50_001]
    config = SimConfig(max_frame_interval_us=4_000)
    source = Walls(made.tiny_rig(), (100.0, 100.0))
    times_us = [e.t_us for e in adaptive_frames(source, sideways(0.01), stops_us, config)]
    assert set(stops_us) <= set(times_us)
    assert times_us[0] == 0
    assert times_us[-1] == 50_001
    steps_us = np.diff(times_us)
    assert steps_us.min() > 0
    assert steps_us.max() <= 4_000
    assert source.count == 2 * len(times_us)


def test_surfaces_that_come_into_view_are_checked_backwards():
    """The nearest surface jumps to a tenth of the distance at 10 ms: only the new frame knows."""

    class Appearing(Walls):
        def at(self, t_s):
            pass

        def frame(self, camera, T_world_body):
            near = T_world_body[0, 3] >= 0.01
            self.depths_m = (0.5, 0.5) if near else (5.0, 5.0)
            return super().frame(camera, T_world_body)

    config = SimConfig(max_displacement_px=0.5)
    taken = list(
        adaptive_frames(Appearing(made.tiny_rig(), ()), sideways(1.0), [0, 30_000], config)
    )
    for a, b in pairwise(taken):
        assert moved_both_ways(made.tiny_rig(), a, b) <= 0.5 + 1e-6


def test_too_fast_a_motion_is_refused():
    config = SimConfig(sampling="linear", min_frame_interval_us=1_000)
    source = Walls(made.tiny_rig(), (0.5, 0.5))
    refused(
        r"at t = 0 µs, the limit is 0.5",
        list,
        adaptive_frames(source, sideways(20.0), [0, 50_000], config),
    )


def test_rotation_alone_counts_where_there_is_no_surface():
    turn = HeadSway(np.eye(4), (Wave(1.0, amplitude_deg=(0, 20, 0)),))
    source = Walls(made.tiny_rig(), (np.inf, np.inf))
    taken = list(adaptive_frames(source, turn, [0, 100_000], SimConfig(sampling="linear")))
    steps = [moved_both_ways(source.rig, a, b) for a, b in pairwise(taken)]
    assert 0.4 < max(steps) <= 0.5 + 1e-6


@given(
    st.floats(1e-6, 1e-1), st.floats(0.5, 3.0), st.integers(1, 20_000), st.integers(1, 50),
    st.integers(60, 10_000),
)  # fmt: skip
def test_longest_step_is_within_the_limit_and_nearly_the_longest(
    rate, power, guess_us, shortest_us, longest_us
):
    def moved_px(step_us):
        return (rate * step_us) ** power

    step_us, found_px = longest_step(moved_px, 0.5, guess_us, shortest_us, longest_us)
    assert shortest_us <= step_us <= longest_us
    assert found_px == moved_px(step_us)
    if found_px > 0.5:
        assert step_us == shortest_us
    else:
        could_go_on = step_us < longest_us and moved_px(step_us + 1) <= 0.5
        assert not could_go_on or found_px >= 0.8 * 0.5


@given(st.integers(0, 2**31))
def test_displacement_equals_its_twin(seed):
    rng = np.random.default_rng(seed)
    rig = made.tiny_rig()
    depths_m = [rng.uniform(0.4, 9, (36, 48)).astype(np.float32) for _ in range(2)]
    depths_m[0][3, 5:9] = np.inf
    pose_a = look_at(rng.normal(size=3), rng.normal(9, 1, size=3))
    motion = HeadSway.seeded(pose_a, (0.02,) * 3, (3, 3, 3), (1.0,), seed)
    pose_b = motion.T_world_body(0.1)
    expected = max(m.max() for m in naive_sensor.displacements_px(rig, depths_m, pose_a, pose_b))
    assert largest_displacement_px(rig, depths_m, pose_a, pose_b) == pytest.approx(
        expected, rel=1e-5
    )


def test_depth_of_another_camera_is_refused():
    depths_m = [np.ones((36, 48), np.float32), np.ones((48, 36), np.float32)]
    with pytest.raises(InputError, match=r"\(48, 36\) for a camera of 48 x 36 px"):
        largest_displacement_px(made.tiny_rig(), depths_m, np.eye(4), np.eye(4))


def test_a_point_passed_by_the_camera_moves_infinitely_far():
    rig = Rig("one", (Camera(8, 6, 10, 10, 3.5, 2.5),), (np.eye(4),))
    forward = np.eye(4)
    forward[2, 3] = 1.0
    depth_m = [np.full((6, 8), 0.9, np.float32)]
    assert largest_displacement_px(rig, depth_m, np.eye(4), forward) == np.inf


@given(st.integers(2, 10**7), st.integers(1, 10**6))
def test_truth_times_hold_the_start_the_middle_and_the_end(duration_us, interval_us):
    if duration_us // interval_us > 10_000:
        return
    times_us = truth_times_us(duration_us, interval_us)
    assert times_us == sorted(set(times_us))
    assert {0, duration_us // 2, duration_us} <= set(times_us)
    assert np.diff(times_us).max() <= interval_us
