"""The twins and the hard cases: rigs, depth, free ways, true stereo, light, moving bodies."""

from functools import cache

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.scenes.moving_objects import RECORD_S
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig
from refusals import refused
from tiers import often
from twin_checks import (
    check_original,
    check_same_every_time,
    check_textures,
    factor,
    opened,
    picture,
    poses,
    room,
    smaller,
    stereo,
)

VIE, RPG = ("tumvie-kb4", 1280, 720, 0.1184), ("rpg", 240, 180, 0.147)
# name: rig, width, height, baseline, depth range
INDOORS = {
    "tumvie-6dof": (*VIE, (0.45, 4.0)), "tumvie-desk2": (*VIE, (0.45, 4.0)),
    "tumvie-1d": (*VIE, (0.45, 4.0)), "tumvie-3d": (*VIE, (0.45, 4.0)),
    "mvsec-flying": ("mvsec", 346, 260, 0.0999, (1.0, 6.5)),
    "rpg-boxes": (*RPG, (0.5, 6.0)), "rpg-reader": (*RPG, (0.5, 6.0)),
    "rpg-monitor": (*RPG, (0.5, 6.0)), "rpg-bin": (*RPG, (0.5, 6.0)),
    "hdr-window": (*VIE, (0.6, 12.0)), "hdr-night": (*VIE, (0.6, 12.0)),
}  # fmt: skip
RIDES = {
    "tumvie-skate": (*VIE, (1.0, 20.0)), "tumvie-run": (*VIE, (1.0, 30.0)),
    "tumvie-bike": (*VIE, (3.0, 200.0)),
    "dsec-street": ("dsec", 640, 480, 0.599, (4.0, 50.0)),
}  # fmt: skip
TWINS = INDOORS | RIDES
HARD = ["moving-objects", "low-texture", "repetitive", "thin-structures", "reflective"]
ALL = [*TWINS, *HARD]
UNDER_THE_SKY = {"tumvie-run", "tumvie-bike", "dsec-street", "repetitive", "thin-structures"}
LIT = [name for name in INDOORS if not name.startswith("hdr")]
ROOMS = ["tumvie-6dof", "mvsec-flying", "rpg-boxes", "hdr-window", "hdr-night", *RIDES, *HARD]
REPEATED = ["hdr-night", "rpg-boxes", *RIDES, *HARD]
OFTEN = {"mvsec-flying", "rpg-bin", "dsec-street", "moving-objects"}


@pytest.mark.parametrize("name", TWINS)
def test_rig_and_depth_range_are_those_of_the_original(name):
    rig_name, *rest = TWINS[name]
    assert scenes.load(name).rig == rig_name
    check_original(name, *rest)


@pytest.mark.parametrize("name", often(OFTEN, [*ALL, "trinocular-desk"]))
def test_depth_is_in_the_declared_range_or_that_of_the_sky(name):
    scene, seen, renderer = opened(name, factor(name))
    low_m, high_m = scene.depth_range_m
    for seed in range(3):
        for T_world_body in poses(name, seed, 4 if name in INDOORS else 2):
            for camera in range(len(seen.cameras)):
                depth_m = renderer.depth(camera, T_world_body)
                # MuJoCo draws the sky as a box just before the far clipping plane.
                sky = depth_m > 2 * high_m
                assert name in UNDER_THE_SKY or not sky.any()
                assert np.mean(sky | ((depth_m >= low_m) & (depth_m <= high_m))) >= 0.99


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_nothing_stands_in_the_way(name):
    """Rays from every camera, all along the way of three seconds where the gait goes forward."""
    mujoco = import_mujoco()
    scene, seen, renderer = opened(name, factor(name))
    data = mujoco.MjData(renderer.model)
    mujoco.mj_forward(renderer.model, data)
    rays = np.random.default_rng(1).standard_normal((60 if name in INDOORS else 24, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    hit = np.zeros(1, np.int32)
    duration_s = 3.0 if name in RIDES else scene.duration_s
    for seed in range(3 if name in INDOORS else 2):
        motion = scene.motion(duration_s, seed)
        for t_s in np.linspace(0, duration_s, 5):
            for T_body_cam in seen.T_body_cam:
                eye = (motion.T_world_body(float(t_s)) @ T_body_cam)[:3, 3]
                for ray in rays:
                    far_m = mujoco.mj_ray(renderer.model, data, eye, ray, None, 1, -1, hit)
                    assert far_m < 0 or far_m > 0.3


@pytest.mark.parametrize("name", often(OFTEN & {*ROOMS}, ROOMS))
def test_a_place_is_cheap_complete_and_matt(name):
    model = opened(name, factor(name))[2].model
    assert (100 if name in INDOORS else 20) < model.ngeom <= (250 if name in INDOORS else 300)
    check_textures(model)
    if name == "reflective":  # it breaks the rule that points keep their brightness
        assert np.count_nonzero(model.mat_reflectance) == 1
        assert np.count_nonzero(model.mat_specular) >= 4
    else:
        assert not np.any(model.mat_specular)
        assert not np.any(model.mat_reflectance)
    assert name not in INDOORS or not np.any(model.light_castshadow)


@pytest.mark.parametrize("name", often(OFTEN & {*REPEATED}, REPEATED))
def test_a_place_is_the_same_every_time(name):
    parts = "tex_data", "geom_pos", "geom_size", "geom_quat", "mat_emission", "light_diffuse"
    check_same_every_time(name, (*parts, "mesh_vert", "qpos0"))


@pytest.mark.parametrize("name", often(OFTEN & {*RIDES, *HARD}, [*RIDES, *HARD]))
def test_pictures_are_neither_black_nor_saturated_and_have_contrast(name):
    assert np.std(np.log(picture(name))) > 0.15


@pytest.mark.parametrize("name", often(OFTEN & {*LIT}, LIT))
def test_pictures_have_smooth_surfaces_and_detail_and_no_black(name):
    """Real rooms are mostly paint; a scene of nothing but texture fires far too many events."""
    intensity = picture(name)
    height, width = (side // 5 * 5 for side in intensity.shape)
    blocks = np.log(intensity[:height, :width]).reshape(height // 5, 5, width // 5, 5)
    contrast = blocks.std(axis=(1, 3))
    assert np.mean(contrast < 0.1) > 0.25
    assert np.mean(contrast > 0.2) > 0.10


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_left_depth_warps_onto_the_right(name):
    for law in stereo(name, factor(name) / 2):
        assert law.seen > (0.5 if name in INDOORS else 0.3)
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


@pytest.mark.parametrize("name", ALL)
def test_seed_decides_the_motion(name):
    assert np.array_equal(motion_of(name), motion_of(name))
    other = np.abs(motion_of(name) - motion_of(name, 1))
    if name in INDOORS:
        assert other[:, :3, 3].max() > 0.005
    assert other.max() > 0.003


@pytest.mark.parametrize("name", INDOORS)
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


@pytest.mark.parametrize(
    ("name", "speed_m_s"),
    [("tumvie-skate", 2.6), ("tumvie-run", 3.0), ("tumvie-bike", 4.8), ("dsec-street", 9.0)],
)
def test_gaits_go_forward_at_their_speed(name, speed_m_s):
    scene = scenes.load(name)
    for seed in range(3):
        motion = scene.motion(4.0, seed)
        way = motion.T_world_body(4.0)[:3, 3] - motion.T_world_body(0.0)[:3, 3]
        assert way[1] / 4.0 == pytest.approx(speed_m_s, rel=0.06)
        assert abs(way[2]) < 0.15


# --- bodies that move by themselves ----------------------------------------------------------


def positions(times_s):
    mujoco = import_mujoco()
    scene = scenes.load("moving-objects")
    model = opened("moving-objects", 2.5)[2].model
    data = mujoco.MjData(model)
    found = []
    for t_s in times_s:
        scene.animate(model, data, float(t_s))
        found.append(data.qpos.copy())
    return np.array(found)


def test_bodies_are_a_pure_function_of_time():
    times_s = np.random.default_rng(0).uniform(0, 1.2, 40)
    in_order, shuffled = positions(np.sort(times_s)), positions(times_s)
    assert np.array_equal(in_order, shuffled[np.argsort(times_s)])


def test_bodies_start_where_the_scene_puts_them():
    model = opened("moving-objects", 2.5)[2].model
    assert np.allclose(positions([0.0])[0], model.qpos0)


def test_bodies_equal_plain_physics():
    """The twin: MuJoCo stepped from the start at the fixed step, without a recording."""
    mujoco = import_mujoco()
    scene = scenes.load("moving-objects")
    spec = mujoco.MjSpec.from_file(str(scene.mjcf))
    scene.animate.build(spec)
    spec.option.timestep = RECORD_S / 2
    model = spec.compile()
    data = mujoco.MjData(model)
    for joint, velocity in scene.animate.start:
        data.joint(joint).qvel[:] = velocity
    mujoco.mj_step(model, data, 1000)
    assert np.allclose(positions([0.5])[0], data.qpos, atol=1e-9)


def test_balls_fall_freely_before_they_touch_anything():
    t_s = np.linspace(0, 0.2, 5)
    model = opened("moving-objects", 2.5)[2].model
    z = positions(t_s)[:, model.joint("basketball").qposadr[0] + 2]
    assert z - z[0] == pytest.approx(0.6 * t_s - 9.81 / 2 * t_s**2, abs=2e-3)


def test_bodies_cross_the_gymnasium_and_stay_inside():
    model = opened("moving-objects", 2.5)[2].model
    way = positions(np.linspace(0, 1.5, 31))
    for name in ("basketball", "beach_ball", "medicine_ball", "small_ball", "tyre"):
        x, y, z = way[:, model.joint(name).qposadr[0] :][:, :3].T
        assert np.ptp(x) > 0.9, name
        assert np.abs(x).max() < 3.3
        assert y.min() > 0.6
        assert y.max() < 7.0
        assert z.min() > 0.02
    quats = way[:, model.joint("tyre").qposadr[0] + 3 :][:, :4]
    assert np.allclose(np.linalg.norm(quats, axis=1), 1)


def test_bodies_move_no_pixel_by_more_than_half_between_frames():
    """The cap on the frame interval: the fastest body's image, seen from a head at rest."""
    scene = scenes.load("moving-objects")
    seen = rig(scene.rig).cameras[0]
    model = opened("moving-objects", 2.5)[2].model
    step_s = scene.animate.max_interval_us * 1e-6
    T_cam_world = np.linalg.inv(scene.motion(0.5, 0).T_world_body(0.25))
    for t_s in np.linspace(0, 0.5, 11):
        before, after = positions([t_s, t_s + step_s])
        for name, _ in scene.animate.start[:-1]:
            at = model.joint(name).qposadr[0]
            points = np.stack([before[at : at + 3], after[at : at + 3], [0, 0, 0]])
            uv = seen.project(points @ T_cam_world[:3, :3].T + T_cam_world[:3, 3])
            assert np.linalg.norm(uv[1] - uv[0]) < 0.5, name


def test_static_and_dynamic_pixels_are_told_apart():
    mujoco = import_mujoco()
    scene = scenes.load("moving-objects")
    seen = smaller(rig(scene.rig), 2.5)
    with StereoRenderer(scene.spec(), seen, 1, scene.depth_range_m) as renderer:
        model = renderer.model
        moves = model.body_weldid[model.geom_bodyid] != 0
        names = {model.geom(k).name for k in np.flatnonzero(moves)}
        geom = renderer.segmentation(0, poses("moving-objects", 0, 3)[0])
    assert names == {
        "bag", "bag_rope", "basketball", "beach_ball", "falling_box", "medicine_ball",
        "small_ball", "tyre",
    }  # fmt: skip
    assert 0.03 < np.mean(moves[geom[geom >= 0]]) < 0.3
    assert mujoco.mjtJoint.mjJNT_HINGE in model.jnt_type


def test_a_wrong_model_or_time_is_refused():
    mujoco = import_mujoco()
    scene = scenes.load("moving-objects")
    other = opened("low-texture", 2.5)[2].model
    refused("same scene", scene.animate, other, mujoco.MjData(other), 0.1)
    model = opened("moving-objects", 2.5)[2].model
    refused("starts at 0", scene.animate, model, mujoco.MjData(model), -0.1)
