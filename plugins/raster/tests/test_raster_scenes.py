"""Our scenes by both renderers."""

from dataclasses import replace

import numpy as np
import pytest

from both_renderers import apart
from eventsweep import scenes
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.rigs import rig
from tiers import often

WIDTH_PX, HEIGHT_PX = 88, 66


def window(name):
    """The middle of a scene's first camera."""
    camera = rig(scenes.load(name).rig).cameras[0]
    left, top = (camera.width_px - WIDTH_PX) // 2, (camera.height_px - HEIGHT_PX) // 2
    cut = {"cx_px": camera.cx_px - left, "cy_px": camera.cy_px - top}
    smaller = replace(camera, width_px=WIDTH_PX, height_px=HEIGHT_PX, **cut)
    return Rig("window", (smaller,), (np.eye(4),), ("left",))


@pytest.mark.parametrize("name", often(["planes", "reflective"], scenes.names()))
def test_a_scene_looks_as_mujoco_draws_it(name):
    scene = scenes.load(name)
    T_world_body = scene.motion(scene.duration_s, 0).T_world_body(0.1)
    settings = {"depth_range_m": scene.depth_range_m, "animate": scene.animate, "border_px": 2}
    found = apart(
        scene.spec(), window(name), T_world_body, 6, floats=scene.hdr, t_s=0.1, **settings
    )
    assert found.light.size > 200
    assert np.median(found.light) < 1
    # Strong light makes more of a texel's 8 bits, which MuJoCo's halved textures round up.
    assert np.percentile(found.light, 99) < (8 if scene.hdr else 4)
    assert np.percentile(found.depth, 99) < 1e-5
    assert found.signs < 2e-3
    assert found.edges < 0.02
