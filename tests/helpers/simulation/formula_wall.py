"""A renderer without graphics: a wall drawn by formula, in MuJoCo's place."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eventsweep.emvs.data.tables import Geom
from eventsweep.emvs.geometry import se3
from eventsweep.sim.motion.curves import HeadSway
from eventsweep.sim.rendering.base import Frame, Samples
from eventsweep.sim.scene import Scene

WALL_M, SPEED_M_S = 2.0, 2.0


def radiance(x_m, y_m):
    return 0.5 + 0.3 * np.sin(9 * x_m) * np.cos(7 * y_m + 1)


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
        depth_m = self.depth(camera, T_world_body)
        samples = self._samples(camera, T_world_body)
        if samples is None:
            return Frame(self._seen(camera, T_world_body, *self._pixels(camera)), depth_m)
        n, b, (height, width) = self._grid, self._border_px, depth_m.shape
        blocks = samples.light.reshape(height + 2 * b, n, width + 2 * b, n).mean((1, 3))
        return Frame(blocks[b : b + height, b : b + width].copy(), depth_m, samples)

    def glance(self, camera, T_world_body):
        return Frame(
            self._seen(camera, T_world_body, *self._pixels(camera)),
            self.depth(camera, T_world_body),
        )

    def depth(self, camera, T_world_body, view=None, *, border=False):
        seen = view or self.rig.cameras[camera]
        return np.full((seen.height_px, seen.width_px), WALL_M - T_world_body[2, 3], np.float32)

    def segmentation(self, camera, T_world_body, *, border=False):
        return np.zeros(self._pixels(camera)[0].shape, np.int32)

    def _pixels(self, camera):
        seen = self.rig.cameras[camera]
        return np.meshgrid(np.arange(seen.width_px), np.arange(seen.height_px))

    def _samples(self, camera, T_world_body):
        if self._border_px is None:
            return None
        seen, b, n = self.rig.cameras[camera], self._border_px, self._grid
        columns, rows = (
            (np.arange(n * (size + 2 * b)) + 0.5) / n - b - 0.5
            for size in (seen.width_px, seen.height_px)
        )
        light = self._seen(camera, T_world_body, *np.meshgrid(columns, rows))
        return Samples(light, np.full_like(light, 1 / (WALL_M - T_world_body[2, 3])))

    def _seen(self, camera, T_world_body, columns, rows):
        bearing = self.rig.cameras[camera].unproject(np.stack([columns, rows], -1).astype(float))
        points = np.concatenate([bearing, np.ones((*bearing.shape[:-1], 1))], -1) * WALL_M
        T_world_cam = T_world_body @ self.rig.T_body_cam[camera]
        at_m = se3.transform(T_world_cam, points.reshape(-1, 3)).reshape(points.shape)
        return radiance(at_m[..., 0], at_m[..., 1]).astype(np.float32)


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
