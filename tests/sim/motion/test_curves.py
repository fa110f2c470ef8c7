"""Head motion: laws of the curves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.geometry import se3
from eventsweep.sim.motion.curves import HeadSway, Wave, look_at, sampled
from refusals import refused

COORDINATE = st.floats(-5, 5)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)


def sway(seed: int = 0) -> HeadSway:
    pose = look_at((0, 0, 1), (2, 0.3, 0.8))
    return HeadSway.seeded(pose, (0.1, 0.06, 0.04), (3, 5, 2), (1.4, 0.5), seed, (0.05, 0, 0))


@given(POINT, POINT)
def test_look_at_puts_the_target_on_the_axis_and_up_upwards(eye, target):
    direction = np.subtract(target, eye)
    if np.linalg.norm(np.cross(direction, (0, 0, 1))) < 1e-3:
        return
    T_world_body = look_at(eye, target)
    assert se3.is_rigid(T_world_body, 1e-9)
    seen = se3.transform(se3.inverse(T_world_body), target)
    np.testing.assert_allclose(seen, [0, 0, np.linalg.norm(direction)], atol=1e-9)
    up_in_body = T_world_body[:3, :3].T @ (0, 0, 1)
    assert abs(up_in_body[0]) < 1e-9
    assert up_in_body[1] < 0


@pytest.mark.parametrize("target", [(1, 2, 3), (1, 2, 9)])
def test_look_at_refuses_what_has_no_direction(target):
    refused("cannot look", look_at, (1, 2, 3), target)


@given(st.integers(0, 2**31), st.floats(0, 3))
def test_sway_stays_within_its_amplitudes(seed, t_s):
    motion = sway(seed)
    T_rest_body = se3.inverse(motion.T_world_rest) @ motion.T_world_body(t_s)
    assert se3.is_rigid(T_rest_body, 1e-9)
    offset_m = T_rest_body[:3, 3] - np.array(motion.drift_m_s) * t_s
    assert (np.abs(offset_m) <= 1.5 * np.array([0.1, 0.06, 0.04]) + 1e-9).all()
    angle = np.arccos(np.clip((np.trace(T_rest_body[:3, :3]) - 1) / 2, -1, 1))
    assert angle <= 1.5 * np.radians(np.linalg.norm([3, 5, 2])) + 1e-6


def test_sway_is_smooth():
    """Differences of order n shrink as step^n: three derivatives exist and are bounded."""
    for order in (1, 2, 3):
        sizes = []
        for step_s in (4e-3, 2e-3):
            times = 0.7 + step_s * np.arange(order + 40)
            poses = np.stack([sway().T_world_body(t) for t in times])[:, :3]
            sizes.append(np.abs(np.diff(poses, order, axis=0)).max())
        assert sizes[0] / sizes[1] == pytest.approx(2**order, rel=0.1)


def test_seed_draws_the_phases():
    assert np.array_equal(sway(3).T_world_body(0.2), sway(3).T_world_body(0.2))
    assert not np.allclose(sway(3).T_world_body(0.2), sway(4).T_world_body(0.2))


def test_wave_follows_its_formula():
    wave = Wave(2.0, (1, 0, 0), (0, 90, 0), (0, 0, 0, 0, np.pi / 2, 0))
    np.testing.assert_allclose(wave.at(0.5), [1, 0, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(wave.at(0.0), [0, 0, 0, 0, np.pi / 2, 0], atol=1e-12)


@given(st.floats(0.001, 0.4), st.floats(10, 2000))
def test_sampled_covers_the_whole_duration_densely(duration_s, rate_hz):
    trajectory = sampled(sway(), duration_s, rate_hz)
    assert trajectory.span_us == (0, round(duration_s * 1e6))
    assert np.diff(trajectory.t_us).max() <= np.ceil(1e6 / rate_hz)
    middle = len(trajectory) // 2
    t_us = int(trajectory.t_us[middle])
    np.testing.assert_allclose(
        trajectory.at(t_us), sway().T_world_body(t_us * 1e-6), rtol=0, atol=1e-12
    )


def test_interpolating_stored_poses_is_exact_to_a_micrometre():
    motion = sway()
    trajectory = sampled(motion, 0.5, 1000)
    t_us = np.arange(137, 500_000, 9_973)
    exact = np.stack([motion.T_world_body(t * 1e-6) for t in t_us])
    np.testing.assert_allclose(trajectory.at(t_us), exact, rtol=0, atol=1e-5)
    np.testing.assert_allclose(trajectory.at(t_us)[:, :3, 3], exact[:, :3, 3], rtol=0, atol=2e-6)
