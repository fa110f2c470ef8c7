"""The renderer against geometry: projection, depth, supersampling."""

import numpy as np
import pytest

import mujoco_scenes as made
import naive_sensor
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim import graphics
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.rendering import pixel_kernels
from eventsweep.sim.rendering.drawn_geoms import DrawnGeoms
from eventsweep.sim.rendering.model_renderer import metric_depth
from eventsweep.sim.rendering.renderer import StereoRenderer
from refusals import refused

RANGE_M = (0.5, 8.0)
RIG = made.small_rig()
POSE = look_at((0, 0, 1), (2, 0.1, 0.95))


def test_depth_equals_the_ray_cast_at_random_pixels():
    """Every surface is flat, so the drawn polygons are the geometry that mj_ray meets.

    A GPU puts corners on a grid of 1/256 px: what it draws is that of a place half as far away.
    """
    rng = np.random.default_rng(0)
    with StereoRenderer(made.spec(made.BOXES), RIG, 1, RANGE_M) as renderer:
        moves_px = (-1 / 512, 1 / 512) if graphics.current_driver().hardware else (0,)
        for k, camera in enumerate(RIG.cameras):
            depth_m = renderer.depth(k, POSE)
            geom = renderer.segmentation(k, POSE)
            cast, hits = caster(renderer.model, k), 0
            for _ in range(800):
                u, v = rng.integers(camera.width_px), rng.integers(camera.height_px)
                around = [cast((u + i, v + j)) for i in moves_px for j in moves_px]
                # On an edge, the rasteriser and the ray may meet different boxes.
                if {met for _, met in around} == {geom[v, u]}:
                    hits += 1
                    expected_m = [distance_m for distance_m, _ in around]
                    assert depth_m[v, u] >= min(expected_m) * (1 - 4e-6)
                    assert depth_m[v, u] <= max(expected_m) * (1 + 4e-6)
            assert hits > (750 if len(moves_px) > 1 else 795)


def caster(model, k):
    """From a pixel of a camera to the z-depth, m, that MuJoCo's own ray meets, and to its geom."""
    mj = import_mujoco()
    data = mj.MjData(model)
    mj.mj_forward(model, data)
    T_world_cam = POSE @ RIG.T_body_cam[k]

    def cast(pixel):
        ray = T_world_cam[:3, :3] @ [*RIG.cameras[k].unproject(pixel), 1]
        met = np.zeros(1, np.int32)
        length = np.linalg.norm(ray)
        distance_m = mj.mj_ray(model, data, T_world_cam[:3, 3], ray / length, None, 1, -1, met)
        return (distance_m / length if distance_m >= 0 else np.inf), met[0]

    return cast


def test_box_three_metres_ahead_begins_at_its_face():
    box = '<geom type="box" size=".2 .2 .2" pos="3 0 1"/>'
    with StereoRenderer(made.spec(box), RIG, 2, RANGE_M) as renderer:
        level = look_at((0, 0, 1), (3, 0, 1))
        centre = tuple(round(c) for c in (RIG.cameras[0].cy_px, RIG.cameras[0].cx_px))
        assert renderer.depth(0, level)[centre] == pytest.approx(2.8, rel=1e-5)
        assert renderer.frame(0, level).nearest_depth_m[centre] == pytest.approx(2.8, rel=1e-5)


def test_nothing_is_infinitely_far():
    with StereoRenderer(made.spec('<geom size=".1" pos="2 0 1"/>'), RIG, 2, RANGE_M) as renderer:
        depth_m = renderer.depth(0, POSE)
        nothing = renderer.segmentation(0, POSE) == -1
        assert nothing.any()
        assert not nothing.all()
        assert np.array_equal(np.isinf(depth_m), nothing)


def test_known_points_project_onto_their_geoms():
    """Small balls: the centroid of each in the segmentation is where the camera model puts it."""
    rng = np.random.default_rng(5)
    grid_px = np.stack(np.meshgrid(np.arange(14, 150, 26), np.arange(14, 110, 22)), -1).reshape(
        -1, 2
    )
    grid_px = grid_px + rng.uniform(-2, 2, grid_px.shape)
    z_m = rng.uniform(1, 3, len(grid_px))
    bearing = RIG.cameras[0].unproject(grid_px)
    centres = se3.transform(POSE, np.column_stack([bearing * z_m[:, None], z_m]))
    balls = "".join(
        f'<geom type="sphere" size="{0.035 * z}" pos="{x} {y} {h}"/>'
        for z, (x, y, h) in zip(z_m, centres, strict=True)
    )
    errors_px = []
    with StereoRenderer(made.spec(balls), RIG, 1, RANGE_M) as renderer:
        for k, camera in enumerate(RIG.cameras):
            geom = renderer.segmentation(k, POSE)
            seen = se3.transform(se3.inverse(POSE @ RIG.T_body_cam[k]), centres)
            inside = np.array([camera.width_px, camera.height_px]) - 7
            for ball, uv_px in enumerate(camera.project(seen)):
                if (uv_px > 6).all() and (uv_px < inside).all():
                    rows, columns = np.nonzero(geom == ball)
                    errors_px.append(np.array([columns.mean(), rows.mean()]) - uv_px)
    assert len(errors_px) > 40
    assert np.abs(errors_px).max() < 0.25
    assert np.abs(np.mean(errors_px, axis=0)).max() < 0.05


@pytest.mark.parametrize("supersample", [1, 2, 3, 4])
def test_edges_lie_where_the_camera_model_puts_them(supersample):
    """A bright card, slightly turned: the light in each row and column measures its four edges."""
    card = np.array([[2, y, z] for y, z in [(-0.52, 0.7), (0.55, 0.72), (0.5, 1.3), (-0.5, 1.27)]])
    level = look_at((0, 0, 1), (2, 0, 1))
    with StereoRenderer(made.card_spec(card), RIG, supersample, RANGE_M) as renderer:
        for k, camera in enumerate(RIG.cameras):
            image = renderer.frame(k, level).intensity
            corners = camera.project(se3.transform(se3.inverse(level @ RIG.T_body_cam[k]), card))
            expected = made.polygon_moments(corners)
            v, u = np.mgrid[: camera.height_px, : camera.width_px]
            area = image.sum()
            assert image.max() == pytest.approx(1, abs=1e-6)
            assert area == pytest.approx(expected[0], rel=2e-3)
            np.testing.assert_allclose(
                [(image * u).sum() / area, (image * v).sum() / area],
                expected[1:],
                atol=0.1 / supersample,
            )


def test_pictures_do_not_depend_on_what_was_drawn_before():
    other = look_at((0.5, 0.2, 1.4), (2, -0.3, 0.8))
    spec = made.spec(made.BOXES)
    spec.visual.headlight.diffuse = spec.visual.headlight.specular = [0.5, 0.5, 0.5]
    with StereoRenderer(spec, RIG, 2, RANGE_M) as a, StereoRenderer(spec, RIG, 2, RANGE_M) as b:
        first = a.frame(0, POSE)
        b.segmentation(1, other)
        b.frame(1, other)
        a.depth(1, other)
        for again in (a.frame(0, POSE), b.frame(0, POSE)):
            assert np.array_equal(first.intensity, again.intensity)
            assert np.array_equal(first.nearest_depth_m, again.nearest_depth_m)


def test_what_a_view_does_not_see_is_not_drawn(monkeypatch):
    """Pictures of all geoms are the same to the bit; many are left out, and come back."""
    geoms = "".join(
        f'<geom type="{kind}" size=".3 .2 .1" pos="{2 + n % 5} {n % 7 - 3} {n % 3}" '
        f'euler="{10 * n} {20 * n} 0" rgba=".{n % 9 + 1} .5 .6 1"/>'
        for n in range(70)
        for kind in (("box", "sphere", "capsule", "ellipsoid", "cylinder")[n % 5],)
    ) + '<geom type="plane" size="0 0 1" pos="0 0 -.5"/>'  # fmt: skip
    views = [look_at((0, 0, 1), (np.cos(a), np.sin(a), 0.9)) for a in np.arange(0, 6, 0.5)]
    with StereoRenderer(made.spec(geoms), RIG, 2, RANGE_M, border_px=3) as renderer:

        def pictures():
            for number, pose in enumerate(views):
                if number == 6:
                    renderer.near_first(pose)
                light = renderer.frame(1, pose).samples
                yield *light, renderer.depth(1, pose), renderer.segmentation(1, pose)

        found, left_out = list(pictures()), []
        inner = DrawnGeoms._show

        def show_all(drawn, shown):
            left_out.append(int((~shown).sum()))
            inner(drawn, np.ones_like(shown))

        monkeypatch.setattr(DrawnGeoms, "_show", show_all)
        for some, everything in zip(found, pictures(), strict=True):
            for a, b in zip(some, everything, strict=True):
                assert np.array_equal(a, b)
    assert min(left_out) < 60 < max(left_out)


def test_glass_has_no_depth():
    wall = '<geom type="box" size=".1 9 9" pos="3.1 0 1"/>'
    glass = '<geom type="box" size=".01 9 9" pos="2 0 1" rgba="1 1 1 .3"/>'
    level = look_at((0, 0, 1), (3, 0, 1))
    with StereoRenderer(made.spec(wall + glass), RIG, 1, RANGE_M) as renderer:
        assert renderer.depth(0, level) == pytest.approx(3, rel=1e-5)


def test_the_headlight_is_carried_by_the_body():
    """A wall seen head-on is equally bright wherever the head is, and darker from the side."""
    spec = made.spec('<geom type="box" size=".1 9 9" pos="3 0 0" rgba="1 1 1 1"/>')
    spec.visual.headlight.diffuse = [0.6, 0.6, 0.6]
    with StereoRenderer(spec, RIG, 1, RANGE_M) as renderer:
        ahead = renderer.frame(0, look_at((0, 0, 1), (2, 0, 1))).intensity
        moved = renderer.frame(0, look_at((1, 2, 0.5), (2, 2, 0.5))).intensity
        slanted = renderer.frame(0, look_at((0, 0, 1), (2, 2, 1))).intensity
        other = renderer.frame(1, look_at((0, 0, 1), (2, 0, 1))).intensity
    assert ahead.max() > 0.4
    assert np.ptp(ahead) < 0.01
    for same in (moved, other):
        assert same.mean() == pytest.approx(ahead.mean(), abs=0.01)
    assert slanted.mean() < 0.8 * ahead.mean()


def test_cameras_of_a_rig_see_from_their_own_places():
    with StereoRenderer(made.spec(made.BOXES), RIG, 1, RANGE_M) as renderer:
        alone = Rig("right", RIG.cameras[1:], (np.eye(4),))
        with StereoRenderer(made.spec(made.BOXES), alone, 1, RANGE_M) as right:
            moved = right.frame(0, POSE @ RIG.T_body_cam[1])
        assert np.array_equal(renderer.frame(1, POSE).intensity, moved.intensity)
        assert not np.array_equal(renderer.frame(0, POSE).intensity, moved.intensity)


@pytest.mark.parametrize("supersample", [1, 2, 3])
def test_average_equals_its_twin(supersample):
    rng = np.random.default_rng(1)
    shape = (5 * supersample, 7 * supersample)
    rgb = rng.integers(0, 256, (*shape, 3), np.uint8)
    window_depth = rng.random(shape, np.float32)
    intensity, nearest = np.empty((5, 7), np.float32), np.empty((5, 7), np.float32)
    pixel_kernels.average(rgb, window_depth, supersample, intensity, nearest)
    expected = naive_sensor.average(rgb, window_depth, supersample)
    np.testing.assert_allclose(intensity, expected[0], rtol=0, atol=1e-6)
    assert np.array_equal(nearest, expected[1])


def test_metric_depth_inverts_the_projection():
    z_m = np.geomspace(0.3, 30, 50)
    near_m, far_m = 0.25, 40.0
    window = near_m * (far_m - z_m) / (z_m * (far_m - near_m))
    found = metric_depth(np.append(window, 0).astype(np.float32), near_m, far_m)
    np.testing.assert_allclose(found[:-1], z_m, rtol=1e-5)
    assert np.isinf(found[-1])


def test_says_which_graphics_library_is_missing_and_that_a_scene_does_not_compile(monkeypatch):
    flat = made.spec('<geom type="box" size="0 0 0"/>')
    refused("does not compile", StereoRenderer, flat, RIG)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(graphics.ctypes.util, "find_library", lambda name: None)
    refused("libegl1 libgl1 libosmesa6", StereoRenderer, made.spec(made.BOXES), RIG)


def test_prefers_egl_takes_osmesa_and_refuses_the_rest(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(graphics.ctypes.util, "find_library", lambda name: f"lib{name}.so")
    assert graphics.backend() == "egl"
    monkeypatch.setattr(
        graphics.ctypes.util, "find_library", lambda name: "lib.so" if name == "OSMesa" else None
    )
    assert graphics.backend() == "osmesa"
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    refused("off screen", graphics.backend)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    refused("MUJOCO_GL=egl", graphics.backend)
