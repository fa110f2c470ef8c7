"""Shadows painted into a texture once, instead of rendered in every frame.

Of parallel light (`bake`): all geoms are convex, so a geom's shadow on a horizontal top is the
convex hull of its outline pushed along the light: exact, sharp at the contact, free at render time.
Of a lamp at one place (`cast`), by rays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.scene import put_texture

if TYPE_CHECKING:
    import mujoco

SHELL_GROUP = 2
"""Geoms of this group (walls, ceilings; see common.xml) let the light through."""

_KEEP = 0.62
"""What remains of the brightness in the shadow of the key light."""
_CELLS = 96
"""Rays of a lamp along the shorter side of a shadowed face."""


def bake(spec: mujoco.MjSpec, *, light: str = "key", **texture_of: str) -> None:
    """Darkens the textures of horizontal boxes where other geoms keep a light away.

    Args:
        spec: edited in place; each texture must cover its box's top exactly once.
        light: name of the directional light that casts.
        texture_of: geom name = texture name.
    """
    mj = import_mujoco()
    model = spec.compile()
    data = mj.MjData(model)
    mj.mj_kinematics(model, data)
    direction = np.array(spec.light(light).dir)
    for geom, name in texture_of.items():
        shape = spec.texture(name).height, spec.texture(name).width
        lit = _lit_by_sun(mj, model, data, model.geom(geom).id, direction, shape)
        _darken(spec, name, lit, _KEEP)


def cast(
    spec: mujoco.MjSpec,
    lamp_m: ArrayLike,
    *,
    keep: float,
    soft_m: float,
    shade_m: float = 0.1,
    **texture_of: str,
) -> None:
    """Darkens the tops of boxes where other geoms hide a lamp, by rays.

    Args:
        spec: edited in place; each texture must cover its box's top exactly once.
        lamp_m: (3,) where the lamp is, m.
        keep: what remains of the brightness in the shadow, 0 to 1.
        soft_m: width of the shadow's edge, m.
        shade_m: geoms this near to the lamp are its own shade and cast nothing.
        texture_of: geom name = texture name.
    """
    import cv2

    mj = import_mujoco()
    model = spec.compile()
    data, lamp = mj.MjData(model), np.asarray(lamp_m, float)
    mj.mj_forward(model, data)
    for geom, name in texture_of.items():
        points, cell_m = _top(model, data, model.geom(geom).id)
        seen = [_sees(mj, model, data, p, lamp, shade_m) for p in points.reshape(-1, 3)]
        lit = np.asarray(seen, np.float32).reshape(points.shape[:2])
        soft = cv2.GaussianBlur(lit, (0, 0), max(0.6, soft_m / cell_m))
        size_px = spec.texture(name).width, spec.texture(name).height
        fine = np.clip(cv2.resize(soft, size_px, interpolation=cv2.INTER_CUBIC), 0, 1)
        _darken(spec, name, fine.astype(np.float32), keep)


def _darken(spec: mujoco.MjSpec, name: str, lit: NDArray[np.float32], keep: float) -> None:
    """Keeps all of a texture's brightness where `lit` (H, W) is 1, and `keep` of it where 0."""
    from eventsweep.scenes.textures.noise import DARKEST

    texture = spec.texture(name)
    pixels = np.frombuffer(texture.data, np.uint8).reshape(texture.height, texture.width, 3)
    dark = np.empty_like(pixels)
    for row in range(len(pixels)):  # a row fits the processor's cache, all of them do not
        kept = keep + (1 - keep) * lit[row, :, None]
        dark[row] = np.rint(np.maximum(pixels[row] * kept, DARKEST))
    put_texture(spec, name, dark)


def _lit_by_sun(
    mj: Any,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    ground: int,
    direction: NDArray[np.float64],
    shape: tuple[int, int],
) -> NDArray[np.float32]:
    """(H, W): 1 in the light, 0 in the shadow, blurred by about a centimetre."""
    import cv2  # a scene that is only listed need not wait for it

    half, middle = model.geom_size[ground], data.geom_xpos[ground]
    top_m = middle[2] + half[2]
    texels_per_m = np.array([shape[1], shape[0]]) / (2 * half[:2])
    lit = np.full(shape, 255, np.uint8)
    for geom in range(model.ngeom):
        if geom == ground or model.geom_group[geom] == SHELL_GROUP:
            continue
        outline = _outline(mj, model, data, geom)
        if outline[:, 2].max() < top_m + 1e-4:
            continue
        above = np.maximum(outline[:, 2] - top_m, 0.0)
        flat = outline[:, :2] + above[:, None] * direction[:2] / -direction[2]
        corner = flat - (middle[:2] - half[:2])
        texels = corner * texels_per_m
        texels[:, 1] = shape[0] - texels[:, 1]  # the first row lies at the far (+y) edge
        hull = cv2.convexHull(np.clip(texels, -30000, 30000).astype(np.int32))
        cv2.fillConvexPoly(lit, hull, 0, cv2.LINE_AA)
    soft = cv2.GaussianBlur(lit, (0, 0), 0.006 * float(texels_per_m.mean()))
    return soft.astype(np.float32) / 255.0


def _top(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int
) -> tuple[NDArray[np.float64], float]:
    """World points (R, C, 3) just above a box's top, the first row at the far edge; their pitch."""
    half, middle = model.geom_size[geom], data.geom_xpos[geom]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    cell_m = 2 * float(min(half[:2])) / _CELLS
    columns, rows = (np.linspace(-1, 1, round(2 * side / cell_m)) * 0.999 for side in half[:2])
    x, y = np.meshgrid(columns * half[0], rows[::-1] * half[1])
    local = np.stack([x, y, np.full_like(x, half[2] + 1e-4)], axis=-1)
    return local @ rotation.T + middle, cell_m


def _sees(
    mj: Any,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    point: NDArray[np.float64],
    lamp_m: NDArray[np.float64],
    shade_m: float,
) -> bool:
    away = lamp_m - point
    distance_m = float(np.linalg.norm(away))
    hit = np.zeros(1, np.int32)
    met_m = mj.mj_ray(model, data, point, away / distance_m, None, 1, -1, hit)
    return bool(met_m < 0 or met_m > distance_m - shade_m)


def _outline(mj: Any, model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> NDArray[np.float64]:
    """World points (N, 3) whose convex hull is the geom, closely."""
    size, kind = model.geom_size[geom], mj.mjtGeom(model.geom_type[geom])
    points_of: dict[Any, Callable[[], NDArray[np.float64]]] = {
        mj.mjtGeom.mjGEOM_BOX: lambda: _CORNERS * size,
        mj.mjtGeom.mjGEOM_SPHERE: lambda: _BALL * size[0],
        mj.mjtGeom.mjGEOM_ELLIPSOID: lambda: _BALL * size,
        mj.mjtGeom.mjGEOM_CYLINDER: lambda: _both_ends(_RING * size[0], size[1]),
        mj.mjtGeom.mjGEOM_CAPSULE: lambda: _both_ends(_BALL * size[0], size[1]),
    }
    if kind not in points_of:
        raise InputError(
            f"geom {model.geom(geom).name!r} is a {kind.name}, whose shadow cannot be baked: use a "
            f"box, cylinder, capsule, sphere or ellipsoid, or put it into group {SHELL_GROUP}"
        )
    rotation = data.geom_xmat[geom].reshape(3, 3)
    return np.asarray(points_of[kind]() @ rotation.T + data.geom_xpos[geom])


def _both_ends(points: NDArray[np.float64], half_length: float) -> NDArray[np.float64]:
    offset = np.array([0.0, 0.0, half_length])
    return np.concatenate([points - offset, points + offset])


_TURN = np.linspace(0, 2 * np.pi, 24, endpoint=False)
_RING = np.stack([np.cos(_TURN), np.sin(_TURN), np.zeros_like(_TURN)], axis=1)
_RISE = np.linspace(-np.pi / 2, np.pi / 2, 9)[:, None, None]
_BALL = (np.cos(_RISE) * _RING + np.sin(_RISE) * [0, 0, 1]).reshape(-1, 3)
_CORNERS = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
