"""Light in floating point: linear over 120 dB, and without steps that make events."""

import numpy as np
from scipy.spatial.transform import Rotation

import mujoco_scenes as made
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import LightConfig, SimConfig
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.sensor.esim import EventSimulator

RANGE_M = (0.5, 8.0)
POSE = look_at((0, 0, 1), (2, 0.1, 0.95))
LEVEL = look_at((0, 0, 1), (2, 0, 1))
RIG = made.small_rig()
ONE = Rig("one", (Camera(24, 18, 30, 30, 11.5, 8.5),), (np.eye(4),))


def pictures(spec, floats, pose=POSE, rig=RIG):
    with StereoRenderer(spec, rig, 2, RANGE_M, floats=floats) as renderer:
        return renderer.frame(0, pose), renderer.depth(0, pose), renderer.segmentation(0, pose)


def test_floats_are_what_8_bits_are_rounded_from():
    """Where no colour exceeds 1, light differs by half a grey level; depth and geoms not at all."""
    spec = made.spec(made.BOXES)
    (frame, *geometry), (stepped, *same) = pictures(spec, True), pictures(spec, False)
    assert frame.intensity.max() < 1
    assert np.abs(frame.intensity - stepped.intensity).max() < 0.6 / 255
    assert np.array_equal(frame.nearest_depth_m, stepped.nearest_depth_m)
    for ours, theirs in zip(geometry, same, strict=True):
        assert np.array_equal(ours, theirs)


def test_a_mirror_shows_the_same_in_floats():
    """A bright board, wider than the mirror before it: what is reflected ends with the mirror."""
    materials = (
        '<material name="mirror" reflectance=".7" rgba=".1 .1 .1 1"/>'
        '<material name="bright" emission=".9" rgba="1 1 1 1"/>'
    )
    geoms = (
        '<geom type="box" size=".3 .1 .02" pos="1.2 0 .5" material="mirror"/>'
        '<geom type="box" size=".1 .6 .3" pos="2 0 1" material="bright"/>'
    )
    reflecting, dull = made.spec(geoms, materials), made.spec(geoms, materials.replace(".7", "0"))
    (frame, *_), (stepped, *_) = pictures(reflecting, True), pictures(reflecting, False)
    without = pictures(dull, False)[0].intensity
    assert (np.abs(stepped.intensity - without) > 0.3).mean() > 0.005
    assert np.abs(frame.intensity - stepped.intensity).max() < 0.6 / 255


def test_light_is_linear_over_160_db():
    """The same scene under lamps from 1e-4 to 1e4 times as bright."""
    spec = made.spec(made.BOXES)
    reference = pictures(spec, True)[0].intensity
    for gain in (1e-4, 1e-2, 16.0, 1e4):
        for lamp in spec.lights:
            before = lamp.diffuse.copy(), lamp.ambient.copy(), lamp.specular.copy()
            lamp.diffuse, lamp.ambient, lamp.specular = (gain * value for value in before)
        found = pictures(spec, True)[0].intensity
        for lamp in spec.lights:
            lamp.diffuse, lamp.ambient, lamp.specular = before
        np.testing.assert_allclose(found, gain * reference, rtol=1e-4, atol=1e-9 * gain)


def test_120_db_in_one_picture():
    """Glowing panels side by side, a million to one, each as bright as it was made."""
    glow = np.geomspace(1e-3, 1e3, 7)
    spec = made.spec("")
    for k, brightness in enumerate(glow):
        material = spec.add_material(name=f"m{k}", emission=brightness, rgba=[1, 1, 1, 1])
        spec.worldbody.add_geom(
            type=6, size=[0.05, 0.1, 0.5], pos=[2, 0.6 - 0.2 * k, 1], material=material.name
        )
    frame, _, geom = pictures(spec, True, LEVEL)
    for k, brightness in enumerate(glow):
        seen = frame.intensity[geom == k]
        inside = seen[np.abs(np.log(seen / np.median(seen))) < 0.1]
        assert len(inside) > 200
        np.testing.assert_allclose(inside, brightness, rtol=1e-3)


def slow_ramp(floats, frames=120, brightness=0.02, angle_rad=1.0):
    """Pictures of a wall lit by the headlight as the head turns: cos(angle) exactly; and the truth.

    Brightness falls from 5 to 3 grey levels of 8 bits.
    """
    wall = '<geom type="box" size=".1 60 60" pos="3 0 0" rgba="1 1 1 1"/>'
    spec = made.spec(wall)
    spec.visual.headlight.diffuse = [brightness] * 3
    with StereoRenderer(spec, ONE, 2, (0.5, 50.0), floats=floats) as renderer:
        for k in range(frames):
            angle = angle_rad * k / (frames - 1)
            pose = LEVEL.copy()
            pose[:3, :3] = Rotation.from_euler("z", angle).as_matrix() @ LEVEL[:3, :3]
            seen = renderer.frame(0, pose).intensity
            yield k * 1000, seen, np.full_like(seen, brightness * np.cos(angle))


def unmatched(floats):
    """Events of the ramp's pictures and how many of them have no true event near in time."""
    config = SimConfig(contrast_threshold_pos=0.05, contrast_threshold_neg=0.05, log_eps=1e-4)
    seen, true = EventSimulator(24, 18, config), EventSimulator(24, 18, config)
    found, wanted = [], []
    for t_us, picture, truth in slow_ramp(floats):
        if t_us == 0:
            seen.start(picture, 0)
            true.start(truth, 0)
        else:
            found.append(seen.step(picture, t_us))
            wanted.append(true.step(truth, t_us))
    times = [
        {
            p: [e.t_us[(e.x == p[0]) & (e.y == p[1])] for e in part if len(e)]
            for p in np.ndindex(24, 18)
        }
        for part in (found, wanted)
    ]
    wrong = 0
    for pixel, pieces in times[0].items():
        mine, theirs = np.concatenate(pieces), np.concatenate(times[1][pixel])
        gap = np.abs(mine[:, None] - theirs[None, :]).min(axis=1)
        wrong += int((gap > 2000).sum()) + max(0, len(mine) - len(theirs))
    return sum(map(len, wanted)), sum(map(len, found)), wrong


def test_no_event_comes_from_steps_of_brightness():
    """Below 0.1 % of the true events, two frames from a true one; with 8 bits most are spurious."""
    true, found, spurious = unmatched(floats=True)
    assert true > 24 * 18 * 10
    assert abs(found - true) < 0.001 * true
    assert spurious < 0.001 * true
    stepped_true, _, stepped = unmatched(floats=False)
    assert stepped > 0.5 * stepped_true


def test_auto_takes_floats_where_the_scene_asks():
    assert LightConfig().floats(hdr=True)
    assert not LightConfig().floats(hdr=False)
    assert LightConfig(renderer="float").floats(hdr=False)
    assert not LightConfig(renderer="classic").floats(hdr=True)
