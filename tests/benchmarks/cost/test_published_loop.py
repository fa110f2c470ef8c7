"""The C++ side casts the votes that it is said to cast."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import published_loop
from cost_limits import SENSORS
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.dsi.rays import PACKET, event_rays
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.reference_view import mcemvs_planes
from published_loop import Contest, PublishedLoop, contest, has_compiler, table
from whole_volume import dsi

needs_compiler = pytest.mark.skipif(not has_compiler(), reason="g++ is not installed")
SIZE = 64, 48
CAMERA = Camera(*SIZE, 55.0, 57.0, 30.5, 25.0)
SPAN_US = 100_000


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    return PublishedLoop(tmp_path_factory.mktemp("loop"))


def scene():
    """Events all over the sensor, and a camera that turns and moves along all axes."""
    rng = np.random.default_rng(3)
    count = 9 * PACKET + 100
    x, y = (rng.integers(0, n, count).astype(np.uint16) for n in SIZE)
    t_us = np.sort(rng.integers(0, SPAN_US, count))
    t_pose_us = np.arange(0, SPAN_US + 1, SPAN_US // 10)
    position_m = np.outer(t_pose_us / SPAN_US - 0.5, [0.2, -0.05, 0.1])
    turns = Rotation.from_rotvec(np.outer(t_pose_us / SPAN_US - 0.5, [0.05, 0.1, -0.2]))
    T_body_cam = np.eye(4)
    T_body_cam[:3, 3] = 0.1, 0.0, 0.02
    events = Events(x, y, t_us, np.ones(count, np.uint8))
    return events, Trajectory(t_pose_us, position_m, turns.as_quat()), T_body_cam


def volumes(loop, rho):
    """The published loop's volume, how many votes it counted, and ours."""
    events, motion, T_body_cam = scene()
    T_world_rv = motion.at(SPAN_US // 2)
    depths_m = (1 / rho).astype(np.float32)
    placed = loop.located(
        events, CAMERA, T_body_cam, motion, T_world_rv, CAMERA, float(depths_m[0])
    )
    theirs = np.zeros((len(rho), *SIZE[::-1]), np.float32)
    counted = loop.cast(placed, depths_m, CAMERA, theirs)
    rays = event_rays(events, CAMERA, T_body_cam, motion, T_world_rv, CAMERA, packets=True)
    return theirs, counted, *dsi(rays, rho, *SIZE)


@needs_compiler
def test_its_volume_is_that_of_the_compatibility_setting(loop):
    """But for votes that rounding puts on the other side of the image's edge."""
    theirs, counted, ours, counts = volumes(loop, mcemvs_planes(0.5, 5, 20))
    assert counted > 100_000
    assert abs(counted - counts.counted) <= 1e-4 * counted
    inside = np.s_[:, 1:-1, 1:-1]
    np.testing.assert_allclose(theirs[inside], ours[inside], rtol=0, atol=2e-3)


@needs_compiler
def test_threads_change_no_bit(loop):
    found = []
    for threads in (2, 1):
        loop.use_threads(threads)
        found.append(volumes(loop, mcemvs_planes(0.5, 5, 7))[0])
    np.testing.assert_array_equal(*found)


@needs_compiler
def test_both_sides_take_turns_on_every_sensor(loop):
    found = [contest(loop, sensor, 3000, planes=4, rounds=2) for sensor in SENSORS]
    assert all(ns > 0 for one in found for ns in (*one.theirs_ns, *one.ours_ns))
    assert all(len(one.theirs_ns) == len(one.ours_ns) == 2 for one in found)
    shown = table(found, 3000)
    assert all(f"| {sensor}, 2 × 0.003 M events |" in shown for sensor in SENSORS)


def test_ratios_are_of_the_best_and_of_the_median_round():
    one = Contest("346x260", (8.0, 6.0, 9.0), (2.0, 4.0, 3.0))
    assert (one.ratio, one.typical_ratio) == (3.0, 3.0)
    assert "| 346x260, 2 × 2 M events | 6.00 (8.00) | 2.00 (3.00) | 3.0 × | 3.0 × |" in table([one])


def test_a_missing_compiler_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(published_loop, "COMPILER", "no-such-compiler")
    assert not has_compiler()
    with pytest.raises(InputError, match="no-such-compiler: not found; install it"):
        PublishedLoop(tmp_path)


@needs_compiler
def test_a_compiler_that_fails_is_quoted_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(published_loop, "OPTIONS", ("-no-such-option",))
    with pytest.raises(InputError, match=r"cannot build published_loop\.cpp: ") as caught:
        PublishedLoop(tmp_path)
    assert "\n" not in str(caught.value)
