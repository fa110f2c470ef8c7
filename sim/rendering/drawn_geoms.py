"""The geoms of a `MjvScene`: in which order they are drawn, and which of them a view needs.

MuJoCo sends all geoms through the graphics pipeline for every picture, in the model's order. What a
view cannot see need not be sent, and what is hidden costs least after what hides it.
"""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.rendering.lens import edges

Array = NDArray[np.float64]
# Bounding spheres are taken larger by a share of their radius and of their distance: more than
# single precision moves a vertex by.
_MARGIN = 1e-4


class DrawnGeoms:
    """The geoms of a compiled model's `MjvScene`.

    Attributes:
        all_opaque: whether none lets light through.
    """

    def __init__(self, model: Any, scene: Any) -> None:
        self._model, self._scene = model, scene
        self._hidden = int(import_mujoco().mjtGeom.mjGEOM_NONE)
        self._as_listed: list[dict[str, Any]] = []
        self.updated()

    def updated(self) -> None:
        """Must be called when MuJoCo has filled the scene: all is drawn, in the model's order."""
        self._geoms = list(self._scene.geoms[: self._scene.ngeom])
        self._shown = np.ones(len(self._geoms), bool)
        self.all_opaque = all(geom.rgba[3] >= 1 for geom in self._geoms)
        self._look()

    def near_first(self, eye_m: Array) -> None:
        """Sorts by the distance from an eye (3,), m.

        Which of two surfaces at the same depth shows may change, so the order must not depend on
        the order before.
        """
        self._show(np.ones_like(self._shown))
        if not self._as_listed:
            self._as_listed = [_fields(geom) for geom in self._geoms]
        near_to_far = np.argsort([self._distance_m(fields, eye_m) for fields in self._as_listed])
        for geom, n in zip(self._geoms, near_to_far, strict=True):
            for name, value in self._as_listed[n].items():
                if isinstance(value, np.ndarray):
                    getattr(geom, name)[...] = value
                else:
                    setattr(geom, name, value)
        self._look()

    def only_seen(self, view: Camera, T_world_view: Array) -> None:
        """Leaves out what lies outside the frustum of a pinhole `view` from a pose (4, 4)."""
        left, right, top, bottom = edges(view)
        inwards = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
        inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
        from_eye_m = self._centres_m - T_world_view[:3, 3]
        reach_m = self._radii_m + _MARGIN * (self._radii_m + np.linalg.norm(from_eye_m, axis=1))
        inside_m = from_eye_m @ T_world_view[:3, :3] @ inwards.T
        self._show(inside_m.min(axis=1) >= -reach_m)

    def _look(self) -> None:
        """Notes where the geoms are, and what they are; endless ones have no bounding sphere."""
        self._types = [geom.type for geom in self._geoms]
        self._centres_m = np.array([geom.pos for geom in self._geoms], float).reshape(-1, 3)
        self._radii_m = np.array(
            [self._model.geom_rbound[g.objid] if _is_geom(g.objtype) else 0 for g in self._geoms],
            float,
        )
        self._radii_m[self._radii_m <= 0] = np.inf

    def _show(self, shown: NDArray[np.bool_]) -> None:
        """Draws these (G,) and no others."""
        for n in np.flatnonzero(shown != self._shown).tolist():
            self._geoms[n].type = self._types[n] if shown[n] else self._hidden
        self._shown = shown

    def _distance_m(self, geom: dict[str, Any], eye_m: Array) -> float:
        """From the eye to the middle between a geom's nearest and farthest; endless ones come last.

        A floor begins at the eye, but hides nothing that stands on it.
        """
        model, k = self._model, geom["objid"]
        if not _is_geom(geom["objtype"]) or model.geom_rbound[k] <= 0:
            return np.inf
        local = geom["mat"].reshape(3, 3).T @ (eye_m - geom["pos"]) - model.geom_aabb[k, :3]
        away, half = np.abs(local), model.geom_aabb[k, 3:]
        nearest, farthest = np.maximum(away - half, 0), away + half
        return float(np.linalg.norm(nearest) + np.linalg.norm(farthest)) / 2


def _is_geom(kind: int) -> bool:
    """Whether what is drawn is a geom of the model."""
    return bool(kind == import_mujoco().mjtObj.mjOBJ_GEOM)


def _fields(geom: Any) -> dict[str, Any]:
    """All that makes a geom of a MuJoCo scene, copied."""
    values = {name: getattr(geom, name) for name in dir(geom) if not name.startswith("_")}
    return {name: copy(value) for name, value in values.items() if not callable(value)}
