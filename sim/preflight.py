"""Refuses early what cannot end well: too little disk or memory, a camera inside an object."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs.errors import InputError
from sim.graphics import import_mujoco
from sim.parallel.render_job import RenderJob
from sim.parallel.workers import slot_bytes, slot_count
from sim.sensor.frame_camera import spans_us

# Lossless compression of rendered images gains at least this.
_COMPRESSED = 0.4
_IMAGE_BYTES = {"depth_m": 4, "intensity": 1, "flow": 8, "segmentation": 4, "boundary": 1}
_PIXEL_BYTES, _SAMPLE_BYTES, _PROCESS_BYTES = 120, 24, 300e6


def check_disk(job: RenderJob, out: Path) -> None:
    """Compares the disk's free space with the size of the ground truth.

    Raises:
        InputError: there is less; says how much is needed.
    """
    per_pixel = sum(
        _IMAGE_BYTES.get(name, 0) for name in ("depth_m", "intensity", *job.config.truth)
    )
    pixels = sum(c.width_px * c.height_px for c in job.rig.cameras)
    photos = len(spans_us(job.config.frames, job.duration_us))
    # It lies there twice while the sequence is put together from its parts.
    needed = 2 * _COMPRESSED * pixels * (per_pixel * len(job.truth_us) + photos)
    folder = out.absolute()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise InputError(
            f"{out}: ground truth at {len(job.truth_us)} times takes about {needed / 1e9:.1f} GB, "
            f"but {free / 1e9:.1f} GB are free: raise truth_interval_s, or choose another disk"
        )


def check_memory(job: RenderJob, workers: int) -> None:
    """Compares the machine's free memory with what the rig's pictures take.

    Raises:
        InputError: there is less; says how much is needed.
    """
    sizes = [camera.width_px * camera.height_px for camera in job.rig.cameras]
    drawing = _PROCESS_BYTES + _SAMPLE_BYTES * max(sizes) * job.config.supersample**2
    shared = slot_bytes(job) * slot_count(job) if workers > 1 else 0
    needed = _PIXEL_BYTES * sum(sizes) + workers * (drawing + shared)
    free = available_memory()
    if free is not None and needed > free:
        raise InputError(
            f"rig {job.rig.name} at supersample={job.config.supersample} with {workers} workers "
            f"takes about {needed / 1e9:.1f} GB of memory, but {free / 1e9:.1f} GB are free: use "
            "fewer workers, a lower supersample or smaller cameras"
        )


def available_memory() -> int | None:
    """Bytes that can be had without swapping, within the control group's limit; None: unknown."""
    known = re.findall(r"^MemAvailable: *(\d+) kB", _text("/proc/meminfo"), re.MULTILINE)
    limits = [1024 * int(amount) for amount in known]
    group, used = _text("/sys/fs/cgroup/memory.max"), _text("/sys/fs/cgroup/memory.current")
    if group.strip().isdigit() and used.strip().isdigit():
        limits.append(max(0, int(group) - int(used)))
    return min(limits, default=None)


def check_outside(job: RenderJob, model: Any) -> None:
    """Makes sure that no camera starts inside an object.

    Raises:
        InputError: one does; names camera and object.
    """
    mj = import_mujoco()
    data = mj.MjData(model)
    mj.mj_forward(model, data)
    T_world_body = job.motion().T_world_body(0.0)
    for name, T_body_cam in zip(job.rig.camera_names, job.rig.T_body_cam, strict=True):
        eye_m = (T_world_body @ T_body_cam)[:3, 3]
        for geom_id in range(model.ngeom):
            if _drawn(model, geom_id) and _inside(mj, model, data, geom_id, eye_m):
                body = model.body(int(model.geom_bodyid[geom_id])).name
                label = model.geom(geom_id).name or body or f"geom{geom_id}"
                raise InputError(
                    f"camera {name} of rig {job.rig.name} starts inside {label!r} of scene "
                    f"{job.scene.name}, at {np.round(eye_m, 3).tolist()} m: move the start of the "
                    "motion, or the object"
                )


def _drawn(model: Any, geom_id: int) -> bool:
    material = int(model.geom_matid[geom_id])
    alpha = model.mat_rgba[material][3] if material >= 0 else model.geom_rgba[geom_id][3]
    return bool(alpha > 0) and int(model.geom_group[geom_id]) < 3


def _inside(mj: Any, model: Any, data: Any, geom_id: int, point_m: NDArray[np.float64]) -> bool:
    """Whether a point lies inside a geom that has an inside: MuJoCo's closed primitives, meshes."""
    turn = data.geom_xmat[geom_id].reshape(3, 3)
    local = (point_m - data.geom_xpos[geom_id]) @ turn
    size, kind = model.geom_size[geom_id], mj.mjtGeom(model.geom_type[geom_id])
    if np.linalg.norm(local) > model.geom_rbound[geom_id] > 0:
        return False
    radius = float(np.hypot(local[0], local[1]))
    if kind == mj.mjtGeom.mjGEOM_SPHERE:
        return bool(np.linalg.norm(local) < size[0])
    if kind == mj.mjtGeom.mjGEOM_BOX:
        return bool((np.abs(local) < size).all())
    if kind == mj.mjtGeom.mjGEOM_ELLIPSOID:
        return bool(np.linalg.norm(local / size) < 1)
    if kind == mj.mjtGeom.mjGEOM_CYLINDER:
        return bool(radius < size[0] and abs(local[2]) < size[1])
    if kind == mj.mjtGeom.mjGEOM_CAPSULE:
        return bool(np.hypot(radius, max(0.0, abs(local[2]) - size[1])) < size[0])
    if kind == mj.mjtGeom.mjGEOM_MESH:
        return _inside_mesh(model, int(model.geom_dataid[geom_id]), local)
    return False


def _inside_mesh(model: Any, mesh_id: int, local: NDArray[np.float64]) -> bool:
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


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="ascii")
    except OSError:
        return ""
