"""Every scene: loads, is deterministic, keeps its promises on depth, light and motion."""

import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.scenes.parts.shadows import SHELL_GROUP, bake
from eventsweep.scenes.planes import PLANE_DEPTHS_M
from eventsweep.sim.config import SimConfig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig
from eventsweep.sim.scene import put_texture
from refusals import refused
from tiers import often

NAMES = scenes.names()

TWINS = {
    "dsec-street", "hdr-night", "hdr-window", "low-texture", "moving-objects", "mvsec-flying",
    "reflective", "repetitive", "rpg-bin", "rpg-boxes", "rpg-monitor", "rpg-reader",
    "thin-structures", "trinocular-desk", "tumvie-1d", "tumvie-3d", "tumvie-6dof", "tumvie-bike",
    "tumvie-desk2", "tumvie-run", "tumvie-skate",
}  # fmt: skip
"""Scenes with promises, and tests, of their own."""

MAIN = ("boxes", "desk", "planes")
"""The scenes of the main job."""

PLAIN = tuple(name for name in NAMES if name not in TWINS)
"""Those of the main job, and whatever scene is new: they keep what docs/scenes.md promises."""


@cache
def opened(name):
    scene = scenes.load(name)
    return scene, StereoRenderer(scene.spec(), rig(scene.rig), 1, scene.depth_range_m)


@cache
def desk_textures():
    return scenes.load("desk").textures()


def views(name, seed=0, times=4, duration_s=None):
    """(camera, T_world_body) sparsely along the motion, by default over its default duration."""
    scene, _ = opened(name)
    duration_s = duration_s or scene.duration_s
    motion = scene.motion(duration_s, seed)
    for t_s in np.linspace(0, duration_s, times):
        for camera in range(len(rig(scene.rig).cameras)):
            yield camera, motion.T_world_body(float(t_s))


def test_the_scenes_are_there():
    assert set(NAMES) >= set(MAIN) | TWINS
    assert set(PLAIN) >= set(MAIN)
    assert set(scenes.summaries()) == set(NAMES)
    for name in NAMES:
        assert scenes.load(name).name == name
        assert scenes.load(name).mjcf.is_file()
        assert hasattr(scenes.load(name).textures, "__wrapped__"), name  # it keeps them
    refused(r"unknown scene 'dusk'.*boxes.* desk.* planes", scenes.load, "dusk")


def test_dashes_and_underscores_name_the_same_scene():
    assert "tumvie-6dof" in NAMES
    assert scenes.load("tumvie_6dof") is scenes.load("tumvie-6dof")


def test_a_new_scene_needs_no_change_elsewhere(tmp_path, monkeypatch):
    (tmp_path / "garret.py").write_text("SCENE = 'a garret'\n")
    (tmp_path / "_helper.py").write_text("")
    monkeypatch.setattr(scenes, "__path__", [*scenes.__path__, str(tmp_path)])
    try:
        assert "garret" in scenes.names()
        assert "_helper" not in scenes.names()
        assert scenes.load("garret") == "a garret"
    finally:
        sys.modules.pop("scenes.garret", None)


def test_listing_the_scenes_imports_nothing_heavy():
    code = (
        "import sys, scenes; scenes.names(); heavy = {'mujoco', 'numpy', 'cv2', 'scipy'};"
        "sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", often({*PLAIN} - {"desk", "boxes"}, PLAIN))
def test_a_scene_is_the_same_every_time(name):
    scene, renderer = opened(name)
    again = scene.spec().compile()
    for part in ("tex_data", "geom_size", "geom_pos", "geom_quat", "geom_matid"):
        assert np.array_equal(getattr(renderer.model, part), getattr(again, part)), part


@pytest.mark.parametrize("name", often({*MAIN} - {"desk"}, MAIN))
def test_every_texture_of_the_mjcf_gets_its_picture(name):
    model = opened(name)[1].model
    placeholders = [model.texture(k).name for k in np.flatnonzero(model.tex_width <= 2)]
    assert model.ntex >= 5
    assert placeholders == []


@pytest.mark.parametrize("name", PLAIN)
def test_light_is_fixed_and_surfaces_are_matt(name):
    _, renderer = opened(name)
    model = renderer.model
    assert not np.any(model.vis.headlight.diffuse)
    assert not np.any(model.vis.headlight.specular)
    assert not np.any(model.light_specular)
    assert not np.any(model.mat_specular)
    assert not np.any(model.mat_reflectance)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", PLAIN)
def test_depth_stays_in_the_declared_range(name, seed):
    scene, renderer = opened(name)
    nearest_m, farthest_m = scene.depth_range_m
    for camera, T_world_body in views(name, seed):
        depth_m = renderer.depth(camera, T_world_body)
        assert np.mean((depth_m >= nearest_m) & (depth_m <= farthest_m)) >= 0.99


@pytest.mark.parametrize("name", ["desk", "boxes"])
def test_the_declared_range_is_used(name):
    scene, renderer = opened(name)
    depth_m = np.concatenate([renderer.depth(*view).ravel() for view in views(name)])
    assert np.percentile(depth_m, 2) < 1.35 * scene.depth_range_m[0]
    assert np.percentile(depth_m, 98) > 0.85 * scene.depth_range_m[1]


@pytest.mark.parametrize("name", PLAIN)
def test_frames_are_neither_black_nor_saturated_and_textured_nearly_everywhere(name):
    _, renderer = opened(name)
    for view in views(name, times=2):
        intensity = renderer.frame(*view).intensity
        assert np.mean(intensity > 0.98) < 0.01
        assert np.mean(intensity < 0.04) < 0.01
        height, width = (side // 13 * 13 for side in intensity.shape)
        blocks = np.log(intensity[:height, :width]).reshape(height // 13, 13, width // 13, 13)
        assert np.mean(blocks.std(axis=(1, 3)) > 0.02) > 0.97


@pytest.mark.parametrize("name", PLAIN)
def test_the_rig_keeps_clear_of_everything(name):
    mujoco = import_mujoco()
    scene, renderer = opened(name)
    data = mujoco.MjData(renderer.model)
    mujoco.mj_forward(renderer.model, data)
    rng = np.random.default_rng(1)
    hit = np.zeros(1, np.int32)
    for seed in range(3):
        for camera, T_world_body in views(name, seed, times=5, duration_s=1.6):
            centre = (T_world_body @ rig(scene.rig).T_body_cam[camera])[:3, 3]
            for ray in rng.standard_normal((120, 3)):
                ray /= np.linalg.norm(ray)
                distance_m = mujoco.mj_ray(renderer.model, data, centre, ray, None, 1, -1, hit)
                assert distance_m < 0 or distance_m > 0.3


@pytest.mark.parametrize("name", MAIN)
def test_seed_decides_the_motion_and_only_the_motion(name):
    scene, _ = opened(name)
    times_s = np.linspace(0, scene.duration_s, 51)
    curves = [
        np.stack([scene.motion(scene.duration_s, seed).T_world_body(t) for t in times_s])
        for seed in (0, 0, 1, 2, 3, 4, 5)
    ]
    assert np.array_equal(curves[0], curves[1])
    for k in range(1, len(curves) - 1):
        assert np.abs(curves[k][:, :3, 3] - curves[k + 1][:, :3, 3]).max() > 0.005
    for curve in curves:
        assert np.allclose(curve[:, :3, :3] @ curve[:, :3, :3].swapaxes(1, 2), np.eye(3))
        speed_m_s = np.linalg.norm(np.diff(curve[:, :3, 3], axis=0), axis=1) / np.diff(times_s)
        # A seated head stays below 0.9 m/s; the panels' slide is a test rig's, not a head's.
        assert 0.4 < speed_m_s.max() < (1.4 if name == "planes" else 0.9)
        assert np.linalg.norm(np.ptp(curve[:, :3, 3], axis=0)) > 0.18


def test_planes_have_exactly_the_depths_that_they_claim():
    scene, renderer = opened("planes")
    seen = {k: renderer.model.geom(f"panel_{k}").id for k in range(len(PLANE_DEPTHS_M))}
    for seed in (0, 1):
        for camera, T_world_body in views("planes", seed):
            assert np.allclose(T_world_body[:3, :3], scene.motion(0.5, 0).T_world_body(0)[:3, :3])
            depth_m = renderer.depth(camera, T_world_body)
            geom = renderer.segmentation(camera, T_world_body)
            for k, geom_id in seen.items():
                panel = geom == geom_id
                assert panel.mean() > 0.03
                # Sheets are a millimetre thick: only their rims may lie deeper than the face.
                assert np.abs(depth_m[panel] - PLANE_DEPTHS_M[k]).max() < 1.1e-3
                face = np.abs(depth_m[panel] - PLANE_DEPTHS_M[k]) < 1e-6 * PLANE_DEPTHS_M[k] + 1e-6
                assert face.mean() > 0.99


@pytest.mark.parametrize("ground", ["desk_top", "floor"])
def test_baked_shadows_agree_with_rays_towards_the_light(ground):
    mujoco = import_mujoco()
    _, renderer = opened("desk")
    model, data = renderer.model, mujoco.MjData(renderer.model)
    mujoco.mj_forward(model, data)
    bare = desk_textures()[ground].astype(float).sum(axis=2)
    start = model.tex_adr[model.texture(ground).id]
    baked = model.tex_data[start : start + 3 * bare.size].reshape(*bare.shape, 3)
    ratio = baked.astype(float).sum(axis=2) / bare
    geom, light = model.geom(ground).id, -data.light_xdir[model.light("key").id]
    half, middle = model.geom_size[geom], data.geom_xpos[geom]
    casts = (np.arange(6) != SHELL_GROUP).astype(np.uint8)
    rng, blocked, shaded = np.random.default_rng(2), [], []
    for u, v in rng.uniform(0.02, 0.98, (600, 2)):
        point = middle + np.array([2 * u - 1, 1 - 2 * v, 1]) * half + 1e-5 * light
        hit = np.zeros(1, np.int32)
        blocked.append(mujoco.mj_ray(model, data, point, light, casts, 1, -1, hit) >= 0)
        shaded.append(ratio[int(v * bare.shape[0]), int(u * bare.shape[1])] < 0.81)
    assert np.mean(np.equal(blocked, shaded)) > 0.95
    assert 0.03 < np.mean(blocked) < 0.6


def test_a_geom_without_a_known_shadow_is_refused():
    mujoco = import_mujoco()
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody><light name="key" type="directional" dir="0 0 -1"/>
        <geom name="top" type="box" size="1 1 1"/>
        <geom name="pond" type="plane" size="1 1 1" pos="0 0 2"/></worldbody>
        <asset><texture name="t" type="2d" builtin="flat" width="8" height="8"/></asset></mujoco>"""
    )
    put_texture(spec, "t", np.full((8, 8, 3), 99, np.uint8))
    refused(r"'pond'.*group 2", bake, spec, top="t")


@pytest.mark.parametrize(
    ("given", "used"), [({}, 0.001), ({"log_eps": 0.02}, 0.02), ({"log_eps": 0.5}, 0.5)]
)
def test_a_dark_scene_lowers_log_eps_unless_the_user_chose_it(given, used):
    dark, bright = scenes.load("hdr-night"), scenes.load("desk")
    assert dark.configured(SimConfig(**given)).log_eps == used
    assert bright.configured(SimConfig(**given)).log_eps == given.get("log_eps", 0.02)
