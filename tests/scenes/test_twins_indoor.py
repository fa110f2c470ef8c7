"""The indoor twins: exact rigs, declared depth, free cameras, true stereo, right radiances."""

from functools import cache

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig
from tiers import often
from twin_checks import (
    check_original,
    check_same_every_time,
    check_textures,
    clearance_m,
    factor,
    opened,
    picture,
    poses,
    room,
    share_in_range,
    stereo,
)

# name: width, height, baseline, depth range
TWINS = {
    "tumvie-6dof": (1280, 720, 0.1184, (0.45, 4.0)),
    "tumvie-desk2": (1280, 720, 0.1184, (0.45, 4.0)),
    "tumvie-1d": (1280, 720, 0.1184, (0.45, 4.0)), "tumvie-3d": (1280, 720, 0.1184, (0.45, 4.0)),
    "mvsec-flying": (346, 260, 0.0999, (1.0, 6.5)),
    "rpg-boxes": (240, 180, 0.147, (0.5, 6.0)), "rpg-reader": (240, 180, 0.147, (0.5, 6.0)),
    "rpg-monitor": (240, 180, 0.147, (0.5, 6.0)), "rpg-bin": (240, 180, 0.147, (0.5, 6.0)),
    "hdr-window": (1280, 720, 0.1184, (0.6, 12.0)),
    "hdr-night": (1280, 720, 0.1184, (0.6, 12.0)),
}  # fmt: skip
LIT = [name for name in TWINS if not name.startswith("hdr")]
ROOMS = ["tumvie-6dof", "mvsec-flying", "rpg-boxes", "hdr-window", "hdr-night"]
OFTEN = {"mvsec-flying", "rpg-bin"}


@pytest.mark.parametrize("name", TWINS)
def test_rig_and_depth_range_are_those_of_the_original(name):
    check_original(name, *TWINS[name])


@pytest.mark.parametrize("name", often(OFTEN, [*TWINS, "trinocular-desk"]))
def test_depth_stays_in_the_declared_range(name):
    for seed in range(3):
        assert share_in_range(name, seed, factor(name)) >= 0.99


@pytest.mark.parametrize("name", often(OFTEN, TWINS))
def test_no_camera_comes_near_anything(name):
    assert clearance_m(name, factor(name)) > 0.3


@pytest.mark.parametrize("name", often(OFTEN & {*ROOMS}, ROOMS))
def test_a_room_is_cheap_matt_and_complete(name):
    model = opened(name, factor(name))[2].model
    assert 100 < model.ngeom <= 250
    check_textures(model)
    for part in (model.mat_specular, model.mat_reflectance, model.light_castshadow):
        assert not np.any(part)


@pytest.mark.parametrize("name", often(("hdr-night",), ["hdr-night", "rpg-boxes"]))
def test_a_room_is_the_same_every_time(name):
    parts = "tex_data", "geom_pos", "geom_size", "geom_quat", "mat_emission", "light_diffuse"
    check_same_every_time(name, parts)


@pytest.mark.parametrize("name", often(OFTEN & {*LIT}, LIT))
def test_pictures_have_smooth_surfaces_and_detail_and_no_black(name):
    """Real rooms are mostly paint; a scene of nothing but texture fires far too many events."""
    intensity = picture(name)
    height, width = (side // 5 * 5 for side in intensity.shape)
    blocks = np.log(intensity[:height, :width]).reshape(height // 5, 5, width // 5, 5)
    contrast = blocks.std(axis=(1, 3))
    assert np.mean(contrast < 0.1) > 0.25
    assert np.mean(contrast > 0.2) > 0.10


@pytest.mark.parametrize("name", often(OFTEN, TWINS))
def test_left_depth_warps_onto_the_right(name):
    for law in stereo(name, factor(name) / 2):
        assert law.seen > 0.5
        assert law.error_px.max() < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("name", scenes.names())
def test_true_depth_warps_onto_every_other_camera_at_full_resolution(name):
    """All cases, indoors and outdoors, each with its own lenses at the middle of its motion."""
    for law in stereo(name, 1.0, at=1):
        assert law.seen > 0.5
        assert law.error_px.max() < 0.5


def motion_of(name, seed=0):
    return np.stack(poses(name, seed, 26))


@pytest.mark.parametrize("name", TWINS)
def test_seed_decides_the_motion(name):
    assert np.array_equal(motion_of(name), motion_of(name))
    assert np.abs(motion_of(name)[:, :3, 3] - motion_of(name, 1)[:, :3, 3]).max() > 0.005


@pytest.mark.parametrize("name", TWINS)
def test_heads_and_hands_move_as_fast_as_the_real_ones(name):
    """Medians of the real recordings: 0.28 to 0.44 m/s; 99th percentiles: 0.48 to 0.95 m/s."""
    speeds = []
    for seed in range(6):
        step_m = np.linalg.norm(np.diff(motion_of(name, seed)[:, :3, 3], axis=0), axis=1)
        speeds.append(step_m / (scenes.load(name).duration_s / 25))
    assert np.max(speeds) < 1.2
    assert 0.1 < np.median(speeds) < 0.6


@pytest.mark.parametrize(("name", "axes"), [("tumvie-1d", 1), ("tumvie-3d", 3)])
def test_the_translations_hardly_turn_and_go_where_they_should(name, axes):
    """No head moves along a line; it wanders by millimetres and a degree or two."""
    ways_m = []
    for seed in range(6):
        curve = motion_of(name, seed)
        turned = curve[:, :3, :3] @ curve[12, :3, :3].T
        angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1))
        assert np.degrees(angle).max() < 4
        ways_m.append(curve[-1, :3, 3] - curve[0, :3, 3])
    spread_m = np.linalg.svd(np.array(ways_m))[1]
    assert np.sum(spread_m > 0.1 * spread_m[0]) == axes


@cache
def radiance(name):
    """Linear picture (H, W) of any brightness."""
    scene, seen, _ = opened(name, factor(name))
    spec = room(scene.mjcf, scene.edit, name)
    with StereoRenderer(spec, seen, 2, scene.depth_range_m, floats=True) as drawn:
        return drawn.frame(0, poses(name, 0, 3)[1]).intensity


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hdr-window", "hdr-night"])
def test_light_and_dark_are_a_thousand_to_one_in_one_view(name):
    seen = radiance(name)
    assert np.percentile(seen, 99.9) > 1000 * np.percentile(seen, 2)
    assert 2e-4 < np.percentile(seen, 2) < 0.05


@pytest.mark.slow
def test_the_window_shows_more_than_white():
    """What a frame camera would burn out has structure: bricks, frames, branches."""
    seen = radiance("hdr-window")
    window = seen[seen > 2]
    assert 0.03 < window.size / seen.size < 0.4
    assert np.std(np.log(window)) > 0.2


@pytest.mark.skipif("trinocular" not in scenes.load("trinocular-desk").rig, reason="no such rig")
def test_three_cameras_see_the_desk():
    scene = scenes.load("trinocular-desk")
    seen = rig(scene.rig)
    assert len(seen.cameras) == 3
    assert min(seen.baseline_m(i, j) for i, j in ((0, 1), (0, 2), (1, 2))) > 0.03
    assert scene.mjcf == scenes.load("desk").mjcf
