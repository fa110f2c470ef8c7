"""The ray caster, the simulator's independent truth, and the renderer show the same world."""

import numpy as np
import pytest

from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.renderer import StereoRenderer
from one_to_one import agreement
from panel_cases import DAVIS, Draw, gliding, panel_case, wall
from panel_scene import panel_rig, panel_scene, simulated_events
from ray_events import ray_events
from ray_world import RayCaster, RayWorld

DRAW = Draw("test", None)


@pytest.mark.parametrize("name", ["crossing body", "fisheye", "barrel lens", "bright window"])
def test_the_pictures_are_the_renderers(name, tmp_path):
    case = panel_case(name)
    scene = panel_scene(case.world, case.depth_range_m, tmp_path, hdr=case.hdr)
    caster, rig = RayCaster(case.world, 12), panel_rig(case.world.camera)
    with StereoRenderer(
        scene.spec(), rig, 8, scene.depth_range_m, floats=case.hdr, animate=scene.animate
    ) as renderer:
        for t_s in (0.0, case.duration_s):
            renderer.at(t_s)
            drawn = renderer.frame(0, case.world.T_world_cam(t_s)).intensity
            cast = caster.picture(t_s)
            assert cast.std() > 0.1 * cast.mean()
            # Both are means of samples: a pixel with edges differs by where these lie.
            assert np.median(np.abs(drawn - cast)) < 2e-3 * cast.max()
            assert np.percentile(np.abs(drawn - cast), 90) < 0.02 * cast.max()


def test_a_slide_before_a_textured_plane_gives_the_same_events(tmp_path):
    world = RayWorld((wall(2.0, 1.0, DRAW.leaves(512, 1, 900)),), DAVIS, gliding((0.8, 0.2, 0)))
    scene = panel_scene(world, (1.0, 4.0), tmp_path)
    config = SimConfig(duration_s=0.04)
    found = simulated_events(scene, panel_rig(DAVIS), config)
    same = agreement(found, ray_events(world, 0.04, log_eps=config.log_eps))
    assert same.true > 1000
    assert same.recall >= 0.95
    assert same.precision >= 0.95


@pytest.mark.parametrize(("samples", "texels"), [(3, 2.0), (3, 2.5), (3, 3.2), (3, 4.0), (6, 4.0)])
def test_fine_textures_keep_their_contrast(samples, texels, tmp_path):
    """So many texels lie beside one another in a sample of a fine frame: over a whole mip level.

    The ray caster takes many samples of the finest level. The slope of drawn light on its light is
    below 1 where textures are blurred, and the spread is too large where they are too sharp.
    """
    depth_m, grey = 2.0, DRAW.noise(1024, 3, slope=0.5)
    half_m = 512 * depth_m / DAVIS.focal_px / (texels * samples)
    panel = wall(depth_m, 4 * half_m, grey, repeats=4)
    world = RayWorld((panel,), DAVIS, gliding((0.0, 0.0, 0.0)))
    cast, scene = RayCaster(world, 24).picture(0.0), panel_scene(world, (1.0, 4.0), tmp_path)
    with StereoRenderer(
        scene.spec(), panel_rig(DAVIS), samples, scene.depth_range_m, border_px=3
    ) as renderer:
        drawn = renderer.frame(0, np.eye(4)).intensity
    (variance, both), (_, own) = np.cov(cast.ravel(), drawn.ravel())
    assert both / variance == pytest.approx(1, abs=0.02)
    assert np.sqrt(own / variance) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize(("ambient", "floats"), [(0.02, True), (1.0, False), (3.0, True)])
def test_a_look_at_a_scene_decides_how_light_is_drawn(tmp_path, ambient, floats):
    """Half of it is white: at 1 that is no brighter than 8 bits, at 3 it is."""
    grey = np.where(np.arange(64) // 8 % 2 == 0, 255, 128).astype(np.uint8)
    world = RayWorld(
        (wall(2.0, 1.0, np.tile(grey, (64, 1))),), DAVIS, gliding((0.4, 0, 0)), ambient
    )
    scene, said = panel_scene(world, (1.0, 4.0), tmp_path), []
    simulated_events(scene, panel_rig(DAVIS), SimConfig(duration_s=0.01), said.append)
    assert any("rendered in floating point" in line for line in said) is floats
    classic = SimConfig(duration_s=0.01, light={"renderer": "classic"})
    simulated_events(scene, panel_rig(DAVIS), classic, said.append)
    assert sum("rendered in floating point" in line for line in said) == floats


@pytest.mark.parametrize("name", ["fisheye", "barrel lens"])
def test_a_lens_is_undone(name):
    camera = panel_case(name).world.camera
    uv_px = np.random.default_rng(0).uniform(0, 30, (50, 2))
    points_m = np.concatenate([camera.rays(uv_px), np.ones((50, 1))], 1)
    np.testing.assert_allclose(camera.positions(points_m), uv_px, atol=1e-6)
