"""Shadows of a lamp at one place, painted into the textures of what lies below it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eventsweep.scenes.textures.noise import DARKEST, Field
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.scene import put_texture

if TYPE_CHECKING:
    import mujoco

_CELLS = 96
"""Rays along the shorter side of a shadowed face."""


def cast(
    spec: mujoco.MjSpec,
    lamp_m: ArrayLike,
    *,
    keep: float,
    soft_m: float,
    shade_m: float = 0.1,
    **texture_of: str,
) -> None:
    """Darkens the tops of boxes where other geoms hide the lamp, by rays.

    Args:
        spec: edited in place; each texture must cover its box's top exactly once.
        lamp_m: (3,) where the lamp is, m.
        keep: what remains of the brightness in the shadow, 0 to 1.
        soft_m: width of the shadow's edge, m.
        shade_m: geoms this near to the lamp are its own shade and cast nothing.
        texture_of: geom name = texture name.
    """
    mj = import_mujoco()
    model = spec.compile()
    data, lamp = mj.MjData(model), np.asarray(lamp_m, float)
    mj.mj_forward(model, data)
    for geom, name in texture_of.items():
        texture = spec.texture(name)
        pixels = np.frombuffer(texture.data, np.uint8).reshape(texture.height, texture.width, 3)
        points, cell_m = _top(model, data, model.geom(geom).id)
        seen = [_sees(mj, model, data, p, lamp, shade_m) for p in points.reshape(-1, 3)]
        lit: Field = np.asarray(seen, np.float32).reshape(points.shape[:2])
        lit = _blurred(lit, soft_m / cell_m, (texture.width, texture.height))
        dark = pixels * (keep + (1 - keep) * lit[..., None])
        put_texture(spec, name, np.rint(np.maximum(dark, DARKEST)).astype(np.uint8))


def _blurred(lit: Field, sigma: float, size_px: tuple[int, int]) -> Field:
    soft = cv2.GaussianBlur(lit, (0, 0), max(0.6, sigma))
    return np.clip(cv2.resize(soft, size_px, interpolation=cv2.INTER_CUBIC), 0, 1).astype(
        np.float32
    )


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
