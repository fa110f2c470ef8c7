"""Textures: bounds, determinism, energy at every scale, and the way that pictures fold."""

import cv2
import numpy as np
import pytest

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.scenes import textures as tx
from eventsweep.scenes.textures import facades, objects, outdoor
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.scene import put_texture
from tiers import often

PALE = ((0.3, 0.3, 0.3), (0.9, 0.9, 0.85))
MAKERS = {
    "ball": lambda rng: tx.ball(256, rng, (PALE[0], PALE[1], (0.7, 0.2, 0.2))),
    "book": lambda rng: tx.book(256, rng, (0.5, 0.2, 0.2), (0.9, 0.8, 0.5)),
    "bricks": lambda rng: tx.bricks((512, 512), rng),
    "can": lambda rng: tx.can(256, rng, (0.7, 0.4, 0.2)),
    "carton": lambda rng: tx.carton(384, rng, (0.2, 0.4, 0.6)),
    "cloth": lambda rng: tx.cloth((512, 512), rng, PALE),
    "cork": lambda rng: tx.cork((512, 512), rng),
    "crate": lambda rng: tx.crate(384, rng),
    "dead_leaves": lambda rng: tx.finish(tx.dead_leaves((512, 512), rng)),
    "drum": lambda rng: tx.drum(256, rng, (0.2, 0.4, 0.6)),
    "fractal": lambda rng: tx.finish(tx.fractal((512, 512), rng)),
    "keyboard": lambda rng: tx.keyboard((330, 1024), rng),
    "label": lambda rng: tx.label((256, 256), rng, (0.2, 0.4, 0.6)),
    "page": lambda rng: tx.page((768, 512), rng),
    "plaster": lambda rng: tx.plaster((512, 512), rng, PALE),
    "poster": lambda rng: tx.poster((768, 512), rng, (0.2, 0.3, 0.5), (0.9, 0.5, 0.2)),
    "screen": lambda rng: tx.screen((720, 1280), rng),
    "solid": lambda rng: tx.solid(256, rng, *PALE),
    "tiles": lambda rng: tx.tiles((512, 512), rng),
    "toy_block": lambda rng: tx.toy_block(256, rng, (0.7, 0.2, 0.2)),
    "wood": lambda rng: tx.wood((512, 512), rng, planks=4),
}
OUTDOORS = {
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
MAKERS |= OUTDOORS
SEAMLESS = ("bricks", "cloth", "fractal", "plaster", "tiles", "asphalt", "grass", "hedge")
FEW = ("asphalt", "facade", "book", "bricks", "dead_leaves", "fractal", "screen", "wood")


def octave_energy(pixels, octaves=4):
    """RMS (grey levels) of the detail between 2**k and 2**(k + 1) texels, for each octave k."""
    level = pixels.astype(np.float32).mean(axis=2)
    energy = []
    for _ in range(octaves):
        coarse = cv2.pyrDown(level)
        energy.append(float((level - cv2.pyrUp(coarse, dstsize=level.shape[::-1])).std()))
        level = coarse
    return np.array(energy)


@pytest.mark.parametrize("name", often(FEW, MAKERS))
def test_texture_keeps_its_bounds_and_has_detail_at_every_scale(name):
    pixels = MAKERS[name](np.random.default_rng(5))
    assert pixels.dtype == np.uint8
    assert pixels.shape[2] == 3
    assert pixels.min() >= tx.DARKEST
    assert pixels.max() <= tx.BRIGHTEST
    assert pixels.std() > 3
    assert np.isfinite(octave_energy(pixels)).all()
    assert name in OUTDOORS or (octave_energy(pixels) > 1.0).all()


@pytest.mark.parametrize("name", often(FEW, MAKERS))
def test_texture_depends_on_the_generator_and_on_nothing_else(name):
    first, again, other = (MAKERS[name](np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    "name", ["bricks", "cloth", "fractal", "plaster", "tiles", "asphalt", "grass", "hedge"]
)
def test_tiling_texture_has_no_seam(name):
    grey = MAKERS[name](np.random.default_rng(7)).astype(float).mean(axis=2)
    for axis in (0, 1):
        steps = np.abs(np.diff(grey, axis=axis)).mean(axis=1 - axis)
        seam = np.abs(np.take(grey, 0, axis) - np.take(grey, -1, axis)).mean()
        assert seam <= 1.2 * steps.max()


def test_the_sky_has_no_seam_between_its_faces():
    """It is a function of the direction: neighbouring faces agree along their common edge."""
    east, west, up, _, south, north = outdoor.sky(64, tx.streams(3, 1)[0]).reshape(6, 64, 64, 3)
    assert np.abs(south[:, -1].astype(int) - east[:, 0]).max() <= 2
    assert np.abs(east[:, -1].astype(int) - north[:, 0]).max() <= 2
    assert np.abs(north[:, -1].astype(int) - west[:, 0]).max() <= 2
    assert np.abs(up[-1].astype(int) - south[0]).max() <= 2


def test_fractal_energy_falls_as_its_slope_says():
    amplitude = np.abs(np.fft.fft2(tx.fractal((512, 512), np.random.default_rng(3), 1.0)))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(512), np.fft.fftfreq(512))) * 512
    low, high = (
        amplitude[(frequency > f / 1.1) & (frequency < f * 1.1)].mean() for f in (16.0, 128.0)
    )
    assert low / high == pytest.approx(8.0, rel=0.1)


def test_streams_are_independent_of_their_number():
    few, many = tx.streams(4, 2), tx.streams(4, 9)
    assert few[1].random() == many[1].random()
    assert many[2].random() != many[3].random()


def test_wrapped_picture_shows_its_middle_in_front_and_its_seam_behind():
    side = np.zeros((64, 256, 3), np.uint8)
    side[:, :, 0] = np.arange(256)
    side[:, :, 1] = 3 * np.arange(64)[:, None]
    lid = np.full((33, 33, 3), 222, np.uint8)
    right, left, back, front, top, bottom = tx.wrap(side, lid).reshape(6, 33, 33, 3).astype(int)
    assert abs(front[16, 16, 0] - 127) <= 2
    assert abs(np.rot90(right, -1)[16, 16, 0] - 191) <= 2
    assert abs(np.rot90(left)[16, 16, 0] - 64) <= 2
    assert np.rot90(back, 2)[16, 13, 0] > 240
    assert np.rot90(back, 2)[16, 19, 0] < 15
    assert front[2, 16, 1] < 20 < 150 < front[30, 16, 1]
    assert (top[16, 16] == 222).all()
    assert (bottom[16, 16] == 222).all()


VIEWS = {
    "front": ((0, -3, 0), (0, 0, 1)), "right": ((3, 0, 0), (0, 0, 1)),
    "back": ((0, 3, 0), (0, 0, 1)), "left": ((-3, 0, 0), (0, 0, 1)), "top": ((0, 0, 3), (0, 1, 0)),
}  # fmt: skip


def test_cube_map_faces_look_upright_from_outside():
    sides = ("front", "right", "back", "left", "top", "bottom")
    faces = {}
    for k, side in enumerate(sides):
        faces[side] = np.full((64, 64, 3), 40 + 15 * k, np.uint8)
        faces[side][8:24, 8:24] = 200  # a mark, upper left
    mujoco = import_mujoco()
    spec = mujoco.MjSpec.from_string(
        """<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
        <asset><texture name="t" type="cube" builtin="flat" width="2" height="12"/>
        <material name="m" texture="t" specular="0"/></asset>
        <worldbody><geom type="box" size=".5 .5 .5" material="m"/></worldbody></mujoco>"""
    )
    put_texture(spec, "t", tx.cube(**faces))
    camera = Camera(81, 81, 200.0, 200.0, 40.0, 40.0)
    with StereoRenderer(spec, Rig("one", (camera,), (np.eye(4),), ("left",))) as renderer:
        for k, side in enumerate(sides[:5]):
            eye, up = VIEWS[side]
            seen = 255 * renderer.frame(0, look_at(eye, (0, 0, 0), up)).intensity
            assert seen[60, 60] == pytest.approx(40 + 15 * k, abs=2), side
            assert seen[20, 20] == pytest.approx(200, abs=2), side
            assert seen[20, 60] == pytest.approx(40 + 15 * k, abs=2), side
