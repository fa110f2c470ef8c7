"""The outdoor twins and the hard cases: rigs, depth, free ways, true stereo, moving bodies."""

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.scenes.moving_objects import RECORD_S
from eventsweep.scenes.textures import facades, objects, outdoor
from eventsweep.scenes.textures.noise import BRIGHTEST, DARKEST, streams
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
    smaller,
    stereo,
)

# name: rig, width, height, baseline, depth range
TWINS = {
    "tumvie-skate": ("tumvie-kb4", 1280, 720, 0.1184, (1.0, 20.0)),
    "tumvie-run": ("tumvie-kb4", 1280, 720, 0.1184, (1.0, 30.0)),
    "tumvie-bike": ("tumvie-kb4", 1280, 720, 0.1184, (3.0, 200.0)),
    "dsec-street": ("dsec", 640, 480, 0.599, (4.0, 50.0)),
}
HARD = ["moving-objects", "low-texture", "repetitive", "thin-structures", "reflective"]
ALL = [*TWINS, *HARD]
OFTEN = ("dsec-street", "moving-objects")
OUTDOORS = ["tumvie-run", "tumvie-bike", "dsec-street", "repetitive", "thin-structures"]


@pytest.mark.parametrize("name", TWINS)
def test_rig_and_depth_range_are_those_of_the_original(name):
    rig_name, *rest = TWINS[name]
    assert scenes.load(name).rig == rig_name
    check_original(name, *rest)


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_depth_is_in_the_declared_range_or_that_of_the_sky(name):
    scene, seen, renderer = opened(name, factor(name))
    low_m, high_m = scene.depth_range_m
    for seed in range(3):
        for T_world_body in poses(name, seed, 2):
            for camera in range(len(seen.cameras)):
                depth_m = renderer.depth(camera, T_world_body)
                # MuJoCo draws the sky as a box just before the far clipping plane.
                sky = depth_m > 2 * high_m
                assert name in OUTDOORS or not sky.any()
                assert np.mean(sky | ((depth_m >= low_m) & (depth_m <= high_m))) >= 0.99


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_nothing_stands_in_the_way(name):
    """Rays from every camera, all along the way of three seconds where the gait goes forward."""
    mujoco = import_mujoco()
    scene, seen, renderer = opened(name, factor(name))
    data = mujoco.MjData(renderer.model)
    mujoco.mj_forward(renderer.model, data)
    rays = np.random.default_rng(1).standard_normal((24, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    hit = np.zeros(1, np.int32)
    for seed in range(2):
        motion = scene.motion(3.0, seed)
        for t_s in np.linspace(0, 3.0 if name in TWINS else scene.duration_s, 5):
            for T_body_cam in seen.T_body_cam:
                eye = (motion.T_world_body(float(t_s)) @ T_body_cam)[:3, 3]
                for ray in rays:
                    far_m = mujoco.mj_ray(renderer.model, data, eye, ray, None, 1, -1, hit)
                    assert far_m < 0 or far_m > 0.3


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_a_place_is_cheap_complete_and_within_bounds(name):
    model = opened(name, factor(name))[2].model
    assert 20 < model.ngeom <= 300
    check_textures(model)
    if name != "reflective":
        assert not np.any(model.mat_specular)
        assert not np.any(model.mat_reflectance)


def test_the_reflective_kitchen_breaks_the_rule_that_points_keep_their_brightness():
    model = opened("reflective", factor("reflective"))[2].model
    assert np.count_nonzero(model.mat_reflectance) == 1
    assert np.count_nonzero(model.mat_specular) >= 4


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_a_place_is_the_same_every_time(name):
    parts = "tex_data", "geom_pos", "geom_size", "geom_quat", "mesh_vert", "qpos0"
    check_same_every_time(name, parts)


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_pictures_are_neither_black_nor_saturated_and_have_contrast(name):
    assert np.std(np.log(picture(name))) > 0.15


@pytest.mark.parametrize("name", often(OFTEN, ALL))
def test_left_depth_warps_onto_the_right(name):
    for law in stereo(name, factor(name) / 2):
        assert law.seen > 0.3
        assert law.error_px.max() < 0.5


@pytest.mark.parametrize("name", ALL)
def test_seed_decides_the_motion(name):
    first, again, other = (np.stack(poses(name, seed, 11)) for seed in (0, 0, 1))
    assert np.array_equal(first, again)
    assert np.abs(first - other).max() > 0.003


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


MAKERS = {
    "asphalt": lambda rng: outdoor.asphalt((256, 256), rng),
    "gravel": lambda rng: outdoor.gravel((256, 256), rng, ((0.3,) * 3, (0.7,) * 3)),
    "grass": lambda rng: outdoor.grass((256, 256), rng),
    "hedge": lambda rng: outdoor.hedge((128, 192), rng),
    "leaves": lambda rng: outdoor.leaves(128, rng),
    "bark": lambda rng: outdoor.bark(64, rng),
    "roof": lambda rng: outdoor.roof_tiles((192, 256), rng),
    "sky": lambda rng: outdoor.sky(48, rng),
    "facade": lambda rng: facades.facade(
        (256, 256), rng, facades.Front(3, 4, (0.7, 0.6, 0.5), shop=True)
    ),
    "brick_facade": lambda rng: facades.facade(
        (256, 256), rng, facades.Front(3, 4, (0.7, 0.6, 0.5), brick=True)
    ),
    "door": lambda rng: facades.door_leaf((256, 128), rng, (0.4, 0.4, 0.5)),
    "lockers": lambda rng: facades.lockers((192, 256), rng, 4, (0.3, 0.4, 0.5)),
    "boards": lambda rng: facades.picket_row((128, 256), rng, 8),
    "checker": lambda rng: facades.checker((128, 128), rng, 8),
    "car": lambda rng: objects.car_side((96, 320), rng, (0.5, 0.2, 0.2)),
    "cabin": lambda rng: objects.car_cabin((64, 192), rng, (0.5, 0.2, 0.2)),
    "wheel": lambda rng: objects.wheel(64, rng),
}


@pytest.mark.parametrize("name", MAKERS)
def test_textures_keep_their_bounds_and_depend_on_the_generator_alone(name):
    first, again = (MAKERS[name](streams(3, 2)[0]) for _ in range(2))
    other = MAKERS[name](streams(3, 2)[1])
    assert first.dtype == np.uint8
    assert first.shape[2] == 3
    assert first.min() >= DARKEST
    assert first.max() <= BRIGHTEST
    assert first.std() > 3
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("name", ["asphalt", "grass", "hedge"])
def test_grounds_tile_without_a_seam(name):
    grey = MAKERS[name](streams(3, 1)[0]).astype(float).mean(axis=2)
    for axis in (0, 1):
        steps = np.abs(np.diff(grey, axis=axis)).mean(axis=1 - axis)
        seam = np.abs(np.take(grey, 0, axis) - np.take(grey, -1, axis)).mean()
        assert seam <= 1.2 * steps.max()


def test_the_sky_has_no_seam_between_its_faces():
    """It is a function of the direction: neighbouring faces agree along their common edge."""
    east, west, up, _, south, north = outdoor.sky(64, streams(3, 1)[0]).reshape(6, 64, 64, 3)
    assert np.abs(south[:, -1].astype(int) - east[:, 0]).max() <= 2
    assert np.abs(east[:, -1].astype(int) - north[:, 0]).max() <= 2
    assert np.abs(north[:, -1].astype(int) - west[:, 0]).max() <= 2
    assert np.abs(up[-1].astype(int) - south[0]).max() <= 2


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
