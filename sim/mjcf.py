"""Files of models that MuJoCo knows: MJCF and URDF, with their meshes and textures."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emvs.errors import InputError
from emvs.utils.inputs import read_text
from sim.graphics import import_mujoco

if TYPE_CHECKING:
    import mujoco

# Groups of geoms from this one on are not drawn.
_HIDDEN = 3
_ROBOT = re.compile(r"<robot\b[^>]*>")
_VISIBLE = '<mujoco><compiler discardvisual="false"/></mujoco>'
_PACKAGE = "package:"
_URDF_BYTES = 1 << 26
SUFFIXES = (".xml", ".urdf", ".mjcf")


def is_model_file(name: str) -> bool:
    """Whether a scene's name is a model's path."""
    return name.lower().endswith(SUFFIXES)


def read_spec(path: Path) -> mujoco.MjSpec:
    """Reads a model.

    Raises:
        InputError: no such file, or MuJoCo cannot read it or what it includes.
    """
    mj = import_mujoco()
    if not path.is_file():
        raise InputError(f"{path}: no such file: name a model in MJCF (.xml) or URDF (.urdf)")
    try:
        if path.suffix.lower() == ".urdf":
            return _robot(mj, path)
        return mj.MjSpec.from_file(str(path.resolve()))
    except ValueError as error:
        raise InputError(f"{path} is no usable MJCF ({_line(error)}): correct it") from error


def _robot(mj: Any, path: Path) -> mujoco.MjSpec:
    """A URDF with its visual geometry, which MuJoCo leaves out unless the file says otherwise."""
    text = read_text(path, _URDF_BYTES)
    if "<mujoco" in text:
        return mj.MjSpec.from_file(str(path.resolve()))
    spec = mj.MjSpec.from_string(_ROBOT.sub(rf"\g<0>{_VISIBLE}", text, count=1))
    spec.modelfiledir = str(path.resolve().parent)
    for asset in (*spec.meshes, *spec.textures):
        asset.file = _found(asset.file, path.resolve().parent)
    _hide_hulls(spec)
    return spec


def _found(file: str, folder: Path) -> str:
    """Where `package://NAME/REST` lies: in a folder around the robot's, with or without NAME."""
    if not file.startswith(_PACKAGE):
        return file
    named = file.removeprefix(_PACKAGE).lstrip("/")
    for root in (folder, *folder.parents):
        for rest in (named, named.partition("/")[2]):
            if (root / rest).is_file():
                return str(root / rest)
    return named


def _hide_hulls(spec: mujoco.MjSpec) -> None:
    """Draws the visual geometry alone, where there is some."""
    if any(not (geom.contype or geom.conaffinity) for geom in spec.geoms):
        for geom in spec.geoms:
            geom.group = _HIDDEN if geom.contype or geom.conaffinity else geom.group


def compiled(spec: mujoco.MjSpec) -> Any:
    """The compiled model.

    Raises:
        InputError: it does not compile; a mesh or a picture is missing, for example.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(
            f"the scene does not compile ({_line(error)}): correct its file"
        ) from error


def named(mj: Any, model: Any, kind: str) -> list[str]:
    """Names of a model's bodies, sites, cameras, joints or keys; those without a name left out."""
    count = getattr(model, {"body": "nbody", "site": "nsite", "camera": "ncam",
                            "joint": "njnt", "key": "nkey"}[kind])  # fmt: skip
    object_type = getattr(mj.mjtObj, f"mjOBJ_{kind.upper()}")
    names = (mj.mj_id2name(model, object_type, k) for k in range(count))
    return [name for name in names if name]


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
