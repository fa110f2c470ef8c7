"""Files of models that MuJoCo knows: MJCF and URDF, with their meshes and textures."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import lru_cache
from hashlib import sha256
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import read_text
from eventsweep.sim.graphics import import_mujoco

if TYPE_CHECKING:
    import mujoco

# Groups of geoms from this one on are not drawn.
_HIDDEN = 3
_ROBOT = re.compile(r"<robot\b[^>]*>")
_VISIBLE = '<mujoco><compiler discardvisual="false"/></mujoco>'
_PACKAGE = "package:"
_FILE = re.compile(r"""\bfile\w*\s*=\s*["']([^"']+)["']""")
_FOLDER = re.compile(r"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"']+)["']""")
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
        raise InputError(f"{path} is not valid MJCF ({_line(error)}): correct it") from error


def _robot(mj: Any, path: Path) -> mujoco.MjSpec:
    """A URDF with its visual geometry, which MuJoCo leaves out unless the file says otherwise."""
    text = read_text(path, _URDF_BYTES)
    if "<mujoco" in text:
        return mj.MjSpec.from_file(str(path.resolve()))
    spec = mj.MjSpec.from_string(_ROBOT.sub(rf"\g<0>{_VISIBLE}", text, count=1))
    spec.modelfiledir = str(path.resolve().parent)
    for asset in (*spec.meshes, *spec.textures):
        asset.file = _resolved(asset.file, path.resolve().parent)
    # Draws the visual geometry alone, where there is some.
    if any(not (geom.contype or geom.conaffinity) for geom in spec.geoms):
        for geom in spec.geoms:
            geom.group = _HIDDEN if geom.contype or geom.conaffinity else geom.group
    return spec


def _resolved(file: str, folder: Path) -> str:
    """Where `package://NAME/REST` lies: in a folder around the robot's, with or without NAME."""
    if not file.startswith(_PACKAGE):
        return file
    named = file.removeprefix(_PACKAGE).lstrip("/")
    for root in (folder, *folder.parents):
        for rest in (named, named.partition("/")[2]):
            if (root / rest).is_file():
                return str(root / rest)
    return named


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


def model_of(path: Path) -> Any:
    """The compiled model of a file; not to be changed.

    The last one is kept until one of its files changes: a large model takes seconds.

    Raises:
        InputError: what `read_spec` and `compiled` refuse.
    """
    return _model_of(path.resolve(), tuple(digests(path).items()))


@lru_cache(maxsize=1)
def _model_of(path: Path, _digests: tuple[tuple[str, str], ...]) -> Any:
    return compiled(read_spec(path))


def digests(path: Path) -> dict[str, str]:
    """Name, as seen from a model's folder, and sha256 of each of `files_of`."""
    folder = path.resolve().parent
    return {
        Path(os.path.relpath(file, folder)).as_posix(): sha256(file.read_bytes()).hexdigest()
        for file in files_of(path)
    }


def files_of(path: Path) -> list[Path]:
    """A model's file, all that it names and that is there, and what those name: sorted, absolute.

    MuJoCo looks for a name beside the model or the file that includes it, or in the folder that
    the compiler's `meshdir`, `texturedir` or `assetdir` says; of a URDF's mesh it may take the last
    part alone. A file in any of these places counts: one too many does no harm.
    """
    folder = path.resolve().parent
    texts: dict[Path, str] = {}
    files, seen = {path.resolve()}, 0
    while seen < len(files):  # a folder may be said in one file, and a name in another
        seen = len(files)
        models = {file for file in files if file.suffix.lower() in SUFFIXES and file.is_file()}
        for file in models - texts.keys():
            texts[file] = file.read_text(encoding="utf-8", errors="replace")
        said = {"", *(unescape(name) for text in texts.values() for name in _FOLDER.findall(text))}
        roots = {
            root / name for root in (folder, *(file.parent for file in texts)) for name in said
        }
        names = {unescape(name) for text in texts.values() for name in _FILE.findall(text)}
        files |= {file.resolve() for file in _places(names, roots, folder) if file.is_file()}
    return sorted(file for file in files if file.is_file())


def _places(names: set[str], roots: set[Path], folder: Path) -> Iterator[Path]:
    for name in names:
        known = _resolved(name, folder)
        yield from (root / place for root in roots for place in {known, Path(known).name})


def named(mj: Any, model: Any, kind: str) -> list[str]:
    """Names of a model's bodies, sites, cameras, joints or keys; those without a name left out."""
    count = getattr(model, {"body": "nbody", "site": "nsite", "camera": "ncam",
                            "joint": "njnt", "key": "nkey"}[kind])  # fmt: skip
    object_type = getattr(mj.mjtObj, f"mjOBJ_{kind.upper()}")
    names = (mj.mj_id2name(model, object_type, k) for k in range(count))
    return [name for name in names if name]


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
