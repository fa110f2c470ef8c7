"""A renderer without graphics: a wall drawn by formula, in MuJoCo's place."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eventsweep.emvs.data.tables import Geom
from eventsweep.sim.motion.curves import HeadSway
from eventsweep.sim.rendering.base import Frame, Samples
from eventsweep.sim.scene import Scene
from painted_planes import Plane, rays_through, seen

WALL_M, SPEED_M_S = 2.0, 2.0


class Wall(AbstractContextManager):
    """The plane z = 2 m with a smooth pattern; every sample is the formula's value there."""

    description, geoms = "a formula", {0: Geom(name="wall", dynamic=False)}

    def __init__(self, rig, supersample, border_px):
        self.rig, self._grid, self._border_px = rig, supersample, border_px

    def __exit__(self, *_raised):
        pass

    def at(self, t_s):
        pass

    def near_first(self, T_world_body):
        pass

    def enclosing(self, point_m):
        return "wall" if point_m[2] > WALL_M else None

    def identity(self, duration_s):
        return [np.array([WALL_M])]

    def T_world_geoms(self, t_s):
        return np.eye(4)[None]

    def frame(self, camera, T_world_body):
        if self._border_px is None:
            return self.glance(camera, T_world_body)
        depth_m = self.depth(camera, T_world_body)
        n, b, (height, width) = self._grid, self._border_px, depth_m.shape
        columns, rows = ((np.arange(n * (s + 2 * b)) + 0.5) / n - b - 0.5 for s in (width, height))
        light = self._light(camera, T_world_body, columns, rows)
        blocks = light.reshape(height + 2 * b, n, width + 2 * b, n).mean((1, 3))
        samples = Samples(light, np.full_like(light, 1 / (WALL_M - T_world_body[2, 3])))
        return Frame(blocks[b : b + height, b : b + width].copy(), depth_m, samples)

    def glance(self, camera, T_world_body):
        depth_m = self.depth(camera, T_world_body)
        columns, rows = map(np.arange, depth_m.shape[::-1])
        return Frame(self._light(camera, T_world_body, columns, rows), depth_m)

    def depth(self, camera, T_world_body, view=None, *, border=False):
        its = view or self.rig.cameras[camera]
        return np.full((its.height_px, its.width_px), WALL_M - T_world_body[2, 3], np.float32)

    def segmentation(self, camera, T_world_body, *, border=False):
        return np.zeros(self.depth(camera, T_world_body).shape, np.int32)

    def _light(self, camera, T_world_body, columns, rows):
        rays = rays_through(self.rig.cameras[camera], columns, rows)
        T_world_cam = T_world_body @ self.rig.T_body_cam[camera]
        return seen(Plane(WALL_M), T_world_cam, 0.0, rays)[0].astype(np.float32)


@dataclass(frozen=True)
class Formula:
    """Opens walls."""

    def why_plain(self, scene):
        return ""

    def open(self, scene, rig, supersample, *, floats, border_px):
        return Wall(rig, supersample, border_px)


def sideways(duration_s, seed):
    return HeadSway(np.eye(4), (), (SPEED_M_S, 0.0, 0.0))


def behind_the_wall(duration_s, seed):
    start = np.eye(4)
    start[2, 3] = 3.0
    return HeadSway(start, (), (0.0, 0.0, 0.0))


SCENE = Scene("wall", "a formula", Path(), dict, sideways, (1.0, 3.0))
