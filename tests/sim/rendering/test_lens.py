"""Distorting lenses against the camera model: known edges, rays, planes, displacement."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mujoco_scenes as made
import naive_lens
import naive_pixels
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.rendering import lens, pixel_kernels
from eventsweep.sim.rendering.adaptive_sampling import largest_displacement_px
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import RIGS

RANGE_M = (0.5, 8.0)
POSE = look_at((0, 0, 1), (2, 0.1, 0.95))
KB4 = RIGS["mvsec"].cameras[0]
BARREL = Camera(160, 120, 110.0, 112.0, 71.4, 66.2, "radtan", (-0.30, 0.09, 0.002, -0.003))
PINCUSHION = Camera(
    144, 112, 109.6, 104.2, 79.25, 48.9, "radtan", (0.12, 0.05, -0.001, 0.002, 0.01)
)
FISHEYE = Camera(160, 120, 95.0, 96.0, 81.0, 58.0, "kb4", (-0.02, 0.01, -0.02, 0.004))
LENSES = {"barrel": BARREL, "pincushion": PINCUSHION, "fisheye": FISHEYE, "mvsec": KB4}
by_lens = pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)


def rig_of(*cameras: Camera) -> Rig:
    places = []
    for k in range(len(cameras)):
        T_body_cam = np.eye(4)
        T_body_cam[:3, 3] = (0.1 * k, 0.004 * k, -0.003 * k)
        places.append(T_body_cam)
    return Rig("lenses", cameras, tuple(places))


@by_lens
@pytest.mark.parametrize("supersample", [1, 2])
def test_every_corner_of_every_pixel_has_a_source_and_samples_enough(camera, supersample):
    mapped = lens.lens_map(camera, supersample)
    size = np.array([mapped.source.width_px, mapped.source.height_px])
    for corner in [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]:
        at = mapped.position + mapped.step @ np.array(corner, np.float32)
        assert at.min() >= 1
        assert (at < size - 2).all()
    # A sensor pixel spans at least so many samples in its narrowest direction.
    assert np.linalg.svd(mapped.step, compute_uv=False).min() > 0.999 * supersample


@by_lens
def test_positions_project_back_to_where_they_belong(camera):
    """Centres to 1e-4 px; corners of pixels, found by the derivative, to 0.02 px."""
    mapped = lens.lens_map(camera, 2)
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    for offset, within_px in [((0.0, 0.0), 1e-4), ((0.25, 0.25), 5e-3), ((-0.5, 0.5), 2e-2)]:
        at = (mapped.position + mapped.step @ np.array(offset, np.float32)).astype(float)
        at[..., 1] = mapped.source.height_px - 1 - at[..., 1]
        rays = np.dstack([mapped.source.unproject(at), np.ones_like(u)])
        missed = camera.project(rays) - np.stack([u + offset[0], v + offset[1]], axis=-1)
        assert np.abs(missed).max() < within_px


def _card(camera: Camera, u: float, v: float, half_px: float, depth_m: float) -> np.ndarray:
    """Four corners in the camera frame of a card whose image is roughly a turned square."""
    turned = np.array([[-0.9, -1], [1, -0.8], [0.9, 1.1], [-1.1, 0.9]]) * half_px
    return np.column_stack([camera.unproject(turned + np.array([u, v])), np.ones(4)]) * depth_m


def _outline(corners: np.ndarray) -> np.ndarray:
    """Points along the straight edges of a polygon, which a lens bends."""
    share = np.linspace(0, 1, 200, endpoint=False)[:, None]
    edges = [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    return np.concatenate(edges)


@by_lens
def test_known_edges_lie_where_the_lens_puts_them_to_a_tenth_of_a_pixel(camera):
    """Light, first and mixed moments of a bright card in the middle and in every corner."""
    half_px, margin = 14.0, 18
    right, low = camera.width_px - 1 - margin, camera.height_px - 1 - margin
    level = look_at((0, 0, 1), (2, 0, 1))
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    middle = (camera.width_px / 2, camera.height_px / 2)
    for at in [(margin, margin), (right, margin), (margin, low), (right, low), middle]:
        card_cam = _card(camera, *at, half_px, 1.5)
        corners = se3.transform(level, card_cam)
        # Thick along the rays, so that only its face is seen.
        card = made.card_spec(corners, 0.01 * (corners - level[:3, 3]))
        with StereoRenderer(card, rig_of(camera), 2, RANGE_M) as renderer:
            image = renderer.frame(0, level).intensity.astype(float)
        area, mean_u, mean_v = made.polygon_moments(camera.project(_outline(card_cam)))
        light = image.sum()
        assert image.max() == pytest.approx(1, abs=1e-5)
        assert np.sqrt(light / area) == pytest.approx(1, abs=0.1 / half_px)
        centroid = (image * u).sum() / light, (image * v).sum() / light
        np.testing.assert_allclose(centroid, (mean_u, mean_v), atol=0.1)


@by_lens
def test_depth_equals_the_ray_cast_at_pixel_centres(camera):
    mj = import_mujoco()
    rng = np.random.default_rng(0)
    with StereoRenderer(made.spec(made.BOXES), rig_of(camera), 1, RANGE_M) as renderer:
        data = mj.MjData(renderer.model)
        mj.mj_forward(renderer.model, data)
        depth_m, geom = renderer.depth(0, POSE), renderer.segmentation(0, POSE)
        hits = 0
        for _ in range(600):
            u, v = rng.integers(camera.width_px), rng.integers(camera.height_px)
            ray = POSE[:3, :3] @ [*camera.unproject((u, v)), 1]
            met, length = np.zeros(1, np.int32), np.linalg.norm(ray)
            distance_m = mj.mj_ray(
                renderer.model, data, POSE[:3, 3], ray / length, None, 1, -1, met
            )
            expected_m = distance_m / length if distance_m >= 0 else np.inf
            # Beside an edge, ray and nearest sample may meet different surfaces, or faces.
            same = expected_m == depth_m[v, u] or abs(depth_m[v, u] / expected_m - 1) < 2e-5
            hits += bool(met[0] == geom[v, u] and same)
    assert hits > 588


def test_depth_never_lies_between_two_surfaces():
    """A panel before a wall, both facing the camera: every pixel has one depth or the other."""
    panel = (
        '<geom type="box" size=".1 .3 .2" pos="1.6 .05 1"/>'
        '<geom type="box" size=".1 9 9" pos="4.1 0 1"/>'
    )
    with StereoRenderer(made.spec(panel), rig_of(BARREL), 2, RANGE_M) as renderer:
        depth_m = renderer.depth(0, look_at((0, 0, 1), (2, 0, 1)))
    near = np.isclose(depth_m, 1.5, rtol=1e-4)
    assert (near | np.isclose(depth_m, 4.0, rtol=1e-4)).all()
    assert 0.05 < near.mean() < 0.5


@by_lens
def test_nearest_depth_bounds_depth(camera):
    with StereoRenderer(made.spec(made.BOXES), rig_of(camera), 2, RANGE_M) as renderer:
        nearest_m, depth_m = renderer.frame(0, POSE).nearest_depth_m, renderer.depth(0, POSE)
    assert (nearest_m <= depth_m * 1.001).mean() > 0.999
    assert np.median(depth_m[np.isfinite(depth_m)] / nearest_m[np.isfinite(depth_m)]) < 1.05


def test_a_pinhole_view_is_what_a_pinhole_camera_sees():
    straight, large = BARREL.undistorted(), Camera(700, 500, 400, 400, 349.5, 249.5)
    with StereoRenderer(made.spec(made.BOXES), rig_of(BARREL), 1, RANGE_M) as renderer:
        seen = renderer.depth(0, POSE, view=straight)
        tiled = renderer.depth(0, POSE, view=large)
    with StereoRenderer(made.spec(made.BOXES), rig_of(straight), 1, RANGE_M) as renderer:
        np.testing.assert_allclose(seen, renderer.depth(0, POSE), rtol=1e-6)
    with StereoRenderer(made.spec(made.BOXES), rig_of(large), 1, RANGE_M) as renderer:
        np.testing.assert_allclose(tiled, renderer.depth(0, POSE), rtol=1e-5)


@pytest.mark.parametrize("floats", [False, True])
def test_a_lens_without_distortion_is_a_pinhole(floats):
    flat = Camera(160, 120, 110.0, 112.0, 71.4, 66.2, "radtan", (0.0, 0.0, 0.0, 0.0))
    rig = rig_of(flat, flat.undistorted())
    with StereoRenderer(made.spec(made.BOXES), rig, 2, RANGE_M, floats=floats) as renderer:
        there = POSE @ se3.inverse(rig.T_body_cam[1])
        bent, straight = renderer.frame(0, POSE).intensity, renderer.frame(1, there).intensity
        depths_m = renderer.depth(0, POSE), renderer.depth(1, there)
    assert np.abs(bent - straight).mean() < 0.004
    assert np.isclose(*depths_m, rtol=1e-5).mean() > 0.995


@by_lens
def test_displacement_equals_exact_projection(camera):
    rng = np.random.default_rng(2)
    rig = rig_of(camera, FISHEYE)
    depths_m = [
        rng.uniform(0.6, 6, (c.height_px, c.width_px)).astype(np.float32) for c in rig.cameras
    ]
    a = look_at((0, 0, 1), (2, 0, 1))
    for moved_m, turned_rad in [((0.002, 0.001, -0.001), 1e-3), ((0, -0.001, 0.0015), -2e-3)]:
        b = a.copy()
        b[:3, :3] = a[:3, :3] @ Rotation.from_rotvec([0.3 * turned_rad, turned_rad, 0]).as_matrix()
        b[:3, 3] += moved_m
        found_px = largest_displacement_px(rig, depths_m, a, b)
        exact_px = max(d.max() for d in naive_pixels.displacements_px(rig, depths_m, a, b))
        assert found_px == pytest.approx(exact_px, rel=1e-2)


def test_kernels_equal_their_twins():
    rng = np.random.default_rng(3)
    small = Camera(12, 9, 9.0, 9.5, 5.2, 4.4, "kb4", (-0.03, 0.01, 0.0, 0.0))
    mapped = lens.lens_map(small, 3)
    shape = mapped.source.height_px, mapped.source.width_px
    luma = rng.random(shape, np.float32)
    window_depth = rng.random(shape, np.float32) * (rng.random(shape) > 0.2).astype(np.float32)
    intensity, nearest, centre = np.empty((3, 9, 12), np.float32)
    pixel_kernels.resample(luma, window_depth, mapped.position, mapped.step, 3, intensity, nearest)
    expected = naive_lens.resample(luma, window_depth, mapped.position, mapped.step, 3)
    np.testing.assert_allclose(intensity, expected[0], atol=2e-5)
    assert np.array_equal(nearest, expected[1])
    pixel_kernels.centre_depth(window_depth, mapped.position, centre)
    expected_depth = naive_lens.centre_depth(window_depth, mapped.position)
    np.testing.assert_allclose(centre, expected_depth, atol=1e-6)


@pytest.mark.parametrize(
    ("camera", "needed"),
    [
        (Camera(200, 150, 60, 60, 99, 74, "kb4", (0.0, 0.0, 0.0, 0.0)), "no ray for"),
        (Camera(182, 40, 60, 60, 90.5, 20, "kb4", (0.0, 0.0, 0.0, 0.0)), "degrees off its axis"),
        (Camera(200, 150, 60, 60, 99, 74, "radtan", (-0.4, 0.0, 0.0, 0.0)), "folds over"),
    ],
)
def test_refuses_lenses_that_no_pinhole_picture_can_hold(camera, needed):
    with pytest.raises(InputError, match=needed) as caught:
        StereoRenderer(made.spec(made.BOXES), rig_of(camera), 2, RANGE_M)
    assert "camera cam0 of rig lenses" in str(caught.value)


def test_refuses_a_view_with_distortion():
    with (
        StereoRenderer(made.spec(made.BOXES), rig_of(BARREL), 1, RANGE_M) as renderer,
        pytest.raises(InputError, match="undistorted"),
    ):
        renderer.depth(0, POSE, view=BARREL)
