"""Files of models that MuJoCo knows: MJCF and URDF, with their meshes and textures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from emvs.errors import InputError
from sim.graphics import import_mujoco

if TYPE_CHECKING:
    import mujoco

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
        return mj.MjSpec.from_file(str(path.resolve()))
    except ValueError as error:
        raise InputError(f"{path} is no usable MJCF ({_line(error)}): correct it") from error


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
