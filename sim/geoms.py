"""Geoms of a compiled MuJoCo model: names, which move, what lies inside."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.tables import Geom
from eventsweep.sim.graphics import import_mujoco


def moving_geoms(model: Any) -> NDArray[np.bool_]:
    """(G,) which geoms of a compiled model hang on a joint or on a mocap body."""
    driven = model.body_mocapid[model.body_rootid] >= 0
    moving: NDArray[np.bool_] = ((model.body_weldid != 0) | driven)[model.geom_bodyid]
    return moving


def geom_table(model: Any) -> dict[int, Geom]:
    """What the geom ids of a compiled model mean.

    A geom without a name goes by its body's, or by its number. Dynamic is what hangs on a joint,
    or on a mocap body.
    """
    moving = moving_geoms(model)
    return {k: Geom(name=_label(model, k), dynamic=bool(moving[k])) for k in range(model.ngeom)}


def enclosing_geom(
    model: Any, data: Any, point_m: NDArray[np.float64], except_body: str
) -> str | None:
    """The name of a drawn geom of another body with a point (3,) inside, m; None without one.

    The state's kinematics must be up to date.
    """
    for k in range(model.ngeom):
        own = bool(except_body) and model.body(int(model.geom_bodyid[k])).name == except_body
        material = int(model.geom_matid[k])
        alpha = model.mat_rgba[material][3] if material >= 0 else model.geom_rgba[k][3]
        drawn = alpha > 0 and int(model.geom_group[k]) < 3
        if not own and drawn and _is_inside(model, data, k, point_m):
            return _label(model, k)
    return None


def _label(model: Any, geom_id: int) -> str:
    body_id = int(model.geom_bodyid[geom_id])
    name = model.geom(geom_id).name or (model.body(body_id).name if body_id else "")
    return name or f"geom{geom_id}"


def _is_inside(model: Any, data: Any, geom_id: int, point_m: NDArray[np.float64]) -> bool:
    """Whether a point lies inside a geom that has an inside: closed primitives and meshes."""
    turn = data.geom_xmat[geom_id].reshape(3, 3)
    local = (point_m - data.geom_xpos[geom_id]) @ turn
    size = model.geom_size[geom_id]
    if np.linalg.norm(local) > model.geom_rbound[geom_id] > 0:
        return False
    kind = import_mujoco().mjtGeom(model.geom_type[geom_id]).name.removeprefix("mjGEOM_")
    if kind == "MESH":
        return _is_inside_mesh(model, int(model.geom_dataid[geom_id]), local)
    radius_m, height_m = float(np.hypot(local[0], local[1])), abs(local[2])
    inside = {
        "SPHERE": np.linalg.norm(local) < size[0],
        "BOX": (np.abs(local) < size).all(),
        "ELLIPSOID": np.linalg.norm(local / np.where(size, size, np.inf)) < 1,
        "CYLINDER": radius_m < size[0] and height_m < size[1],
        "CAPSULE": np.hypot(radius_m, max(0.0, height_m - size[1])) < size[0],
    }
    return bool(inside.get(kind, False))


def _is_inside_mesh(model: Any, mesh_id: int, local: NDArray[np.float64]) -> bool:
    """By the solid angle of its outward faces: a dome whose faces look inwards has no inside."""
    first_vertex, vertices = model.mesh_vertadr[mesh_id], model.mesh_vertnum[mesh_id]
    first_face, faces = model.mesh_faceadr[mesh_id], model.mesh_facenum[mesh_id]
    points = model.mesh_vert[first_vertex : first_vertex + vertices] - local
    a, b, c = points[model.mesh_face[first_face : first_face + faces].T].astype(np.float64)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("ni,ni->n", a, b) * lc
        + np.einsum("ni,ni->n", b, c) * la
        + np.einsum("ni,ni->n", c, a) * lb
    )
    # Van Oosterom and Strackee (IEEE Trans. Biomed. Eng. 1983): the whole sphere is 4 pi.
    return bool(2 * np.arctan2(volume, below).sum() > 2 * np.pi)
