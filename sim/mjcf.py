"""Files of models that MuJoCo knows: MJCF and URDF, with their meshes and textures."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from hashlib import sha256
from html import unescape
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from eventsweep.emvs.errors import InputError, located, printable
from eventsweep.emvs.utils.inputs import check_file, names_others, read_text
from eventsweep.emvs.utils.processes import bounded
from eventsweep.sim.graphics import import_mujoco

if TYPE_CHECKING:
    import mujoco

# Groups of geoms from this one on are not drawn.
_HIDDEN = 3
_ROBOT = re.compile(r"<robot\b[^>]*>")
_LINK = re.compile(r"""<link\b[^>]*?\bname\s*=\s*["']([^"']+)["']""")
KEEPS_LINKS = '<mujoco><compiler fusestatic="false"/></mujoco>'
"""What keeps all links of a robot in a URDF; it draws what it does without."""
_KEEPS = re.compile(r"<mujoco>\s*<compiler\s+fusestatic\s*=\s*[\"']false[\"']\s*/>\s*</mujoco>")
_VISIBLE = '<mujoco><compiler discardvisual="false"/></mujoco>'
_PACKAGE = "package:"
_FILE = re.compile(r"""\bfile\w*\s*=\s*["']([^"']+)["']""")
_FOLDER = re.compile(r"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"']+)["']""")
_XML_BYTES = 1 << 26
_ASSET_BYTES, _HEAD_BYTES = 1 << 32, 256
# What MuJoCo may take to compile a model, and what it may for each byte of its files.
_MODEL_BYTES, _MODEL_RATIO = 3 << 28, 30
_MODEL_S, _MODEL_S_PER_BYTE = 20, 1e-5
_MOST_COPIES, _MOST_VALUES, _MOST_DIGITS = 1_000_000, 1 << 28, 10
_SIDES = ("width", "height", "nrow", "ncol")
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
    _check_there(path)
    try:
        if path.suffix.lower() == ".urdf":
            return _robot(mj, path)
        return mj.MjSpec.from_file(str(path.resolve()))
    except ValueError as error:
        raise InputError(f"{path} is not valid MJCF ({_line(error)}): correct it") from error


def _check_there(path: Path) -> None:
    if not path.exists():
        raise InputError(f"{path}: no such file: name a model in MJCF (.xml) or URDF (.urdf)")
    check_file(path, _XML_BYTES)


def _robot(mj: Any, path: Path) -> mujoco.MjSpec:
    """A URDF with its visual geometry, which MuJoCo leaves out unless the file says otherwise."""
    text = read_text(path, _XML_BYTES)
    visible, keeps = _VISIBLE, _KEEPS.search(text)
    if keeps:
        text, visible = _KEEPS.sub("", text), _VISIBLE.replace("/>", ' fusestatic="false"/>')
    if "<mujoco" in text:
        return mj.MjSpec.from_file(str(path.resolve()))
    spec = mj.MjSpec.from_string(_ROBOT.sub(rf"\g<0>{visible}", text, count=1))
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
            if os.path.isfile(root / rest):  # noqa: PTH113 - bears any name
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
    _check_there(path)  # of links in a circle Python finds no end
    return _model_of(path.resolve(), tuple(digests(path).items()))


@lru_cache(maxsize=1)
def _model_of(path: Path, _digests: tuple[tuple[str, str], ...]) -> Any:
    """Compiles a model in a process of its own: a few words can ask MuJoCo for any memory."""
    mj, files = import_mujoco(), files_of(path)
    for file in filter(_is_model, files):
        _check_claims(file)
    size = sum(file.stat().st_size for file in files)
    with _memory_file() as made:
        bounded(
            str(path),
            lambda: _save_compiled(mj, path, made),
            memory_bytes=_MODEL_BYTES + _MODEL_RATIO * size,
            cpu_s=_MODEL_S + round(size * _MODEL_S_PER_BYTE),
        )
        return mj.MjModel.from_binary_path(str(made))


def _save_compiled(mj: Any, path: Path, made: Path) -> None:
    mj.set_mju_user_warning(lambda _text: None)  # MuJoCo's own leaves a log in the user's folder
    mj.mj_saveModel(_compiled_at(path), str(made), None)


def _compiled_at(path: Path) -> Any:
    spec = read_spec(path)
    with located(path):
        return compiled(spec)


@contextmanager
def _memory_file() -> Iterator[Path]:
    """A file that a child process may fill, gone afterwards."""
    if hasattr(os, "memfd_create"):
        number = os.memfd_create("model.mjb")
        try:
            yield Path(f"/proc/self/fd/{number}")
        finally:
            os.close(number)
    else:
        with TemporaryDirectory() as folder:
            yield Path(folder) / "model.mjb"


def _check_claims(file: Path) -> None:
    """Refuses what a few words ask for and no computer has: copies, textures and height fields."""
    copied, above = 0, [1]

    def start(name: str, values: dict[str, str]) -> None:
        nonlocal copied
        count, *sides = (
            int(word[:_MOST_DIGITS]) if word.isdecimal() else 1
            for word in (values.get(key, "") for key in ("count", *_SIDES))
        )
        above.append(above[-1] * (count if name == "replicate" else 1))
        copied += above[-1] if above[-1] > 1 else 0
        if copied > _MOST_COPIES:
            raise InputError(
                f"{file}: its replicates stand for more than {_MOST_COPIES} elements: ask for "
                "fewer copies"
            )
        if name in ("texture", "hfield") and prod(sides) > _MOST_VALUES:
            raise InputError(
                f"{file}: a {name} of {prod(sides)} values, at most {_MOST_VALUES}: make it smaller"
            )

    reader = expat.ParserCreate()
    reader.StartElementHandler = start
    reader.EndElementHandler = lambda _name: above.pop()
    with suppress(expat.ExpatError):  # MuJoCo says it better
        reader.Parse(file.read_bytes(), True)


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
        for file in {file for file in files if _is_model(file)} - texts.keys():
            texts[file] = file.read_text(encoding="utf-8", errors="replace")
        said = {"", *(unescape(name) for text in texts.values() for name in _FOLDER.findall(text))}
        roots = {
            root / name for root in (folder, *(file.parent for file in texts)) for name in said
        }
        names = {unescape(name) for text in texts.values() for name in _FILE.findall(text)}
        files |= {file.resolve() for file in _places(names, roots, folder) if _is_there(file)}
    return sorted(file for file in files if file.is_file())


names_others(SUFFIXES, files_of)


def _is_model(file: Path) -> bool:
    """Whether a file holds XML, which may name others; an include may have any name."""
    if not file.is_file() or file.stat().st_size > _XML_BYTES:
        return False
    with file.open("rb") as stream:
        return stream.read(_HEAD_BYTES).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def _is_there(file: Path) -> bool:
    """Whether a file is there that MuJoCo may open; refuses what it would wait for, or never end.

    A folder is left alone: it may have the name of a file that lies elsewhere.
    """
    try:
        if os.path.isdir(file):  # noqa: PTH112
            return False
        check_file(file, _ASSET_BYTES)
    except (OSError, ValueError):  # not there, or no name of a file
        if os.path.exists(file):  # noqa: PTH110 - bears a name that is too long
            raise
        return False
    return True


def _places(names: set[str], roots: set[Path], folder: Path) -> Iterator[Path]:
    for name in names:
        known = _resolved(name, folder)
        yield from (root / place for root in roots for place in {known, Path(known).name})


def links_of(path: Path) -> list[str]:
    """The links of a robot in a URDF; none of another model."""
    is_robot = path.suffix.lower() == ".urdf"
    return _LINK.findall(read_text(path, _XML_BYTES)) if is_robot else []


def named(mj: Any, model: Any, kind: str) -> list[str]:
    """Names of a model's bodies, sites, cameras, joints or keys; those without a name left out."""
    count = getattr(model, {"body": "nbody", "site": "nsite", "camera": "ncam",
                            "joint": "njnt", "key": "nkey"}[kind])  # fmt: skip
    object_type = getattr(mj.mjtObj, f"mjOBJ_{kind.upper()}")
    names = (mj.mj_id2name(model, object_type, k) for k in range(count))
    return [name for name in names if name]


def _line(error: Exception) -> str:
    return printable(str(error), 400)
