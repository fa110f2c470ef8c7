"""What the simulator asks of a renderer; `sim.rendering.renderer` is MuJoCo's.

Another renderer is one module with a `Renderer` and the `Drawing` that opens it, and is handed to
`simulate(..., drawing=...)`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.tables import Geom
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig

if TYPE_CHECKING:
    from eventsweep.sim.scene import Scene

Pose = NDArray[np.float64]


class Samples(NamedTuple):
    """The samples of a fine frame: S per pixel and axis, and B pixels beyond the sensor's edge.

    Attributes:
        light: (S (H + 2 B), S (W + 2 B)) float32, linear.
        inverse_depth_per_m: of the same shape, float32, 1/z; 0 where there is no surface.
    """

    light: NDArray[np.float32]
    inverse_depth_per_m: NDArray[np.float32]


class Frame(NamedTuple):
    """One supersampled picture.

    Attributes:
        intensity: (H, W) float32, linear, 0 to 1; may exceed 1 where light is drawn as floats.
        nearest_depth_m: (H, W) float32, the least z-depth of each pixel's samples; inf where no
            sample meets a surface.
        samples: of a fine frame, what its pixels are means of, and more around them.
    """

    intensity: NDArray[np.float32]
    nearest_depth_m: NDArray[np.float32]
    samples: Samples | None = None


class Views(Protocol):
    """Draws views of a scene with still bodies: all that choosing the times of frames needs."""

    @property
    def rig(self) -> Rig:
        """The cameras and their places on the body."""

    def at(self, t_s: float) -> None:
        """Puts the bodies that move by themselves where they are at `t_s`, s from the start."""

    def frame(self, camera: int, T_world_body: Pose) -> Frame:
        """Light and nearest depth that `camera` sees from `T_world_body` (4, 4)."""


class Renderer(Views, AbstractContextManager[Any], Protocol):
    """Draws a scene for a rig; belongs to the thread that opened it.

    Geoms are what surfaces belong to; their ids are 0, 1, ..., and all pictures use the same.
    """

    @property
    def description(self) -> str:
        """What renders, for a sequence's manifest."""

    @property
    def geoms(self) -> Mapping[int, Geom]:
        """All geoms by id: their names, and which move by themselves."""

    def glance(self, camera: int, T_world_body: Pose) -> Frame:
        """Light and depth at little cost: one sample per pixel, a lens taken for a pinhole."""

    def depth(
        self,
        camera: int,
        T_world_body: Pose,
        view: Camera | None = None,
        *,
        border: bool = False,
    ) -> NDArray[np.float32]:
        """Z-depth (H, W) at pixels' centres, m, of a camera or another view from its place.

        With `border`, (H + 2 B, W + 2 B) of a fine frame.
        """

    def segmentation(
        self, camera: int, T_world_body: Pose, *, border: bool = False
    ) -> NDArray[np.int32]:
        """Geom id (H, W) at pixels' centres, -1 where there is none; with a fine frame's border."""

    def T_world_geoms(self, t_s: float) -> Pose:
        """(G, 4, 4) poses of all geoms at a time; only asked for where bodies move."""

    def near_first(self, T_world_body: Pose) -> None:
        """Surfaces may be drawn in order of their distance from here, to save time."""

    def enclosing(self, point_m: Pose) -> str | None:
        """The name of what a point (3,) lies inside at the start, where no camera may be."""

    def identity(self, duration_s: float) -> Sequence[NDArray[Any]]:
        """Arrays that differ where pictures would: geometry, textures, motion of bodies."""


class Drawing(Protocol):
    """Opens renderers; goes to worker processes as it is."""

    def why_plain(self, scene: Scene) -> str:
        """Why light cannot be carried along the scene's surfaces; empty where it can."""

    def open(
        self, scene: Scene, rig: Rig, supersample: int, *, floats: bool, border_px: int | None
    ) -> Renderer:
        """Opens a renderer for the calling thread.

        Args:
            scene: what to draw.
            rig: cameras.
            supersample: samples per pixel and axis.
            floats: whether light may exceed 1.
            border_px: makes fine frames, with so many pixels beyond the sensor's edge.

        Raises:
            InputError: what cannot be drawn.
        """


def finer(drawing: Drawing) -> float:
    """How many times as many samples as MuJoCo's renderer a cheaper one draws by default.

    It says so by an attribute of this name; one without it draws as many.
    """
    return float(getattr(drawing, "finer", 1.0))


def moving_ids(renderer: Renderer) -> NDArray[np.bool_]:
    """(G + 1,) whether a geom can move by itself; the last, id -1, is none."""
    return np.array([geom.dynamic for geom in renderer.geoms.values()] + [False])
