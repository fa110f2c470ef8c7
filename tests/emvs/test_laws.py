"""Laws of the mapper: what must change nothing but rounding."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.rays import PACKET
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.reference_view import inverse_depth_planes
from made_events import random_events
from point_world import fronto_parallel, pinhole, sideways
from volumes import dsi, event_rays

CONFIG = MapperConfig(planes=25, min_depth_m=0.5, max_depth_m=4.0)
CAMERA = pinhole()
RHO = inverse_depth_planes(0.5, 4, 5)


def turning(seed, poses=6):
    """A motion that turns and moves, and nowhere looks away from where it began."""
    rng = np.random.default_rng(seed)
    t_us = np.linspace(0, 500_000, poses).astype(np.int64)
    quats = Rotation.from_rotvec(rng.normal(0, 0.1, (poses, 3))).as_quat()
    return Trajectory(t_us, rng.normal(0, 0.1, (poses, 3)), quats)


def events_of(seed, n, motion):
    rng = np.random.default_rng(seed)
    return random_events(rng, n, CAMERA.width_px, CAMERA.height_px, *motion.span_us)


def moved(trajectory, T_new_old):
    T = T_new_old @ se3.from_quat_xyzw(trajectory.positions_m, trajectory.quats_xyzw)
    return Trajectory(trajectory.t_us, *se3.to_quat_xyzw(T))


def rigid(seed):
    rng = np.random.default_rng(seed)
    return se3.from_rotation(Rotation.random(random_state=rng), rng.normal(0, 3, 3))


def columns(rays):
    return np.stack([rays.a_u, rays.b_u, rays.a_v, rays.b_v, rays.c_z], axis=1)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_turning_and_moving_the_world_leaves_every_ray(seed):
    motion, T_new_old = turning(seed), rigid(seed)
    events, T_world_rv = events_of(seed, 300, motion), motion.at(250_000)
    one = event_rays(events, CAMERA, np.eye(4), motion, T_world_rv, CAMERA)
    other = event_rays(
        events, CAMERA, np.eye(4), moved(motion, T_new_old), T_new_old @ T_world_rv, CAMERA
    )
    assert len(one) == 300
    np.testing.assert_allclose(columns(other), columns(one), rtol=1e-5, atol=1e-4)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.01, 100))
def test_scaling_the_world_scales_what_is_in_metres(seed, scale):
    motion = turning(seed)
    events, T_world_rv = events_of(seed, 300, motion), motion.at(250_000)
    large = Trajectory(motion.t_us, motion.positions_m * scale, motion.quats_xyzw)
    one = event_rays(events, CAMERA, np.eye(4), motion, T_world_rv, CAMERA)
    other = event_rays(events, CAMERA, np.eye(4), large, large.at(250_000), CAMERA)
    expected = columns(one) * [1, scale, 1, scale, scale]
    np.testing.assert_allclose(columns(other), expected, rtol=1e-5, atol=1e-4 * max(scale, 1))


def test_turning_the_world_leaves_the_depth():
    recording = fronto_parallel(1.23)
    turned = replace(recording, trajectory=moved(recording.trajectory, rigid(1)))
    one, other = map_window(recording, CONFIG), map_window(turned, CONFIG)
    for method, a in one.depth_maps.items():
        b = other.depth_maps[method]
        both = a.mask & b.mask
        assert both.sum() > 100
        assert (a.mask == b.mask).mean() > 0.999
        assert np.mean(np.abs(b.depth_m / a.depth_m - 1)[both] < 1e-3) > 0.99


@pytest.mark.parametrize("nearest", [False, True])
def test_the_order_of_events_inside_a_packet_is_rounding_only(nearest):
    """Events of a packet share a pose, so changing places among them changes no ray."""
    motion = turning(0)
    events = events_of(1, 3 * PACKET + 1, motion)
    rng = np.random.default_rng(2)
    order = np.concatenate(
        [k * PACKET + rng.permutation(PACKET) for k in range(3)] + [[3 * PACKET]]
    )
    shuffled = replace(events, x=events.x[order], y=events.y[order])
    rays = [
        event_rays(e, CAMERA, np.eye(4), motion, motion.at(250_000), CAMERA, packets=True)
        for e in (events, shuffled)
    ]
    np.testing.assert_array_equal(columns(rays[0])[order[:-1]], columns(rays[1]))
    (one, counts), (other, its_counts) = (
        dsi(r, RHO, CAMERA.width_px, CAMERA.height_px, nearest=nearest) for r in rays
    )
    assert counts == its_counts
    assert counts.counted > PACKET
    if nearest:  # whole numbers add up alike in any order
        np.testing.assert_array_equal(one, other)
    else:
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)


def test_no_turn_of_the_world_moves_what_the_planes_see():
    """At the rim of the image rounding decides whether a vote counts: two pixels are left out."""
    motion, T_new_old = sideways(), rigid(4)
    events, T_world_rv = events_of(5, 4000, motion), motion.at(250_000)
    volumes = [
        dsi(event_rays(events, CAMERA, np.eye(4), path, T, CAMERA), RHO, 96, 64)[0]
        for path, T in ((motion, T_world_rv), (moved(motion, T_new_old), T_new_old @ T_world_rv))
    ]
    assert volumes[0].sum() > 10_000
    inner = [volume[:, 2:-2, 2:-2] for volume in volumes]
    np.testing.assert_allclose(*inner, atol=2e-3)


def test_nearest_votes_find_the_plane_too():
    result = map_window(fronto_parallel(1.5), CONFIG.model_copy(update={"voting": "nearest"}))
    depth = result.depth_maps["Alg1/H"]
    np.testing.assert_array_equal(
        result.slices.values["EMVS/cam0"], np.rint(result.slices.values["EMVS/cam0"])
    )
    step = (1 / 0.5 - 1 / 4) / 24
    assert depth.points > 100
    assert abs(np.median(1 / depth.depth_m[depth.mask]) - 1 / 1.5) < step
