"""Where a rig sits on a model: on a body, a site or a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, offer
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.mjcf import KEEPS_LINKS, links_of, named

Pose = NDArray[np.float64]
KINDS = ("camera", "site", "body")
# Columns: right, down and forward of a camera, in the axes of what carries it. MuJoCo's cameras
# look along -z with y up; bodies and sites of robots look along x with z up (ROS REP 103).
_OF_CAMERA = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
_OF_ROBOT = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


class Mount(NamedTuple):
    """A body, site or camera of a model that carries a rig.

    Attributes:
        kind: one of `KINDS`.
        name: as the model has it.
        body: id of the body that it belongs to.
    """

    kind: str
    name: str
    body: int

    def T_world_body(self, data: Any) -> Pose:
        """Pose (4, 4) of the rig's body, axes right, down, forward, where `data` has the model.

        Kinematics must be up to date (`mj_kinematics`, for cameras `mj_camlight` as well).
        """
        seen = getattr(data, self.kind)(self.name)
        axes = _OF_CAMERA if self.kind == "camera" else _OF_ROBOT
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = seen.xmat.reshape(3, 3) @ axes, seen.xpos
        return pose


def find_mount(model: Any, name: str, path: Path | None = None) -> Mount:
    """Finds what `name` means: `body:NAME`, `site:NAME`, `camera:NAME`, or a name that is unique.

    Args:
        model: compiled.
        name: what is asked for.
        path: of the model's file, if there is one: a robot's may have links that the model lacks.

    Raises:
        InputError: nothing, or several things, are called so; says what there is.
    """
    mj = import_mujoco()
    known = {kind: named(mj, model, kind) for kind in KINDS}
    kind, _, own = name.partition(":")
    if kind in KINDS and own:
        known_as = [(kind, own)] if own in known[kind] else []
    else:
        known_as = [(kind, name) for kind in KINDS if name in known[kind]]
    if len(known_as) != 1:
        what = "several things are" if known_as else "nothing is"
        choice = [f"{kind}:{name}" for kind, name in known_as] or [
            f"{kind}:{name}" for kind in KINDS for name in known[kind] if name != "world"
        ]
        fused = [link for link in links_of(path) if link not in known["body"]] if path else []
        if (not known_as and (asked := own or name) in fused) or (fused and not choice):
            raise InputError(_of_fused(path, asked if asked in fused else fused[0], choice))
        none = "it has no names, give a body, a site or a camera one in its file"
        raise InputError(f"{what} called {name!r} in the model: {offer(choice, none)}")
    kind, own = known_as[0]
    place = getattr(model, kind)(own)
    return Mount(kind, own, int(place.id if kind == "body" else place.bodyid[0]))


def _of_fused(path: Path | None, link: str, others: list[str]) -> str:
    other = f"; or {offer(others, '')}" if others else ""
    return (
        f"{path}: no joint moves link {link!r}, and MuJoCo fuses such a link into what it is fixed "
        f"to: give it a joint, or keep it with {KEEPS_LINKS} inside <robot>{other}"
    )


def first_camera(model: Any) -> str:
    """Name of the first camera of a model that has one with a name; else empty."""
    names = named(import_mujoco(), model, "camera")
    return f"camera:{names[0]}" if names else ""


def has_resolution(model: Any, name: str) -> bool:
    """Whether a model's camera says how many pixels it has."""
    return bool((model.cam_resolution[model.camera(name).id] > 1).all())


def rig_of_cameras(model: Any, names: tuple[str, ...]) -> Rig:
    """The rig that some of a model's cameras are, with their resolution and intrinsics.

    Args:
        model: compiled.
        names: of cameras that hang on one body; the first one's place is the rig's body.

    Raises:
        InputError: an unknown camera, one without resolution, or cameras of different bodies.
    """
    mj = import_mujoco()
    mounts = [find_mount(model, f"camera:{name}") for name in names]
    if len({mount.body for mount in mounts}) > 1:
        raise InputError(
            f"cameras {', '.join(names)} are on different bodies: choose cameras of one body"
        )
    data = mj.MjData(model)
    mj.mj_kinematics(model, data)
    mj.mj_camlight(model, data)
    T_world_cam = [mount.T_world_body(data) for mount in mounts]
    T_body_world = se3.inverse(T_world_cam[0])
    return Rig(
        "+".join(names),
        tuple(_intrinsics(model, name) for name in names),
        (np.eye(4), *(T_body_world @ T for T in T_world_cam[1:])),
        names if len(names) > 1 else (),
    )


def _intrinsics(model: Any, name: str) -> Camera:
    k = model.camera(name).id
    width_px, height_px = (int(n) for n in model.cam_resolution[k])
    if not has_resolution(model, name):
        raise InputError(
            f"camera {name!r} of the model has a resolution of {width_px} x {height_px}: give it "
            '`resolution="346 260"` there, or name a rig'
        )
    if model.cam_projection[k] != import_mujoco().mjtProjection.mjPROJ_PERSPECTIVE:
        raise InputError(
            f"camera {name!r} of the model is orthographic, and event cameras here are pinholes: "
            'give it projection="perspective" and `fovy` or `focal` there, or name a rig'
        )
    middle_px = (width_px - 1) / 2, (height_px - 1) / 2
    if model.cam_sensorsize[k].any():
        per_m = model.cam_resolution[k] / model.cam_sensorsize[k]
        focal_px, shift_px = model.cam_intrinsic[k, :2] * per_m, model.cam_intrinsic[k, 2:] * per_m
        # MuJoCo says where the picture's middle lies from the axis, to the right and down.
        centre_px = middle_px[0] - shift_px[0], middle_px[1] - shift_px[1]
    else:
        with np.errstate(divide="ignore"):
            focal = 0.5 * height_px / np.tan(0.5 * np.radians(model.cam_fovy[k]))
        focal_px, centre_px = (focal, focal), middle_px
    fx_px, fy_px, cx_px, cy_px = (float(value) for value in (*focal_px, *centre_px))
    if not (0 < fx_px < np.inf and 0 < fy_px < np.inf):
        raise InputError(
            f"camera {name!r} of the model has a focal length of {fx_px:g} x {fy_px:g} px: give it "
            "`fovy` above 0, or `focal` beside `sensorsize`, or name a rig"
        )
    return Camera(width_px, height_px, fx_px, fy_px, cx_px, cy_px)
