"""Distorting lenses against the camera model: known edges, rays, planes, displacement."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mujoco_scenes as made
import naive_lens
import naive_sensor
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.rendering import box_kernels, lens, pixel_kernels, sub_views
from eventsweep.sim.rendering.adaptive_sampling import largest_displacement_px
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rendering.sub_views import LensMap
from eventsweep.sim.rigs import RIGS
from panel_cases import Draw, gliding
from panel_scene import panel_rig, panel_scene
from ray_world import Panel, RayCamera, RayCaster, RayWorld
from refusals import refused

RANGE_M = (0.5, 8.0)
CORNERS = 1e-4  # of a depth: a GPU rounds corners to 1/256 px
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


WIDE = Camera(182, 40, 60, 60, 90.5, 20, "kb4", (0.0, 0.0, 0.0, 0.0))
"""Sees 86 degrees off its axis, where no single pinhole picture could be drawn."""


@pytest.fixture
def cells(monkeypatch):
    """Cuts lenses as a test wants, not as it costs least."""

    def cut(rows: int, columns: int, *, turned: bool) -> None:
        monkeypatch.setattr(sub_views, "cells_of", lambda *_: (rows, columns, turned))
        lens.lens_map.cache_clear()

    yield cut
    lens.lens_map.cache_clear()


def _seen_in(mapped: LensMap, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which sub-view has each place (H, W, 2) of the buffer, and its bearing there."""
    which, bearing = np.full(at.shape[:2], -1), np.full(at.shape, np.nan)
    for k, (view, corner, _) in enumerate(mapped.views):
        size = np.array([view.width_px, view.height_px])
        own = at - corner
        inside = ((own >= 1) & (own < size - 2)).all(axis=-1)
        assert (which[inside] == -1).all()
        own[..., 1] = view.height_px - 1 - own[..., 1]
        which[inside], bearing[inside] = k, view.unproject(own)[inside]
    return which, bearing


@by_lens
@pytest.mark.parametrize("grid", [None, (1, 1), (2, 3)])
def test_every_corner_of_every_pixel_lies_in_its_view_with_samples_enough(camera, grid, cells):
    """In the one that has its centre, with a sample around it; and S x S of them in its area."""
    if grid is not None:
        cells(*grid, turned=True)
    mapped = lens.lens_map(camera, 2)
    which, _ = _seen_in(mapped, mapped.position)
    assert set(which.ravel()) == set(range(len(mapped.views)))
    for corner in [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]:
        at = mapped.position + mapped.step @ np.array(corner, np.float32)
        np.testing.assert_array_equal(_seen_in(mapped, at)[0], which)
    assert np.abs(np.linalg.det(mapped.step)).min() > 0.999 * 2**2


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("camera", [*LENSES.values(), WIDE], ids=[*LENSES, "wide"])
def test_positions_project_back_to_where_they_belong(camera, turned, cells):
    """Centres to 1e-4 px, corners of pixels, found by the derivative, to 0.02 px; depths exactly.

    A turned view's z-depth is another one; `ratio` is that of the lens's own axes, over it.
    """
    cells(2, 4, turned=turned or camera is WIDE)
    mapped = lens.lens_map(camera, 2)
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    for offset, within_px in [((0.0, 0.0), 1e-4), ((0.25, 0.25), 5e-3), ((-0.5, 0.5), 2e-2)]:
        at = (mapped.position + mapped.step @ np.array(offset, np.float32)).astype(float)
        which, bearing = _seen_in(mapped, at)
        turns = np.array([view.R_cam_view for view in mapped.views])[which]
        rays = (turns @ np.dstack([bearing, np.ones_like(u)])[..., None])[..., 0]
        missed = camera.project(rays) - np.stack([u + offset[0], v + offset[1]], axis=-1)
        assert np.abs(missed).max() < within_px
        ratio = mapped.ratio[..., 0] + mapped.ratio[..., 1:] @ np.array(offset, np.float32)
        np.testing.assert_allclose(ratio, rays[..., 2], rtol=2e-6, atol=2e-6)


def test_the_number_of_views_goes_by_what_they_cost(cells):
    """One for what is nearly a pinhole or small, some for a large fisheye; never more expensive."""
    mild, strong = RIGS["dsec"].cameras[0], lens.widened_camera(KB4, 14)
    assert len(lens.lens_map(mild, 3).views) == 1
    chosen = lens.lens_map(strong, 6)
    assert 4 <= len(chosen.views) <= 12
    assert chosen.samples < 1.5 * 6**2 * strong.width_px * strong.height_px
    cells(1, 1, turned=False)
    assert lens.lens_map(strong, 6).samples > 3.5 * chosen.samples


def _room(camera: RayCamera) -> RayWorld:
    """Five textured walls around the camera, the side ones beside it."""
    draw = Draw("room", None)
    sides = [
        ((0, 0, 1.5), (2, 0, 0), (0, 2, 0)),
        ((-1.2, 0, 0.5), (0, 0, 1.5), (0, 2, 0)),
        ((1.4, 0, 0.5), (0, 0, 1.5), (0, 2, 0)),
        ((0, 1.1, 0.5), (2, 0, 0), (0, 0, 1.5)),
        ((0, -1.3, 0.5), (2, 0, 0), (0, 0, 1.5)),
    ]
    walls = tuple(Panel(*side, draw.noise(64, k)) for k, side in enumerate(sides))
    return RayWorld(walls, camera, gliding((0, 0, 0)))


ROUND = RayCamera(60, 44, 28.0, 29.1, 21.7, "kb4", (0.02, -0.005, 0.001, -0.0002))
BULGING = RayCamera(60, 44, 44.0, 30.2, 20.9, "radtan", (-0.28, 0.07, 0.0008, -0.0005))


@pytest.mark.parametrize(
    ("camera", "turned"), [(ROUND, True), (BULGING, False)], ids=["kb4", "radtan"]
)
def test_fine_frames_are_cast_by_rays_and_seams_are_as_good_as_the_rest(
    camera, turned, cells, tmp_path
):
    """Depth of every sample and light of every pixel, of the independent ray caster."""
    cells(3, 4, turned=turned)
    world, samples, border_px = _room(camera), 6, 4
    scene, rig = panel_scene(world, (0.2, 3.0), tmp_path), panel_rig(camera)
    with StereoRenderer(
        scene.spec(), rig, samples, scene.depth_range_m, floats=True, border_px=border_px
    ) as renderer:
        frame = renderer.frame(0, np.eye(4))
    lights = np.abs(frame.intensity - RayCaster(world, 8).picture(0.0))
    inner = slice(samples * border_px, -samples * border_px)
    rho = frame.samples.inverse_depth_per_m[inner, inner]
    v, u = (np.mgrid[: len(rho), : rho.shape[1]] + 0.5) / samples - 0.5
    rays = np.dstack([camera.rays(np.dstack([u, v])), np.ones_like(u)])
    depths = np.abs(rho / _inverse_depth(world, rays) - 1)
    # Across a pixel a table is straight: the direction, and so the depth, is off by 0.02 px.
    assert depths.max() < 3e-3
    assert lights.mean() < 0.004
    seams = np.zeros(lights.shape, bool)
    for cuts, length in ((seams, camera.height_px), (seams.T, camera.width_px)):
        wide = length + 2 * border_px
        number = 3 if length == camera.height_px else 4
        for cut in (np.arange(1, number) * wide) // number - border_px:
            cuts[cut - 1 : cut + 1] = True
    assert lights[seams].mean() < 1.25 * lights[~seams].mean() + 5e-4
    assert lights[seams].max() < 1.25 * lights[~seams].max()


def _inverse_depth(world: RayWorld, rays: np.ndarray) -> np.ndarray:
    """Of the walls around the camera, which are convex: the nearest plane ahead."""
    return np.max([rays @ panel[2] for panel in world.inverse_panels(0.0)], axis=0)


def test_a_border_goes_on_where_a_lens_has_no_rays(tmp_path):
    """There its samples are those of the nearest pixel with a ray, at no depth that is not seen."""
    camera = RayCamera(44, 32, 23.0, 21.4, 15.7, "kb4", (0.02, -0.005, 0.001, -0.0002))
    scene, samples, border_px = panel_scene(_room(camera), (0.2, 3.0), tmp_path), 3, 14
    with StereoRenderer(
        scene.spec(), panel_rig(camera), samples, scene.depth_range_m, border_px=border_px
    ) as renderer:
        light, rho = renderer.frame(0, np.eye(4)).samples
        depth_m = renderer.depth(0, np.eye(4), border=True)
    assert light.shape == (samples * (32 + 28), samples * (44 + 28))
    assert np.isfinite(rho).all()
    assert rho.min() > 0
    blind = np.isnan(lens.widened_camera(panel_rig(camera).cameras[0], border_px).bearing_table())
    assert 0.1 < blind.mean() < 0.4
    assert np.isfinite(depth_m).all()
    assert np.ptp(light[:samples, :samples]) < np.ptp(light)
    np.testing.assert_array_equal(rho[:samples, :samples], rho[:samples, samples : 2 * samples])


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
            same = expected_m == depth_m[v, u] or abs(depth_m[v, u] / expected_m - 1) < CORNERS
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
        np.testing.assert_allclose(tiled, renderer.depth(0, POSE), rtol=CORNERS)


@pytest.mark.parametrize("floats", [False, True])
def test_a_lens_without_distortion_is_a_pinhole(floats):
    flat = Camera(160, 120, 110.0, 112.0, 71.4, 66.2, "radtan", (0.0, 0.0, 0.0, 0.0))
    rig = rig_of(flat, flat.undistorted())
    with StereoRenderer(made.spec(made.BOXES), rig, 2, RANGE_M, floats=floats) as renderer:
        there = POSE @ se3.inverse(rig.T_body_cam[1])
        bent, straight = renderer.frame(0, POSE).intensity, renderer.frame(1, there).intensity
        depths_m = renderer.depth(0, POSE), renderer.depth(1, there)
    assert np.abs(bent - straight).mean() < 0.004
    # An edge lies wrong by up to half a sample, and one runs nearly along the last rows.
    assert np.isclose(*depths_m, rtol=CORNERS).mean() > 0.985


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
        exact_px = max(d.max() for d in naive_sensor.displacements_px(rig, depths_m, a, b))
        assert found_px == pytest.approx(exact_px, rel=1e-2)


def test_kernels_equal_their_twins():
    rng = np.random.default_rng(3)
    small = Camera(12, 9, 9.0, 9.5, 5.2, 4.4, "kb4", (-0.03, 0.01, 0.0, 0.0))
    mapped = lens.lens_map(small, 3)
    shape = mapped.shape
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


def test_depth_in_the_lens_s_axes_equals_its_twin():
    rng = np.random.default_rng(4)
    ratio = rng.uniform(0.4, 1.1, (5, 7, 3)).astype(np.float32)
    ratio[..., 1:] *= 0.1
    window_depth = rng.random((15, 21), np.float32) * (rng.random((15, 21)) > 0.2)
    found = window_depth.astype(np.float32)
    box_kernels.inverse_depth_in_lens(found, 3, ratio, 0.2, 9.0)
    expected = naive_lens.inverse_depth(window_depth, 3, ratio, 0.2, 9.0)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize(("camera", "needed"), [
    (Camera(200, 150, 60, 60, 99, 74, "kb4", (0.0, 0.0, 0.0, 0.0)), "no ray for"),
    (Camera(190, 40, 60, 60, 94.5, 20, "kb4", (0.0, 0.0, 0.0, 0.0)), "no ray for"),
    (Camera(200, 150, 60, 60, 99, 74, "radtan", (-0.4, 0.0, 0.0, 0.0)), "folds over"),
])  # fmt: skip
def test_refuses_lenses_that_give_a_pixel_no_ray(camera, needed):
    said = refused(needed, StereoRenderer, made.spec(made.BOXES), rig_of(camera), 2, RANGE_M)
    assert "camera cam0 of rig lenses" in said


def test_refuses_a_view_with_distortion():
    with (
        StereoRenderer(made.spec(made.BOXES), rig_of(BARREL), 1, RANGE_M) as renderer,
        pytest.raises(InputError, match="undistorted"),
    ):
        renderer.depth(0, POSE, view=BARREL)
