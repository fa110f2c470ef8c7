"""One pinhole picture of a scene: what its samples see, and in which light."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.plugins.raster.lens_kernels import shade_lens
from eventsweep.plugins.raster.shading_kernels import add_where, glaze, planes, shade
from eventsweep.plugins.raster.surfaces import SOLID, Surfaces
from eventsweep.plugins.raster.visibility_kernels import visible
from eventsweep.sim.rendering.base import Samples
from eventsweep.sim.rendering.lens import edges
from eventsweep.sim.rendering.pixel_kernels import sample_offsets
from eventsweep.sim.rendering.sub_views import LensMap

Array = NDArray[np.float64]
# Balls around geoms are taken larger by a share of their radius and distance, for rounding.
_MARGIN = 1e-6
# Opacity of the back of a plane, as a share of its front's.
BACK = 0.3
_EVERYWHERE, _AT_ONCE = np.zeros(4), np.empty((0, 0), np.int32)


class Grid(NamedTuple):
    """Where a picture's samples lie.

    Attributes:
        camera: a pinhole, in pixels.
        samples: per pixel and axis.
        stride: rows that lie beside one another, see `fine_light.FineView.stride`.
        upside_down: whether the bottom row comes first.
        corner: column and row of the first sample.
    """

    camera: Camera
    samples: int = 1
    stride: int = 1
    upside_down: bool = False
    corner: tuple[int, int] = (0, 0)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of samples."""
        return self.samples * self.camera.height_px, self.samples * self.camera.width_px

    @property
    def intrinsics(self) -> Array:
        """(4,) fx, fy, cx, cy in samples; upside down fy is negative."""
        camera, n, (rows, _) = self.camera, self.samples, self.shape
        c_x, c_y = (n * (c + 0.5) - 0.5 for c in (camera.cx_px, camera.cy_px))
        f_y = n * camera.fy_px
        if self.upside_down:
            f_y, c_y = -f_y, rows - 1 - c_y
        return np.array([n * camera.fx_px, f_y, c_x + self.corner[0], c_y + self.corner[1]])

    @property
    def view(self) -> NDArray[np.int64]:
        """(4,) first and last column, first and last row."""
        (rows, columns), (left, top) = self.shape, self.corner
        return np.array([left, left + columns - 1, top, top + rows - 1])


class Buffers:
    """What pictures are drawn into, and memory for what they see; as large as the largest was."""

    def __init__(self, triangles: int) -> None:
        self._ids, self._triangles = np.empty(0, np.int32), triangles
        self.edges, self.rho = np.empty((0, 3, 3)), np.empty((0, 3))
        self.light, self.places = np.empty((0, 3, 3)), np.empty((0, 3, 3))
        self.corner_light = np.empty((0, 3, 3))
        self.source = np.empty(0, np.int64)
        self.reserve(0)

    def reserve(self, made: int) -> None:
        """Makes room for all triangles, and the sky, after so many."""
        count = made + self._triangles + 1
        if len(self.source) < count:
            for name in ("edges", "source", "rho", "corner_light", "light", "places"):
                before = getattr(self, name)
                grown = np.empty((count + made // 2, *before.shape[1:]), before.dtype)
                grown[:made] = before[:made]
                setattr(self, name, grown)

    def ids(self, shape: tuple[int, int]) -> NDArray[np.int32]:
        """(H, W) for numbers of triangles."""
        size = shape[0] * shape[1]
        if self._ids.size < size:
            self._ids = np.empty(size, np.int32)
        return self._ids[:size].reshape(shape)


class Drawn(NamedTuple):
    """A picture of which every sample's triangle is known.

    Attributes:
        grid: where its samples lie.
        T_world_view: (4, 4) from where it is seen.
        clip_m: nearest and farthest depth.
        scale: `nearness` is scale[0] / z - scale[1].
        nearness: (H, W), 0 where nothing is.
        ids: (H, W) numbers of the triangles seen, -1 for none.
        made: how many triangles there are.
    """

    grid: Grid
    T_world_view: Array
    clip_m: tuple[float, float]
    scale: tuple[float, float]
    nearness: NDArray[np.float32]
    ids: NDArray[np.int32]
    made: int


class Look(NamedTuple):
    """How a picture is lit.

    Attributes:
        T_world_lamp: (4, 4) where the headlight is.
        bias: below 0 it makes textures sharper.
        share: what a mirror leaves of colours.
    """

    T_world_lamp: Array
    bias: float
    share: float = 1.0


class Painter:
    """Draws pictures of surfaces, one after the other."""

    def __init__(self, surfaces: Surfaces) -> None:
        self._surfaces, self._buffers = surfaces, Buffers(len(surfaces.corners))
        self._order = np.arange(len(surfaces.geoms.ids))
        geoms = surfaces.geoms
        # The sky is one geom more.
        self._texture = np.append(geoms.texture, surfaces.sky)
        self._channels = np.append(geoms.channels, 1)
        self._owner = np.append(surfaces.owner, len(geoms.ids))

    def near_first(self, eye_m: Array) -> None:
        """Draws geoms in the order of their distance from an eye (3,), m, until further notice."""
        geoms, poses = self._surfaces.geoms, self._surfaces.poses
        local = np.einsum("gji,gj->gi", poses[:, :, :3], eye_m - poses[:, :, 3])
        away = np.abs(local - geoms.middle)
        nearest = np.sqrt((np.maximum(away - geoms.half, 0) ** 2).sum(1))
        farthest = np.sqrt(((away + geoms.half) ** 2).sum(1))
        distance_m = np.where(np.isfinite(geoms.radius_m), (nearest + farthest) / 2, np.inf)
        self._order = np.argsort(distance_m, kind="stable")

    def draw(
        self, grid: Grid, T_world_view: Array, clip_m: tuple[float, float],
        nearness: NDArray[np.float32], scale: tuple[float, float] = (1.0, 0.0), *,
        glass: bool = False,
    ) -> Drawn:  # fmt: skip
        """Fills `nearness`, which is 0 where nothing was drawn; with `glass` as if that were solid.

        The numbers of triangles hold until the next picture is drawn.
        """
        ids, view = self._buffers.ids(nearness.shape), grid.view
        ids[view[2] : view[3] + 1, view[0] : view[1] + 1] = -1
        order = self._seen(grid.camera, T_world_view)
        if not glass:
            order = order[self._opacity(T_world_view[:3, 3])[order] >= SOLID]
        drawn = Drawn(grid, T_world_view, clip_m, scale, nearness, ids, 0)
        return drawn._replace(made=self._visible(drawn, order, view, T_world_view[:3, 3]))

    def paint(self, drawn: Drawn, look: Look, light: NDArray[np.float32]) -> None:
        """Fills `light` of the picture drawn last."""
        self._shade(drawn, look, light, sky=True)
        if self._surfaces.mirror >= 0:
            self._reflect(drawn, look, light)
        seen = self._seen(drawn.grid.camera, drawn.T_world_view)
        self._glaze(drawn, drawn.T_world_view[:3, 3], seen, look, light)

    def _visible(
        self, drawn: Drawn, order: NDArray[np.int64], view: NDArray[np.int64], eye_m: Array,
        side: Array = _EVERYWHERE, after: NDArray[np.int32] = _AT_ONCE,
    ) -> int:  # fmt: skip
        """Draws geoms; in a mirror only those on its `side`, and of these the backs are fronts."""
        surfaces, memory, grid = self._surfaces, self._buffers, drawn.grid
        return int(
            visible(
                surfaces.corners, surfaces.geoms.first, order,
                surfaces.behind(eye_m) ^ bool(side.any()), se3.inverse(drawn.T_world_view),
                grid.intrinsics, grid.stride, view, np.array(drawn.clip_m), side,
                np.array(drawn.scale), after,
                drawn.nearness, drawn.ids, memory.edges, memory.source, drawn.made,
            )
        )  # fmt: skip

    def _shade(
        self, drawn: Drawn, look: Look, light: NDArray[np.float32], *, sky: bool = False
    ) -> None:
        memory, count, nothing = self._buffers, drawn.made, -1
        self._light(0, drawn.made, drawn.T_world_view[:3, 3], look)
        if sky and self._surfaces.sky >= 0:
            nothing = self._sky(drawn.made, drawn.grid, drawn.T_world_view)
            count += 1
        owner = self._owner[memory.source[:count]]
        shade(
            drawn.ids, owner, self._texture, self._channels, memory.rho, memory.light,
            memory.places, *self._surfaces.texels, drawn.grid.stride, drawn.grid.view, look.bias,
            nothing, light,
        )  # fmt: skip

    def _light(self, first: int, made: int, eye_m: Array, look: Look) -> None:
        """Prepares triangles seen from an eye (3,), m: most of a scene's are not, nor are lit."""
        surfaces, memory, its = self._surfaces, self._buffers, slice(first, made)
        surfaces.shine(
            memory.source[its], eye_m, look.T_world_lamp, look.share, memory.corner_light[its]
        )
        planes(
            first, made, memory.edges, memory.source, memory.corner_light, surfaces.places,
            memory.rho, memory.light, memory.places,
        )  # fmt: skip

    def _reflect(self, drawn: Drawn, look: Look, light: NDArray[np.float32]) -> None:
        """Adds what the mirror shows: the scene on its side, seen by an eye behind it."""
        surfaces, memory, eye_m = self._surfaces, self._buffers, drawn.T_world_view[:3, 3]
        normal, distance_m = surfaces.mirror_plane()
        if normal @ eye_m < distance_m:
            return
        wanted = surfaces.of_mirror(memory.source[: drawn.made])
        turn = np.eye(4)
        turn[:3, :3] -= 2 * np.outer(normal, normal)
        turn[:3, 3] = 2 * distance_m * normal
        ids = np.full_like(drawn.ids, -1)
        other = Drawn(
            drawn.grid, turn @ drawn.T_world_view, drawn.clip_m, drawn.scale,
            np.zeros_like(drawn.nearness), ids, 0,
        )  # fmt: skip
        others = self._seen(drawn.grid.camera, other.T_world_view)
        others = others[others != surfaces.mirror]
        side = np.append(normal @ other.T_world_view[:3, :3], 0.0)
        side[3] = normal @ other.T_world_view[:3, 3] - distance_m
        order = others[self._opacity(eye_m)[others] >= SOLID]
        other = other._replace(made=self._visible(other, order, drawn.grid.view, eye_m, side))
        its, dimmed = np.empty_like(light), look._replace(share=surfaces.reflectance)
        self._shade(other, dimmed, its)
        self._glaze(other, eye_m, others, dimmed, its, side)
        add_where(drawn.ids, wanted, its, drawn.grid.view, light)

    def _glaze(
        self, drawn: Drawn, eye_m: Array, geoms: NDArray[np.int64], look: Look,
        light: NDArray[np.float32], side: Array = _EVERYWHERE,
    ) -> None:  # fmt: skip
        """Puts the light of those geoms that are not solid over that of what is drawn."""
        opacity = self._opacity(eye_m)
        there = [g for g in self._near_to_far(eye_m, opacity) if g in geoms]
        # As MuJoCo does: from near to far, and back.
        for g in (*there, *there[::-1]):
            for over in self._faces(drawn, g, eye_m, side):
                its, share = np.empty_like(light), np.full_like(light, opacity[g])
                self._shade(over, look, its)
                if self._surfaces.geoms.cover[g] >= 0:
                    self._shade_cover(over, g, look.bias, share)
                glaze(over.ids, over.nearness, drawn.nearness, its, share, drawn.grid.view, light)

    def _faces(self, drawn: Drawn, g: int, eye_m: Array, side: Array) -> Iterator[Drawn]:
        """One geom alone; its faces one after the other, as they lie in it, where several show."""
        after, folded = _AT_ONCE, self._surfaces.geoms.folded[g]
        if folded:
            after = np.full_like(drawn.ids, -1)
        while True:
            ids = np.full_like(drawn.ids, -1)
            over = drawn._replace(nearness=np.zeros_like(drawn.nearness), ids=ids, made=0)
            made = self._visible(over, np.array([g]), drawn.grid.view, eye_m, side, after)
            if folded and not (ids >= 0).any():
                return
            yield over._replace(made=made)
            if not folded:
                return
            after = np.where(ids >= 0, ids, made).astype(np.int32)

    def _shade_cover(self, drawn: Drawn, g: int, bias: float, share: NDArray[np.float32]) -> None:
        """Multiplies `share` by the opacity of a geom's texture."""
        surfaces, memory, made = self._surfaces, self._buffers, drawn.made
        planes(
            0, made, memory.edges, memory.source, np.ones((made, 3, 3)), surfaces.places,
            memory.rho, memory.light, memory.places,
        )  # fmt: skip
        cover, one = np.full_like(self._texture, surfaces.geoms.cover[g]), self._channels * 0 + 1
        its = np.empty_like(share)
        shade(
            drawn.ids, self._owner[memory.source[:made]], cover, one, memory.rho, memory.light,
            memory.places, *surfaces.texels, drawn.grid.stride, drawn.grid.view, bias, -1, its,
        )  # fmt: skip
        share *= its

    def _opacity(self, eye_m: Array) -> Array:
        """(G,) of geoms; the backs of planes are seen through."""
        surfaces = self._surfaces
        behind = np.where(surfaces.behind(eye_m), BACK, 1.0)
        return np.asarray(surfaces.geoms.colours[:, 3] * behind)

    def _near_to_far(self, eye_m: Array, opacity: Array) -> list[int]:
        """Geoms that are not solid, sorted as MuJoCo sorts them: planes come last."""
        surfaces = self._surfaces
        apart_m = np.sqrt(((surfaces.poses[:, :, 3] - eye_m) ** 2).sum(1))
        far = np.where(surfaces.planes, 1e10, apart_m - surfaces.reach_m)
        clear = np.flatnonzero(opacity < SOLID)
        found: list[int] = clear[np.argsort(far[clear], kind="stable")].tolist()
        return found

    def all_solid(self, eye_m: Array) -> bool:
        """Whether an eye (3,), m, sees neither glass nor the back of a plane nor a mirror."""
        return self._surfaces.mirror < 0 and bool((self._opacity(eye_m) >= SOLID).all())

    def through_lens(
        self, lens: LensMap, parts: list[tuple[Grid, Array]], clip_m: tuple[float, float],
        look: Look, samples: Samples,
    ) -> None:  # fmt: skip
        """Fills the samples of a sensor behind a lens, from which all is solid.

        Args:
            lens: where its pixels lie in the sub-views.
            parts: these, and their poses.
            clip_m: nearest and farthest depth.
            look: how they are lit.
            samples: out.
        """
        surfaces, memory, made = self._surfaces, self._buffers, 0
        ids, nearness = memory.ids(lens.shape), np.zeros(lens.shape, np.float32)
        ids[:] = -1
        for grid, T_world_view in parts:
            memory.reserve(made)
            first = made
            if surfaces.sky >= 0:
                left, right, top, bottom = grid.view
                ids[top : bottom + 1, left : right + 1] = self._sky(made, grid, T_world_view)
                first = made = made + 1
            drawn = Drawn(grid, T_world_view, clip_m, (1.0, 0.0), nearness, ids, made)
            made = self._visible(
                drawn, self._seen(grid.camera, T_world_view), grid.view, T_world_view[:3, 3]
            )
            self._light(first, made, parts[0][1][:3, 3], look)
        owner = self._owner[memory.source[:made]]
        number = samples.light.shape[0] // len(lens.position)
        shade_lens(
            ids, owner, self._texture, self._channels, memory.rho, memory.light, memory.places,
            *surfaces.texels, look.bias, owner < len(surfaces.geoms.ids), lens.position, lens.step,
            lens.ratio, sample_offsets(number), 1 if number % 2 else 2, parts[0][0].stride,
            *samples,
        )  # fmt: skip

    def geom_ids(self, drawn: Drawn) -> NDArray[np.int32]:
        """Geoms of the model that samples of the picture drawn last see; -1 for none."""
        surfaces = self._surfaces
        owner = surfaces.owner[self._buffers.source[: drawn.made]]
        known = np.append(surfaces.geoms.ids[owner], -1).astype(np.int32)
        left, right, top, bottom = drawn.grid.view
        found: NDArray[np.int32] = known[drawn.ids[top : bottom + 1, left : right + 1]]
        return found

    def _sky(self, number: int, grid: Grid, T_world_view: Array) -> int:
        """Makes the sky a triangle of that number: its texture lies in the samples' directions."""
        f_x, f_y, c_x, c_y = grid.intrinsics
        turn, memory = T_world_view[:3, :3], self._buffers
        direction = np.column_stack([turn[:, 0] / f_x, turn[:, 1] / f_y, turn[:, 2]])
        direction[:, 2] -= direction[:, 0] * c_x + direction[:, 1] * c_y
        memory.rho[number] = memory.light[number] = 0, 0, 1
        memory.source[number] = len(self._surfaces.corners)
        memory.places[number] = direction[[0, 2, 1]] * [[1], [1], [-1]]
        return number

    def _seen(self, camera: Camera, T_world_view: Array) -> NDArray[np.int64]:
        """The geoms that reach into a pinhole view, in order."""
        left, right, top, bottom = edges(camera)
        inwards = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
        inwards /= np.sqrt((inwards**2).sum(1, keepdims=True))
        geoms, poses = self._surfaces.geoms, self._surfaces.poses
        middle_m = np.einsum("gij,gj->gi", poses[:, :, :3], geoms.middle) + poses[:, :, 3]
        from_eye = middle_m - T_world_view[:3, 3]
        distance_m = np.sqrt((from_eye**2).sum(1))
        reach_m = geoms.radius_m + _MARGIN * (geoms.radius_m + distance_m)
        inside_m = from_eye @ T_world_view[:3, :3] @ inwards.T
        order: NDArray[np.int64] = self._order[(inside_m.min(1) >= -reach_m)[self._order]]
        return order
