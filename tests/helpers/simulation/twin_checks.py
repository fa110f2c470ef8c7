"""What every twin of a data set must keep: shared by the tests of the indoor and outdoor twins."""

from dataclasses import replace
from functools import cache
from itertools import permutations

import numpy as np

from eventsweep import scenes
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.scenes.textures.noise import BRIGHTEST, DARKEST
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig
from warped_depth import Warped, warped

SMALL = {240: 2.0, 346: 2.5, 640: 5.0, 1280: 8.0}
"""By how much the quick tests shrink a sensor, by its width."""


def factor(name: str) -> float:
    """By how much the quick tests shrink a case's sensors."""
    return SMALL[rig(scenes.load(name).rig).cameras[0].width_px]


def smaller(whole: Rig, factor: float) -> Rig:
    """The same lenses before a sensor of fewer, larger pixels."""
    return replace(whole, cameras=tuple(_smaller(camera, factor) for camera in whole.cameras))


def _smaller(camera: Camera, factor: float) -> Camera:
    # Pixel centres are integers, so the sensor's corner lies at -1/2 in both.
    return replace(
        camera, width_px=round(camera.width_px / factor),
        height_px=round(camera.height_px / factor), fx_px=camera.fx_px / factor,
        fy_px=camera.fy_px / factor, cx_px=(camera.cx_px + 0.5) / factor - 0.5,
        cy_px=(camera.cy_px + 0.5) / factor - 0.5,
    )  # fmt: skip


@cache
def room(mjcf, edit, name):
    """One spec for all cases in the same room; `name` is the first of them."""
    return scenes.load(name).spec()


class OneSize:
    """The cameras of one size of a renderer that has several."""

    def __init__(self, renderer: StereoRenderer, first: int) -> None:
        self.model, self._renderer, self._first = renderer.model, renderer, first

    def depth(self, camera: int, T_world_body):
        return self._renderer.depth(self._first + camera, T_world_body)

    def frame(self, camera: int, T_world_body):
        return self._renderer.frame(self._first + camera, T_world_body)


@cache
def opened(name: str, factor: float):
    """(scene, rig, renderer) of a case at a fraction of its resolution."""
    scene = scenes.load(name)
    first = next(other for other in scenes.names() if _place(other) == _place(scene.name))
    quick = SMALL[rig(scene.rig).cameras[0].width_px]
    factors = (quick, quick / 2) if factor in (quick, quick / 2) else (factor,)
    seen = smaller(rig(scene.rig), factor)
    drawn = _drawn(first, scene.rig, scene.depth_range_m, factors)
    return scene, seen, OneSize(drawn, len(seen) * factors.index(factor))


def _place(name: str):
    scene = scenes.load(name)
    return scene.mjcf, scene.edit


@cache
def _drawn(name: str, rig_name: str, depth_range_m, factors) -> StereoRenderer:
    """One renderer for all cases in a room and all sizes: its many textures are uploaded once."""
    sizes = [smaller(rig(rig_name), factor) for factor in factors]
    cameras = tuple(camera for size in sizes for camera in size.cameras)
    seen = Rig("all sizes", cameras, sizes[0].T_body_cam * len(sizes))
    return StereoRenderer(room(*_place(name), name), seen, 1, depth_range_m)


def poses(name: str, seed: int, count: int):
    """Poses spread over a case's motion."""
    scene = scenes.load(name)
    motion = scene.motion(scene.duration_s, seed)
    return [motion.T_world_body(float(t)) for t in np.linspace(0, scene.duration_s, count)]


def check_original(name, width_px, height_px, baseline_m, depth_range_m):
    """Resolution, baseline to 0.15 mm and depth range are the original's."""
    scene = scenes.load(name)
    seen = rig(scene.rig)
    assert scene.depth_range_m == depth_range_m
    assert all((c.width_px, c.height_px) == (width_px, height_px) for c in seen.cameras)
    assert abs(seen.baseline_m(0, 1) - baseline_m) < 1.5e-4


def check_textures(model):
    """Every texture is there and in bounds, all together are small, and no light rides along."""
    assert not np.any(model.tex_width <= 2)
    assert model.tex_data.size < 60e6
    assert model.tex_data.min() >= DARKEST
    assert model.tex_data.max() <= BRIGHTEST
    assert not np.any(model.vis.headlight.diffuse)


def check_same_every_time(name, parts):
    """A scene made again is the same, bit by bit."""
    model = opened(name, factor(name))[2].model
    again = scenes.load(name).spec().compile()
    for part in parts:
        assert np.array_equal(getattr(model, part), getattr(again, part)), part


def picture(name):
    """A frame of camera 0 in the middle of the motion; neither black nor saturated."""
    _, _, renderer = opened(name, factor(name))
    intensity = renderer.frame(0, poses(name, 0, 3)[1]).intensity
    assert np.mean(intensity > 0.98) < 0.02
    assert np.mean(intensity < 0.04) < 0.01
    return intensity


def stereo(name: str, factor: float, at: int = 0) -> list[Warped]:
    """Every camera's true depth, found again in every other's, at the start, middle or end."""
    _, seen, renderer = opened(name, factor)
    T_world_body = poses(name, 0, 3)[at]
    depths_m = [renderer.depth(camera, T_world_body) for camera in range(len(seen))]
    pairs = permutations(range(len(seen)), 2)
    return [warped(seen, a, b, depths_m[a], depths_m[b]) for a, b in pairs]
