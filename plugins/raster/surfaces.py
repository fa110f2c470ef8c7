"""What a scene shows, in triangles: where they are, of what material, and what lights them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.plugins.raster import shapes
from eventsweep.plugins.raster.light_kernels import DIRECTED, SPOT, lit
from eventsweep.plugins.raster.textures import FLAT, SKY, Texels, TextureTable
from eventsweep.sim.geoms import moving_geoms
from eventsweep.sim.rendering.pixel_kernels import LUMA

Array = NDArray[np.float64]
_ROLE_RGB = 1  # mjTEXROLE_RGB
# As MuJoCo numbers geoms and lights.
PLANE, FIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH, DISTANCES = range(9)
_SPOT, _DIRECTIONAL = 0, 1
# Ambient light of a scene without any lights.
_WITHOUT_LIGHTS = 0.3
SOLID = 0.995
"""Less opacity lets light through, says MuJoCo."""
# How far a colour of the light may be from what a texture's luma was made for, as luma.
_HUE = 0.01


class Lights(NamedTuple):
    """The lights of a scene.

    Attributes:
        kinds: (L,) of `light_kernels`.
        vectors: (L, 6, 3) place, direction, ambient, diffuse, specular, attenuation.
        cones: (L, 2) exponent, and cosine of the cut-off.
        heads: (L,) whether it moves with the rig.
    """

    kinds: NDArray[np.int64]
    vectors: Array
    cones: Array
    heads: NDArray[np.bool_]


def lights_of(scene: Any) -> Lights:
    """The lights of a `MjvScene`; others than directional ones and spots MuJoCo draws as none."""
    kinds, vectors, cones = [], [], []
    known = {_SPOT: SPOT, _DIRECTIONAL: DIRECTED}
    shining = [light for light in scene.lights[: scene.nlight] if int(light.type) in known]
    for light in shining:
        kinds.append(known[int(light.type)])
        fading = light.attenuation if light.type == _SPOT else (1, 0, 0)
        rows = light.pos, light.dir, light.ambient, light.diffuse, light.specular, fading
        vectors.append([[float(value) for value in row] for row in rows])
        cones.append([float(light.exponent), _cosine(float(light.cutoff))])
    heads = [bool(light.headlight) for light in shining]
    return Lights(
        np.array(kinds, np.int64), np.array(vectors, float).reshape(-1, 6, 3),
        np.array(cones, float).reshape(-1, 2), np.array(heads, bool),
    )  # fmt: skip


def _cosine(angle_deg: float) -> float:
    return -1.0 if angle_deg == 180 else float(np.float32(np.cos(np.radians(angle_deg))))


class Geoms(NamedTuple):
    """The geoms of a `MjvScene` that are drawn, in its order.

    Attributes:
        ids: (G,) of the model.
        first: (G + 1,) the first triangle of each.
        colours: (G, 4) red, green, blue, opacity.
        shine: (G, 3) emission, specular, exponent.
        texture: (G,) channel of `Texels`, -1 for none.
        cover: (G,) channel of the texture's opacity, -1 where it is solid.
        folded: (G,) whether an eye may see several of its faces, one behind the other.
        channels: (G,) 3 where light and texture are multiplied colour by colour, else 1.
        radius_m: (G,) of a ball around `middle`; infinite for planes without end.
        middle: (G, 3) in the geom's axes.
        half: (G, 3) half its size along these, m.
    """

    ids: NDArray[np.int64]
    first: NDArray[np.int64]
    colours: Array
    shine: Array
    texture: NDArray[np.int64]
    cover: NDArray[np.int64]
    folded: NDArray[np.bool_]
    channels: NDArray[np.int64]
    radius_m: Array
    middle: Array
    half: Array


class Surfaces:
    """The triangles of a scene and their light.

    Attributes:
        lights: what shines.
        geoms: what the triangles belong to.
        texels: the textures.
        corners: (T, 3, 3) of the triangles in the world's axes, m.
        owner: (T,) the geom of each triangle.
        places: (T, 3, 3) texture coordinates of the corners.
        sky: channel of the sky's texture; -1 without.
        poses: (G, 3, 4) of geoms in the world's axes.
        planes: (G,) which geoms are planes.
        mirror: the one geom that mirrors; -1 without.
        reflectance: how much it mirrors.
        reach_m: (G,) of geoms from their middle, by which MuJoCo sorts glass.
    """

    def __init__(self, model: Any, scene: Any, *, floats: bool) -> None:
        """Takes what a `MjvScene` shows; `floats` lets light exceed 1."""
        self._model, self._floats = model, floats
        self.lights = lights_of(scene)
        shown = list(scene.geoms[: scene.ngeom])
        parts = [_part(model, geom, coarse=self._even(geom)) for geom in shown]
        counts = [len(part.corners) for part, _, _ in parts]
        self._object_m = np.concatenate([_scaled(*each) for each in parts])
        self._normals = np.concatenate([_leaning(*each) for each in parts])
        self.places = np.concatenate(
            [_places(model, g, part) for g, (part, _, _) in zip(shown, parts, strict=True)]
        )
        self.owner = np.repeat(np.arange(len(shown)), counts)
        table = TextureTable(model)
        self.sky = _sky(model, table)
        self.geoms = self._described(shown, np.concatenate([[0], np.cumsum(counts)]), table)
        self.texels: Texels = table.texels()
        self.poses = np.array([_pose(geom) for geom in shown])
        self.planes = np.array([geom.type == PLANE for geom in shown], bool)
        self.mirror = next((k for k, geom in enumerate(shown) if _mirrors(geom)), -1)
        self.reflectance = float(shown[self.mirror].reflectance) if self.mirror >= 0 else 0.0
        self.reach_m = np.array([_reach_m(geom) for geom in shown], float)
        self._moving = np.flatnonzero(moving_geoms(model)[self.geoms.ids])
        self.corners = np.empty_like(self._object_m)
        self._turned = np.empty_like(self._normals)
        self._put(np.arange(len(shown)))

    def move(self, data: Any) -> None:
        """Puts moving geoms where they are in a state whose kinematics are up to date."""
        ids = self.geoms.ids[self._moving]
        self.poses[self._moving, :, :3] = data.geom_xmat[ids].reshape(-1, 3, 3)
        self.poses[self._moving, :, 3] = data.geom_xpos[ids]
        self._put(self._moving)

    @property
    def all_solid(self) -> bool:
        """Whether no geom lets light through, whatever side of a plane is seen."""
        return bool((self.geoms.colours[:, 3] >= 1).all())

    def behind(self, eye_m: Array) -> NDArray[np.bool_]:
        """(G,) which geoms are planes whose back an eye (3,), m, sees."""
        above_m = ((eye_m - self.poses[:, :, 3]) * self.poses[:, :, 2]).sum(1)
        return np.asarray(self.planes & (above_m < 0))

    def mirror_plane(self) -> tuple[Array, float]:
        """Normal (3,) of the mirror and its distance from the origin, m; of a box its top."""
        pose = self.poses[self.mirror]
        normal, place = pose[:, 2], pose[:, 3]
        if not self.planes[self.mirror]:
            place = place + normal * self.geoms.half[self.mirror, 2]
        return normal, float(normal @ place)

    def of_mirror(self, which: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(N,) which of (N,) triangles are the mirror's face."""
        normal, _ = self.mirror_plane()
        its = self.owner[which] == self.mirror
        return np.asarray(its & (self._turned[which, 0] @ normal > 0.5))

    def shine(
        self, which: NDArray[np.int64], eye_m: Array, T_world_lamp: Array, share: float,
        light: Array,
    ) -> None:  # fmt: skip
        """Fills `light` (N, 3, 3) of triangles' corners: luma, or that of red, green and blue.

        Args:
            which: (N,) triangles.
            eye_m: (3,) from where they are seen, m.
            T_world_lamp: (4, 4) where lamps of the head are.
            share: what a mirror leaves of their colours, else 1.
            light: out.
        """
        lights, geoms = self.lights, self.geoms
        vectors = lights.vectors.copy()
        vectors[lights.heads, 0] = T_world_lamp[:3, 3]
        vectors[lights.heads, 1] = T_world_lamp[:3, 2]
        ambient = 0.0 if len(vectors) else _WITHOUT_LIGHTS
        lit(
            which, self.corners, self._turned, self.owner, geoms.colours, geoms.shine,
            geoms.channels, lights.kinds, vectors, lights.cones, ambient, np.array(LUMA),
            np.ascontiguousarray(eye_m), not self._floats, share, light,
        )  # fmt: skip

    def _even(self, geom: Any) -> bool:
        """Whether a flat geom has the same light everywhere."""
        lights = self.lights
        glossy = geom.specular > 0 and bool(lights.vectors[:, 4].any())
        return not glossy and not bool((lights.kinds == SPOT).any())

    def _put(self, which: NDArray[np.int64]) -> None:
        for g in which.tolist():
            its = slice(self.geoms.first[g], self.geoms.first[g + 1])
            turn, place = self.poses[g, :, :3], self.poses[g, :, 3]
            self.corners[its] = self._object_m[its] @ turn.T + place
            self._turned[its] = self._normals[its] @ turn.T

    def _described(self, shown: list[Any], first: Array, table: TextureTable) -> Geoms:
        boxes = [self._box(int(a), int(b)) for a, b in pairwise(first)]
        textured = [_textured(self._model, geom, table, self._hue(geom)) for geom in shown]
        count = len(shown)
        middle, half = (np.array([b[k] for b in boxes]).reshape(-1, 3) for k in (0, 1))
        radius_m = np.array([b[2] for b in boxes], float)
        for k, geom in enumerate(shown):
            if geom.type == PLANE and min(geom.size[:2]) <= 0:
                radius_m[k] = np.inf
        return Geoms(
            np.array([geom.objid for geom in shown], np.int64).reshape(count),
            np.asarray(first, np.int64),
            np.array([geom.rgba for geom in shown], float).reshape(count, 4),
            np.array([[g.emission, g.specular, 128 * g.shininess] for g in shown], float).reshape(
                count, 3
            ),
            np.array([t[0] for t in textured], np.int64).reshape(count),
            np.array([_cover(self._model, geom, table) for geom in shown], np.int64).reshape(count),
            np.isin([int(geom.type) for geom in shown], [FIELD, MESH, DISTANCES]),
            np.array([t[1] for t in textured], np.int64).reshape(count),
            radius_m, middle, half,
        )  # fmt: skip

    def _box(self, first: int, end: int) -> tuple[Array, Array, float]:
        """Middle, half size and the radius around the middle of some triangles."""
        corners = self._object_m[first:end].reshape(-1, 3)
        if not len(corners):
            return np.zeros(3), np.zeros(3), 0.0
        low, high = corners.min(0), corners.max(0)
        middle = (low + high) / 2
        return middle, (high - low) / 2, float(np.sqrt(((corners - middle) ** 2).sum(1).max()))

    def _hue(self, geom: Any) -> Array | None:
        """The hue (3,) of a geom's light, of luma 1; None where its parts have several."""
        colour = np.array(geom.rgba[:3], float)
        vectors = self.lights.vectors
        shining = [row for row in (vectors[:, 2] + vectors[:, 3]) if row.any()] + [np.ones(3)]
        hues = np.array([row * colour for row in shining])
        hues = hues / np.maximum(hues @ LUMA, 1e-12)[:, None]
        glossy = geom.specular > 0 and bool(vectors[:, 4].any())
        if glossy or np.abs((hues - hues[-1]) * LUMA).max() > _HUE:
            return None
        found: Array = hues[-1]
        return found


def _pose(geom: Any) -> Array:
    """(3, 4) of a geom in the world's axes."""
    turn = np.array(geom.mat, float).reshape(3, 3)
    return np.concatenate([turn, np.array(geom.pos, float).reshape(3, 1)], axis=1)


def _mirrors(geom: Any) -> bool:
    """Whether a geom mirrors: of MuJoCo's, the first plane or box that is solid."""
    return bool(geom.type in (PLANE, BOX) and geom.reflectance > 0 and geom.rgba[3] >= SOLID)


def _reach_m(geom: Any) -> float:
    """How far a geom reaches from its middle, as MuJoCo reckons for what lets light through."""
    size = [float(value) for value in geom.size]
    if geom.type == SPHERE:
        return size[0]
    if geom.type == CAPSULE:
        return size[0] + size[2]
    if geom.type == CYLINDER:
        return float(np.sqrt(size[0] ** 2 + size[2] ** 2))
    return max(size) if geom.type == ELLIPSOID else float(np.linalg.norm(size))


def _part(model: Any, geom: Any, *, coarse: bool) -> tuple[shapes.Part, Array, Array]:
    """Triangles of a geom, and by what and whereto they are scaled and shifted: (T, 3) each."""
    sides = model.vis.quality.numslices, model.vis.quality.numstacks
    size, one = np.array(geom.size, float), np.ones(3)
    part: shapes.Part
    if geom.type == PLANE:
        plane = int(np.flatnonzero(model.geom_type == PLANE)[geom.dataid])
        part, size = shapes.plane(model, plane, coarse=coarse), one
    elif geom.type == FIELD:
        part, size = shapes.height_field(model, int(geom.dataid)), one
    elif geom.type in (MESH, DISTANCES):
        part, size = shapes.mesh(model, int(geom.dataid) // 2), one
    elif geom.type == CAPSULE:
        return _capsule(size, sides)
    else:
        part = {
            SPHERE: lambda: shapes.sphere(*sides), ELLIPSOID: lambda: shapes.sphere(*sides),
            CYLINDER: lambda: shapes.cylinder(*sides),
            BOX: lambda: shapes.box(model.vis.quality.numquads),
        }[int(geom.type)]()  # fmt: skip
    count = len(part.corners)
    return part, np.tile(size, (count, 1)), np.zeros((count, 3))


def _capsule(size: Array, sides: tuple[int, int]) -> tuple[shapes.Part, Array, Array]:
    parts = [shapes.tube(*sides), shapes.cap(True, *sides), shapes.cap(False, *sides)]
    round_m = np.array([size[0], size[1], (size[0] + size[1]) / 2])
    counts = [len(part.corners) for part in parts]
    scale = np.repeat(np.array([size, round_m, round_m]), counts, axis=0)
    apart_m = float(size[2] - round_m[2])
    shift = np.repeat(np.array([[0, 0, 0], [0, 0, apart_m], [0, 0, -apart_m]]), counts, axis=0)
    return shapes.joined(parts), scale, shift


def _scaled(part: shapes.Part, scale: Array, shift: Array) -> Array:
    return np.asarray(part.corners * scale[:, None] + shift[:, None])


def _leaning(part: shapes.Part, scale: Array, _shift: Array) -> Array:
    normals = part.normals / scale[:, None]
    length = np.sqrt((normals**2).sum(-1, keepdims=True))
    return np.asarray(normals / np.maximum(length, 1e-12))


def texture_of(model: Any, geom: Any) -> int:
    """The texture of a geom of a `MjvScene`; -1 without one."""
    if geom.texid >= 0:
        return int(geom.texid)
    return int(model.mat_texid[geom.matid, _ROLE_RGB]) if geom.matid >= 0 else -1


def _cover(model: Any, geom: Any, table: TextureTable) -> int:
    """Channel of the opacity of a geom's texture; -1 where that is solid."""
    texture = texture_of(model, geom)
    return -1 if texture < 0 or geom.matid < 0 else table.opacity(texture)


def _textured(model: Any, geom: Any, table: TextureTable, hue: Array | None) -> tuple[int, int]:
    """Channel of a geom's texture, and how many there are."""
    texture = texture_of(model, geom)
    if texture < 0 or geom.matid < 0:
        return -1, 1
    if table.grey(texture):
        return table.luma(texture, np.ones(3)), 1
    return (table.colours(texture), 3) if hue is None else (table.luma(texture, hue), 1)


def _places(model: Any, geom: Any, part: shapes.Part) -> Array:
    """(T, 3, 3) texture coordinates: the unit shape's own, for a cube the corners themselves."""
    texture, found = texture_of(model, geom), part.corners.copy()
    if texture < 0:
        return found
    size = np.array(geom.size, float)
    if model.tex_type[texture] != FLAT:
        return np.asarray(found * size) if _uniform(model, geom) else found
    found[..., :2] = part.places
    if geom.texcoord:
        return found
    repeat = np.array(_repeat(model, geom), float)
    if geom.type in (FIELD, MESH, DISTANCES):
        # Their corners are in metres: a texture is twice as wide as the geom's half size.
        per_m = repeat if _uniform(model, geom) else repeat / size[:2]
        found[..., :2] = 0.5 * per_m * [1, -1] * part.places - 0.5
        return found
    if _uniform(model, geom):
        repeat = np.where(size[:2] > 0, repeat * size[:2], repeat)
    found[..., :2] *= repeat
    if geom.type == PLANE:
        found[..., :2] -= np.where(size[:2] > 0, 0, 0.5)
    return found


def _repeat(model: Any, geom: Any) -> Any:
    return geom.texrepeat if geom.texid >= 0 else model.mat_texrepeat[geom.matid]


def _uniform(model: Any, geom: Any) -> bool:
    return bool(geom.texuniform if geom.texid >= 0 else model.mat_texuniform[geom.matid])


def _sky(model: Any, table: TextureTable) -> int:
    """The channel of the first sky; -1 without one."""
    skies: Iterator[int] = iter(np.flatnonzero(model.tex_type == SKY).tolist())
    first = next(skies, None)
    return -1 if first is None else table.luma(first, np.ones(3))
