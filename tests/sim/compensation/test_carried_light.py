"""Light between two fine frames, against a continuous world whose pictures are known by formula."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.compensation.interval import Passage, interval_between, lens_of
from eventsweep.sim.compensation.path_kernels import carried, distorted, light_at
from eventsweep.sim.compensation.range_kernels import cell_depths, cell_range, spread_most
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.box_kernels import box_mean, nearest_of_pixels, pixel_means
from eventsweep.sim.rendering.moving_bodies import BodyPixels
from eventsweep.sim.sensor.esim import EventSimulator
from eventsweep.sim.sensor.sensor import Sensor
from painted_planes import Plane, fine_frame, pixel_light, pose, sampled_frame
from refusals import refused

WAVES = Plane(2.0)
STRAIGHT = Camera(48, 36, 60.0, 62.0, 23.1, 17.4)
CAMERAS = {
    "pinhole": STRAIGHT,
    "radtan": Camera(48, 36, 60.0, 62.0, 23.1, 17.4, "radtan", (-0.2, 0.05, 1e-3, -2e-3, 0.01)),
    "kb4": Camera(48, 36, 60.0, 62.0, 23.1, 17.4, "kb4", (-0.03, 0.01, -0.004, 0.001)),
}
SPAN_US = 1_000, 21_000
BORDER, GRID, REACH = 10, 4, 8.0
# By half-time the head has come less than half of the way: motion is not steady.
MOTION = (
    pose(),
    pose((0.028, -0.012, 0.02), (0.5, 0.8, 1.0)),
    pose((0.07, -0.03, 0.05), (1.2, 2.0, 2.5)),
)


def passage(camera, plane=WAVES, poses=MOTION, bodies=None, moved=None):
    frames = [
        fine_frame(plane, camera, T, 1e-6 * t, border_px=BORDER, grid=GRID, reach_px=REACH)
        for T, t in zip((poses[0], poses[2]), SPAN_US, strict=True)
    ]
    shape = camera.height_px + 2 * BORDER, camera.width_px + 2 * BORDER
    return Passage(camera, *frames, interval_between(SPAN_US, poses, shape, bodies, moved, BORDER))


def parabola(poses, s):
    """The rigid motion through three poses whose rotation vector and position are parabolas."""
    first = [se3.inverse(poses[0]) @ T for T in poses]
    vectors = np.array([[*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec()] for T in first])
    b = 2 * (vectors[2] - 2 * vectors[1])
    a = vectors[2] - b
    now = s * (a + b * s)
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = now[:3], Rotation.from_rotvec(now[3:]).as_matrix()
    return poses[0] @ T


@pytest.mark.parametrize("model", CAMERAS)
@pytest.mark.parametrize("share", [0.2, 0.5, 0.85])
def test_light_between_frames_is_that_of_the_world(model, share):
    """A blend of the frames as they are is wrong by ten times as much."""
    way = passage(CAMERAS[model])
    times_us = way.times_us(0.05)
    t_us = times_us[round(share * len(times_us))]
    (found,) = way.pictures([t_us])
    s = (t_us - SPAN_US[0]) / (SPAN_US[1] - SPAN_US[0])
    truth = pixel_light(WAVES, CAMERAS[model], parabola(MOTION, s), 0.0)
    blend = (1 - s) * way.before.pixels + s * way.after.pixels
    assert np.abs(found - truth).max() < 0.004
    assert np.abs(blend - truth).max() > 0.04


def test_frames_themselves_are_the_ends():
    way = passage(STRAIGHT)
    times_us = way.times_us(0.5)
    assert times_us[-1] == SPAN_US[1]
    np.testing.assert_array_equal(list(way.pictures(times_us))[-1], way.after.pixels)
    assert times_us == sorted(set(times_us))
    assert len(times_us) > 8


def test_a_body_is_carried_along_its_own_motion():
    drift = (0.0, 3.0)
    plane, still = Plane(1.5, drift), (pose(),) * 3
    rows, columns = np.mgrid[-BORDER : 36 + BORDER, -BORDER : 48 + BORDER]
    pixels = np.stack([columns.ravel(), rows.ravel()], -1)
    body = BodyPixels(pixels, np.zeros((len(pixels), 3)), np.full(len(pixels), 3, np.int32))

    def moved(now_us, later_us):
        T = np.tile(np.eye(4), (4, 1, 1))
        T[3, :2, 3] = 1e-6 * (later_us - now_us) * np.array(drift)
        return T

    way = passage(STRAIGHT, plane, still, (body, body), moved)
    t_us = way.times_us(0.3)[3]
    (found,) = way.pictures([t_us])
    truth = pixel_light(plane, STRAIGHT, pose(), 1e-6 * t_us)
    assert np.abs(found - truth).max() < 0.004
    stuck = passage(STRAIGHT, plane, still)
    assert stuck.times_us(0.3) == [SPAN_US[1]]


@pytest.mark.parametrize("model", CAMERAS)
def test_events_are_those_of_the_world(model):
    """Against pictures of the world so dense that light between them is linear."""
    camera, config = (
        CAMERAS[model],
        SimConfig(contrast_threshold_pos=0.1, contrast_threshold_neg=0.12),
    )
    way = passage(camera)
    carried_along = EventSimulator(48, 36, config)
    carried_along.start(way.before.pixels, SPAN_US[0])
    found = carried_along.between(way)
    world = EventSimulator(48, 36, config)
    world.start(way.before.pixels, SPAN_US[0])
    parts = []
    for t_us in np.linspace(*SPAN_US, 201).astype(int)[1:]:
        s = (t_us - SPAN_US[0]) / (SPAN_US[1] - SPAN_US[0])
        parts.append(world.step(pixel_light(WAVES, camera, parabola(MOTION, s), 0.0), int(t_us)))
    expected = np.concatenate([part.t_us for part in parts])
    place = np.concatenate([(48 * part.y.astype(int) + part.x) * 2 + part.p for part in parts])
    ours = (48 * found.y.astype(int) + found.x) * 2 + found.p
    assert len(found) > 1500
    assert abs(len(found) - len(expected)) < 0.01 * len(expected)
    error_us = [
        np.abs(expected[place == q] - t_us).min(initial=20_000)
        for q, t_us in zip(ours, found.t_us, strict=True)
    ]
    assert np.median(error_us) < 20
    assert np.mean(np.array(error_us) < 500) > 0.98


@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.5), st.floats(0.02, 0.5), st.integers(0, 3000))
def test_events_integrate_to_the_change_of_light(seed, c_pos, c_neg, refractory_us):
    """Whatever the light: at the second frame every pixel is within one threshold of it."""
    rng = np.random.default_rng(seed)
    cells = 12 + 2 * BORDER, 16 + 2 * BORDER
    shape = GRID * cells[0], GRID * cells[1]
    camera = Camera(16, 12, 20.0, 20.0, 7.5, 5.5)
    # Whole pixels at one depth, and such with an edge in them.
    rho = np.repeat(np.repeat(rng.choice([1.0, 0.5, 0.0], cells), GRID, 0), GRID, 1)
    rho = np.where(rng.random(shape) < 0.01, 0.8, rho)
    frames = [
        sampled_frame(rng.random(shape, np.float32), rho, BORDER, GRID, REACH) for _ in range(2)
    ]
    way = Passage(camera, *frames, interval_between(SPAN_US, MOTION, cells))
    assert way.layered.layers.number.size > 0
    config = SimConfig(
        contrast_threshold_pos=c_pos,
        contrast_threshold_neg=c_neg,
        refractory_period_us=refractory_us,
    )
    pixels = EventSimulator(16, 12, config)
    pixels.start(frames[0].pixels, SPAN_US[0])
    events = pixels.between(way)
    assert (np.diff(events.t_us) >= 0).all()
    assert len(events) == 0 or SPAN_US[0] < events.t_us[0] <= events.t_us[-1] <= SPAN_US[1]
    log = np.log(frames[1].pixels.astype(float) + config.log_eps).ravel()
    left = log - pixels.state()["reference"]
    assert (left < c_pos + 1e-6).all()
    assert (left > -c_neg - 1e-6).all()
    for k in np.unique(16 * events.y.astype(int) + events.x)[:20]:
        own = events.t_us[16 * events.y.astype(int) + events.x == k]
        assert (np.diff(own) >= refractory_us).all()


def test_imperfect_pixels_see_the_dense_pictures():
    """An imperfect sensor with nothing wrong gives the events of the ideal one, nearly."""
    config, way = (
        SimConfig(contrast_threshold_pos=0.1, contrast_threshold_neg=0.1),
        passage(STRAIGHT),
    )
    found = []
    for full in (False, True):
        sensor = Sensor(0, 48, 36, config, 0, always_full=full)
        sensor.start(way.before.pixels, SPAN_US[0])
        found.append(sensor.between(way))
        assert sum(sensor.counts.values()) == len(found[-1])
    assert abs(len(found[0]) - len(found[1])) < 0.02 * len(found[0])


def test_a_passage_must_begin_where_the_last_one_ended():
    way, pixels = passage(STRAIGHT), EventSimulator(48, 36)
    pixels.start(way.before.pixels, 0)
    refused("begins there", pixels.between, way)


@pytest.mark.parametrize("model", CAMERAS)
@given(st.floats(-0.4, 0.4), st.floats(-0.3, 0.3), st.floats(0.0, 2.0))
def test_compiled_projection_is_the_cameras(model, a, b, rho):
    camera = CAMERAS[model]
    terms = lens_of(camera).terms
    x, y = distorted(a, b, terms)
    uv = camera.project(np.array([a, b, 1.0]))
    np.testing.assert_allclose([60 * x + 23.1, 62 * y + 17.4], uv, atol=1e-9)
    point = np.array([a, b, 1.0]) / rho if rho > 1e-3 else 1e6 * np.array([a, b, 1.0])
    moved = se3.transform(se3.inverse(MOTION[2]), point)
    got = carried(se3.inverse(MOTION[2]), a, b, rho if rho > 1e-3 else 1e-6, terms)
    np.testing.assert_allclose(got, camera.project(moved), atol=1e-6)


def test_light_between_nodes_is_a_catmull_rom_spline_kept_between_them():
    rows, columns = np.mgrid[:9, :11].astype(np.float32)
    flat = 0.2 + 0.03 * rows + 0.05 * columns
    for u, v in np.random.default_rng(0).uniform([1, 1], [8.9, 6.9], (50, 2)):
        assert light_at(flat, u, v) == pytest.approx(0.2 + 0.03 * v + 0.05 * u, abs=1e-5)
    edge = (columns > 5).astype(np.float32)
    along = np.array([light_at(edge, u, 4.0) for u in np.linspace(2, 9, 200)])
    assert along.min() == 0
    assert along.max() == 1
    assert (np.diff(along) >= -1e-6).all()
    # A wave of 16 nodes; a straight line between its nodes is wrong by 0.02.
    wave = np.sin(2 * np.pi * columns / 16).astype(np.float32)
    error = [light_at(wave, u, 4.0) - np.sin(2 * np.pi * u / 16) for u in np.linspace(2, 8, 99)]
    assert np.abs(error).max() < 0.006


@given(st.integers(0, 2**32 - 1), st.integers(0, 9), st.integers(0, 9))
def test_ranges_are_those_of_all_nodes_within_reach(seed, before, behind):
    rng = np.random.default_rng(seed)
    light = rng.random((3 * 13 + 1, 3 * 17 + 1), np.float32)
    low, high, slope = (np.empty((14, 18), np.float32) for _ in range(3))
    cell_range(light, 3, low, high, slope)
    for i, j in ((0, 0), (5, 9), (12, 16)):
        cell = light[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        assert (low[i, j], high[i, j]) == (cell.min(), cell.max())
    i, j = 7, 8
    part = light[3 * i : 3 * i + 4, 3 * j : 3 * j + 4].astype(float)
    across, along = np.diff(part, axis=1)[:3], np.diff(part, axis=0)[:, :3]
    assert slope[i, j] == pytest.approx(3 * np.hypot(across, along).max(), rel=1e-5)
    # SciPy puts the middle of a window of n values at n // 2.
    size = before + behind + 1
    expected = ndimage.maximum_filter(high, size, mode="nearest", origin=before - size // 2)
    spread_most(high, before, behind)
    np.testing.assert_array_equal(high, expected)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_boxes_are_means_of_samples(seed, n):
    rng = np.random.default_rng(seed)
    samples = rng.random((n * 6, n * 7), np.float32)
    light = np.empty((n * 5 + 1, n * 6 + 1), np.float32)
    box_mean(samples, n, light)
    blocks = samples.reshape(6, n, 7, n)
    np.testing.assert_allclose(light[::n, ::n], blocks.mean((1, 3)), rtol=1e-5)
    i, j = rng.integers(0, light.shape)
    assert light[i, j] == pytest.approx(samples[i : i + n, j : j + n].mean(), rel=1e-5)
    depth_m, means = np.empty((4, 5), np.float32), np.empty((4, 5), np.float32)
    nearest_of_pixels(samples, n, 1, depth_m)
    np.testing.assert_array_equal(depth_m, 1 / blocks.max((1, 3))[1:-1, 1:-1])
    pixel_means(samples, n, 1, means)
    np.testing.assert_allclose(means, blocks.mean((1, 3))[1:-1, 1:-1], rtol=1e-5)
    nearest, farthest = np.empty((6, 7), np.float32), np.empty((6, 7), np.float32)
    cell_depths(samples, n, nearest, farthest)
    np.testing.assert_array_equal(nearest, blocks.max((1, 3)))
    np.testing.assert_array_equal(farthest, blocks.min((1, 3)))


def test_places_follow_the_surface():
    way = passage(STRAIGHT)
    x, y = np.array([20, 30], np.uint16), np.array([10, 20], np.uint16)
    ends = way.places(x, y, np.array([SPAN_US[0], SPAN_US[1]]))
    np.testing.assert_array_equal(ends[0, :2], [20, 10])
    np.testing.assert_array_equal(ends[1, 2:], [30, 20])
    assert np.abs(ends[0, 2:] - [20, 10]).max() >= 2
