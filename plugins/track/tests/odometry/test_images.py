"""Images of half the resolution: no contrast is lost, a pixel lies where its four did."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import line_world
import point_world
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.track.odometry.images import Images, half_camera
from eventsweep.plugins.track.odometry.tracker import Tracker

CAMERA = Camera(7, 5, 6.0, 6.5, 3.1, 1.9, "radtan", (-0.2, 0.05, 0.001, -0.002))
RIG = point_world.stereo_rig(CAMERA, cameras=2)
SEEDS = st.integers(0, 2**32 - 1)


def drawn(seed, count=300):
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.integers(0, 10_000, count))
    x, y = rng.integers(0, 7, count), rng.integers(0, 5, count)
    return Events(x.astype(np.uint16), y.astype(np.uint16), t_us, rng.random(count) < 0.7)


def signed(events, columns, rows):
    """(rows, columns) sums of brighter less darker events."""
    sums = np.zeros((rows, columns), int)
    np.add.at(sums, (events.y, events.x), np.where(events.p, 1, -1))
    return sums


@given(SEEDS)
def test_a_larger_pixel_passes_as_much_contrast_as_its_four(seed):
    """All but less than one threshold of the larger pixel; an odd last row or column has none."""
    images, events = Images(RIG, half=True), drawn(seed)
    half, _ = images([events, Events.empty()])
    four = signed(events, 7, 5)[:4, :6].reshape(2, 2, 3, 2).sum((1, 3))
    assert np.abs(four - 4 * signed(half, 3, 2)).max() < 4
    assert set(half.t_us.tolist()) <= set(events.t_us.tolist())


@given(SEEDS, st.integers(0, 300))
def test_packets_of_any_size_give_the_same_events_also_from_a_state(seed, cut):
    events = drawn(seed)
    (whole, _), parts = Images(RIG, half=True)([events] * 2), Images(RIG, half=True)
    first = parts([events.take(slice(0, cut))] * 2)
    later = Images(RIG, half=True)
    later.restore(parts.state())
    both = [first[0], later([events.take(slice(cut, None))] * 2)[0]]
    for name in ("x", "y", "t_us", "p"):
        joined = np.concatenate([getattr(part, name) for part in both])
        np.testing.assert_array_equal(joined, getattr(whole, name))


@pytest.mark.parametrize("at", [(0, 0), (2, 1), (1.25, 0.5)])
def test_a_larger_pixel_looks_between_its_four(at):
    there = 2 * np.array(at) + 0.5
    np.testing.assert_allclose(
        half_camera(CAMERA).unproject(at), CAMERA.unproject(there), atol=1e-12
    )


def test_whole_images_stay_as_they_are():
    images, packets = Images(RIG, half=False), [drawn(0), drawn(1)]
    assert images(packets) is packets
    assert images.rig is RIG


def test_a_tracker_at_half_resolution_is_one_of_a_rig_of_half_the_resolution():
    """Fed with the events of that: the same poses, where the body is."""
    large = point_world.pinhole(width=320, height=240, f=260.0)
    way = point_world.swinging(turn_deg=(3, 4, 2), way_m=(0.08, 0.05, 0.04), duration_us=500_000)
    recording = line_world.recorded(way, camera=large)
    images = Images(recording.rig, half=True)
    half = line_world.CONFIG.model_copy(update={"half_resolution": True})
    found, expected = [], []
    tracker = Tracker(recording.rig, half, depth_range_m=(0.5, 4.0), on_pose=found.append)
    other = Tracker(
        images.rig, line_world.CONFIG, depth_range_m=(0.5, 4.0), on_pose=expected.append
    )
    for t_us in range(10_000, 500_001, 10_000):
        packets = [recording.events(k, t_us - 10_000, t_us) for k in range(2)]
        packets = [Events(e.x, e.y, e.t_us, np.ones(len(e), np.uint8)) for e in packets]
        tracker.push(packets, t_us)
        other.push(images(packets), t_us)
    assert len(found) == len(expected) > 10
    for one, same in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.T_world_body, same.T_world_body)
    assert line_world.worst_m(tracker.known(), recording.trajectory) < 0.02
