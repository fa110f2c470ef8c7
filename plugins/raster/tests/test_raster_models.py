"""Everything that a model may show, by both renderers."""

import numpy as np
import pytest

import mujoco_scenes as made
from both_renderers import apart
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.raster.renderer import RasterRenderer
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import look_at

POSE, RANGE_M = look_at((-2.5, 0.4, 1.3), (1, -0.1, -0.25)), (0.4, 30.0)
PINHOLE = Camera(120, 90, 95.3, 97.1, 58.2, 46.4)
LENS = Camera(96, 72, 60, 60, 47.5, 35.5, "kb4", (-0.02, 0.01, -0.004, 0.001))
RNG = np.random.default_rng(5)
SMOOTH = np.kron(RNG.integers(40, 220, (16, 16, 3)), np.ones((8, 8, 1))).astype(np.uint8)
SHAPES = """
<geom type="box" size=".3 .2 .25" pos=".2 .9 .4" euler="10 20 30" material="m"/>
<geom type="sphere" size=".3" pos="0 .1 .5" material="m"/>
<geom type="ellipsoid" size=".2 .3 .15" pos="-.3 -.4 1.2" euler="40 0 20" material="m"/>
<geom type="cylinder" size=".2 .3" pos=".3 -.7 .4" euler="60 10 0" material="m"/>
<geom type="capsule" size=".12 .3" pos="-.2 .8 1.2" euler="20 50 0" material="m"/>
<geom type="plane" size="4 3 .5" material="m"/>
"""
LAMP = (
    '<light pos="-1 0 4" dir=".2 0 -1" type="directional" diffuse=".5 .5 .5" ambient=".3 .3 .3"/>'
)
SPOT = (
    '<light pos="-1 0 3" dir=".3 0 -1" cutoff="50" exponent="6" diffuse=".8 .8 .8" '
    'attenuation="0.6 0.1 0.05" specular="0 0 0"/>'
)
FLAT = '<texture name="t" type="2d" builtin="flat" width="2" height="2"/>'
CUBE = '<texture name="t" type="cube" builtin="flat" width="2" height="12"/>'
SKY = (
    '<texture name="s" type="skybox" builtin="gradient" width="64" height="384" '
    'rgb1=".2 .3 .9" rgb2=".9 .8 .2"/>'
)
ENDLESS = '<geom type="plane" size="0 0 1" material="m"/>'

# Two tetrahedra through each other: an eye sees up to four faces, one behind the other.
STAR = (
    '<mesh name="star" inertia="shell" vertex="0 0 .5 .5 0 -.2 -.25 .4 -.2 -.25 -.4 -.2 '
    '0 .1 -.5 .5 .1 .2 -.25 .5 .2 -.25 -.3 .2" '
    'face="0 1 2 0 2 3 0 3 1 1 3 2 4 6 5 4 7 6 4 5 7 5 6 7"/>'
)
FIELD = (
    '<hfield name="h" nrow="9" ncol="7" size="1 1.2 .6 .1" elevation="'
    + " ".join(str(v) for v in RNG.integers(0, 9, 63))
    + '"/>'
)
GLASS = (("box", -0.5), ("sphere", 0), ("cylinder", 0.2), ("ellipsoid", 0.4), ("capsule", 0.7))


def material(settings=""):
    return f'<material name="m" texture="t" specular="0" {settings}/>'


MODELS = {
    "flat textures": (SHAPES + LAMP, FLAT + material('texrepeat="2 3"')),
    "flat, uniform": (SHAPES + LAMP, FLAT + material('texrepeat="2 3" texuniform="true"')),
    "cube textures": (SHAPES + LAMP, CUBE + material()),
    "cube, uniform": (SHAPES + LAMP, CUBE + material('texuniform="true"')),
    "plain colours": (SHAPES + LAMP, '<material name="m" rgba=".8 .4 .2 1" specular="0"/>'),
    "emission": (SHAPES + LAMP, FLAT + material('emission=".4" rgba=".9 .7 .8 1"')),
    "a lamp of another kind": (
        SHAPES + LAMP + '<light type="point" pos="0 0 3"/>', FLAT + material()
    ),
    "a spot": (SHAPES + SPOT, FLAT + material()),
    "coloured lights": (
        SHAPES + LAMP.replace(".5 .5 .5", ".7 .2 .1").replace(".3 .3 .3", ".1 .1 .4"),
        FLAT + material(),
    ),
    "gloss": (SHAPES + LAMP, '<material name="m" rgba=".3 .4 .5 1" specular=".8" shininess=".3"/>'),
    "no light": (SHAPES, FLAT + material()),
    "sky": (SHAPES + LAMP, SKY + FLAT + material()),
    "a plane without end": (
        LAMP + ENDLESS, SKY + FLAT + material('texuniform="true"')
    ),
    "glass": (
        SHAPES + LAMP + "".join(f'<geom type="{kind}" size=".2 .3 .25" pos="-1 {y} 1" '
        f'rgba=".8 .{n} .3 .{n}"/>' for n, (kind, y) in enumerate(GLASS, 3)),
        FLAT + material(),
    ),
    "glass meshes": (
        SHAPES + LAMP + '<geom type="mesh" mesh="star" pos="-1 .2 .9" euler="20 40 10" '
        'rgba=".8 .3 .3 .5"/><geom type="mesh" mesh="star" pos="-1.2 -.3 .9" material="g"/>'
        '<geom type="hfield" hfield="h" pos="-.9 0 .3" rgba=".3 .6 .5 .4"/>',
        FLAT + material() + STAR + FIELD + '<material name="g" texture="t" rgba="1 .5 1 .4"/>',
    ),
    "textures with opacity": (
        SHAPES + LAMP + '<geom type="box" size=".3 .4 .2" pos="-1 .2 1" material="c"/>'
        '<geom type="mesh" mesh="star" pos="-1.2 -.4 1" material="c"/>'
        '<geom type="plane" size=".4 .4 .1" pos="-.8 .9 1" euler="0 70 0" material="m"/>',
        FLAT + material() + STAR + '<material name="c" texture="t" specular="0" '
        'rgba="1 .9 .8 .7"/>',
    ),
    "textures of one channel": (SHAPES + LAMP, FLAT + material()),
    "glass in a mirror": (
        SHAPES.replace('.5" material="m"', '.5" material="r"') + LAMP
        + '<geom type="sphere" size=".3" pos="-.9 .4 .5" rgba=".8 .3 .3 .4"/>'
        '<geom type="mesh" mesh="star" pos="-.8 -.4 .6" rgba=".2 .8 .3 .6"/>',
        FLAT + material() + STAR + '<material name="r" reflectance=".6" rgba=".3 .4 .5 1"/>',
    ),
    "a mirror on the floor": (
        SHAPES.replace('.5" material="m"', '.5" material="r"') + LAMP,
        FLAT + material() + '<material name="r" reflectance=".6" rgba=".3 .4 .5 1"/>',
    ),
    "a mirror on a box": (
        SHAPES + LAMP + '<geom type="box" size="1 1 .1" pos="0 0 .2" material="r"/>',
        FLAT + material() + '<material name="r" reflectance=".6" rgba=".3 .4 .5 1"/>',
    ),
    "the back of a plane": (
        LAMP + '<geom type="sphere" size=".5" pos="1.4 0 1"/><geom type="plane" size="1 1 1" '
        'pos=".4 0 1" euler="0 80 0" material="m"/>',
        FLAT + material(),
    ),
    "a height field": (
        LAMP + '<geom type="hfield" hfield="h" rgba=".7 .6 .5 1"/>',
        FIELD,
    ),
    "textures of meshes and height fields": (
        LAMP + '<geom type="mesh" mesh="star" pos="-.6 .5 1" euler="20 40 10" material="m"/>'
        '<geom type="hfield" hfield="h" pos=".4 0 .3" material="m"/>',
        FLAT + material('texrepeat="2 3"') + STAR + FIELD,
    ),
    "uniform textures of meshes": (
        LAMP + '<geom type="mesh" mesh="star" pos="-.6 .5 1" euler="20 40 10" material="m"/>'
        '<geom type="hfield" hfield="h" pos=".4 0 .3" material="m"/>',
        FLAT + material('texrepeat="2 3" texuniform="true"') + STAR + FIELD,
    ),
    "cubes on meshes": (
        LAMP + '<geom type="mesh" mesh="star" pos="-.6 .5 1" euler="20 40 10" material="m"/>'
        '<geom type="hfield" hfield="h" pos=".4 0 .3" material="m"/>',
        CUBE + material('texuniform="true"') + STAR + FIELD,
    ),
    "a mesh": (
        LAMP + '<geom type="mesh" mesh="k" pos="0 0 .7" rgba=".7 .6 .5 1"/>',
        '<mesh name="k" vertex="0 0 0 1 0 0 0 1 0 0 0 1 .6 .6 .7"/>',
    ),
}  # fmt: skip


def built(name):
    geoms, assets = MODELS[name]
    head = '<visual><headlight ambient=".2 .2 .2" diffuse="0 0 0" specular="0 0 0"/></visual>'
    head = head if name != "no light" else '<visual><headlight active="0"/></visual>'
    spec = import_mujoco().MjSpec.from_string(
        f"<mujoco>{head}<asset>{assets}</asset><worldbody>{geoms}</worldbody></mujoco>"
    )
    texture = spec.texture("t")
    if texture is not None:
        pixels = SMOOTH if 'type="2d"' in assets else np.concatenate([SMOOTH] * 6)
        pixels = pixels if 'type="2d"' in assets else np.roll(pixels, 37, axis=0)
        if "opacity" in name:
            pixels = np.dstack([pixels, SMOOTH[::-1, :, 0]])
        if "one channel" in name:
            pixels = pixels[..., :1]
        texture.height, texture.width, texture.nchannel = pixels.shape
        texture.data = np.ascontiguousarray(pixels).tobytes()
    return spec


def seen(name, camera=PINHOLE, **settings):
    rig = Rig("one", (camera,), (np.eye(4),), ("left",))
    return apart(built(name), rig, POSE, depth_range_m=RANGE_M, **settings)


def check(found):
    """What the plug-in's page promises of pixels that show no edge."""
    assert np.median(found.light) < 1
    assert np.percentile(found.light, 99) < 4
    assert np.percentile(found.depth, 99) < 1e-5


@pytest.mark.parametrize("name", MODELS)
def test_a_model_looks_as_mujoco_draws_it(name):
    found = seen(name, floats=True, border_px=3)
    assert found.light.size > 4000
    check(found)
    assert found.signs < 1e-3
    assert found.edges < 3e-3


@pytest.mark.parametrize("settings", [{"border_px": 4}, {}])
def test_it_does_so_through_a_lens(settings):
    # Between samples MuJoCo's light is blurred: the more there are, the less.
    found = seen("flat textures", LENS, supersample=6, **settings)
    check(found)
    assert found.edges < 5e-3


EDGE = """
<asset><material name="white" emission="1" specular="0"/></asset>
<visual><headlight active="0"/></visual>
<worldbody><body euler="2 0 0">
<geom type="box" size=".1 4 2" pos=".1 0 2" material="white"/>
<geom type="box" size=".1 4 2" pos=".1 0 -2" rgba="0 0 0 1"/>
</body></worldbody>
"""


def test_an_almost_level_edge_lies_where_the_lens_puts_it():
    """Between a white and a black box, by projection, in parts of the middle of a lens."""
    lens = Camera(173, 130, 112.9, 113.1, 86.2, 65.4, "radtan", (-0.1, 0.03, 0, 0))
    rig = Rig("one", (lens,), (np.eye(4),), ("left",))
    spec = import_mujoco().MjSpec.from_string(f"<mujoco>{EDGE}</mujoco>")
    along_m = np.linspace(1, -1, 401)[:, None] * (0, np.cos(np.radians(2)), np.sin(np.radians(2)))
    columns, off_px = np.arange(66, 107), []
    with RasterRenderer(spec, rig, 8, depth_range_m=RANGE_M, border_px=14) as drawn:
        for z_m in np.linspace(-0.08, 0.08, 24):
            T_world_cam = look_at((-1.2, 0, z_m), (1, 0, z_m))
            light = drawn.frame(0, T_world_cam).intensity[:, columns]
            edge_px = lens.project((along_m - T_world_cam[:3, 3]) @ T_world_cam[:3, :3])
            # White is above: the light of a column ends at its edge.
            off_px.append(light.sum(0) - 0.5 - np.interp(columns, *edge_px.T))
    assert np.abs(off_px).max() < 0.2
    assert np.abs(np.reshape(off_px, (4, -1)).mean(1)).max() < 0.01


FAR_BALLS = """
<asset><material name="white" specular="0"/></asset>
<visual><headlight active="0"/></visual>
<worldbody><light directional="true" dir="0.2 1 0.1" diffuse="1 1 1"/>
<replicate count="9" offset="0 .7 0" euler="0 0 0">
<geom type="sphere" size=".25" pos="1 -2.8 0" material="white"/>
</replicate></worldbody>
"""


def test_no_place_of_a_body_of_small_triangles_is_darker_than_black():
    """From afar a triangle is smaller than the way from a sample to that of a sub-view."""
    rig = Rig("one", (LENS,), (np.eye(4),), ("left",))
    spec = import_mujoco().MjSpec.from_string(f"<mujoco>{FAR_BALLS}</mujoco>")
    with RasterRenderer(spec, rig, 4, depth_range_m=RANGE_M, border_px=2) as drawn:
        for x_m in (-1.0, -4.0, -12.0):
            light = drawn.frame(0, look_at((x_m, 0, 0.3), (1, 0, 0))).samples.light
            assert light.min() >= 0
            assert 0.5 < light.max() <= 1


@pytest.mark.parametrize("floats", [False, True])
def test_light_ends_at_one_only_without_floats(floats):
    white = SHAPES.replace('material="m"', 'rgba="1 1 1 1"')
    bright = made.spec('<light diffuse="3 3 3" pos="0 0 5"/>' + white)
    rig = Rig("one", (PINHOLE,), (np.eye(4),), ("left",))
    check(apart(bright, rig, POSE, depth_range_m=RANGE_M, floats=floats))
