"""Shadows painted into a texture once, instead of rendered in every frame.

All light is parallel and all geoms are convex, so a geom's shadow on a horizontal top is the convex
hull of its outline pushed along the light: exact, sharp at the contact, free at render time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError
from eventsweep.scenes.textures.noise import DARKEST
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.scene import put_texture

if TYPE_CHECKING:
    import mujoco

SHELL_GROUP = 2
"""Geoms of this group (walls, ceilings; see common.xml) let the light through."""

_KEEP = 0.62
"""What remains of the brightness in the shadow of the key light."""


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
    for geom, texture in texture_of.items():
        pixels = _pixels(spec, texture)
        shade = _shade(mj, model, data, model.geom(geom).id, direction, pixels.shape[:2])
        dark = np.empty_like(pixels)
        for row in range(len(pixels)):  # a row fits the processor's cache, all of them do not
            kept = _KEEP + (1 - _KEEP) * shade[row, :, None]
            dark[row] = np.rint(np.maximum(pixels[row] * kept, DARKEST))
        put_texture(spec, texture, dark)


def _pixels(spec: mujoco.MjSpec, name: str) -> NDArray[np.uint8]:
    texture = spec.texture(name)
    return np.frombuffer(texture.data, np.uint8).reshape(texture.height, texture.width, 3)


def _shade(
    mj: Any,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    ground: int,
    direction: NDArray[np.float64],
    shape: tuple[int, int],
) -> NDArray[np.float32]:
    """(H, W): 1 in the light, 0 in the shadow, blurred by about a centimetre."""
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


def _ball() -> NDArray[np.float64]:
    rise = np.linspace(-np.pi / 2, np.pi / 2, 9)[:, None, None]
    return np.asarray((np.cos(rise) * _RING + np.sin(rise) * [0, 0, 1]).reshape(-1, 3))


_TURN = np.linspace(0, 2 * np.pi, 24, endpoint=False)
_RING = np.stack([np.cos(_TURN), np.sin(_TURN), np.zeros_like(_TURN)], axis=1)
_BALL = _ball()
_CORNERS = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
