"""The scenes: one module each, found by themselves.

A module of this package that does not begin with an underscore is a scene and defines `SCENE`; what
scenes share lies in the packages `scenes.parts` and `scenes.textures`. A scene is called what its
module is called, with dashes for underscores; both spellings are taken. Scenes of one place are
rows of its module, which `_ROWS` lists, in `SCENES`. Other packages add scenes by an entry point of
the group `eventsweep.scenes`, `NAME = "MODULE:ATTRIBUTE"`; and the path of a model (MJCF or URDF)
stands for a scene in `prepared`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from eventsweep.emvs.errors import InputError, shown
from eventsweep.emvs.utils.plugins import run_point
from eventsweep.sim.mjcf import is_model_file

if TYPE_CHECKING:
    from eventsweep.emvs.geometry.rig import Rig
    from eventsweep.sim.config import SimConfig
    from eventsweep.sim.scene import Scene

GROUP = "eventsweep.scenes"
_ROWS = {
    "desk": ("trinocular-desk",),
    "parts.den": ("hdr-night", "hdr-window"),
    "parts.mocap": ("tumvie-1d", "tumvie-3d", "tumvie-6dof", "tumvie-desk2"),
    "parts.office": ("rpg-bin", "rpg-boxes", "rpg-monitor", "rpg-reader"),
}


class Prepared(NamedTuple):
    """What a simulation needs of a scene.

    Attributes:
        scene: geometry and motion.
        rig: the cameras.
        config: the parameters, with what the scene says of them.
    """

    scene: Scene
    rig: Rig
    config: SimConfig


def names() -> tuple[str, ...]:
    """Returns the names of all scenes, sorted, without importing them."""
    return tuple(sorted({*_own(), *_points()}))


def load(name: str) -> Scene:
    """Returns the scene called `name`, with dashes or underscores.

    Raises:
        InputError: there is no such scene, or the package that it comes from fails.
    """
    known = name.replace("_", "-") if isinstance(name, str) else ""
    if known in _own():
        module = importlib.import_module(module_of(known))
        scene: Scene = getattr(module, "SCENES", {}).get(known) or module.SCENE
        return scene
    if known in _points():
        return _of_point(_points()[known])
    raise InputError(f"unknown scene {shown(name)}: choose one of {', '.join(names())}")


def module_of(name: str) -> str:
    """Name of the module that a scene is defined in."""
    known = name.replace("_", "-")
    return f"{__name__}.{_own()[known]}" if known in _own() else _points()[known].module


def summaries() -> dict[str, str]:
    """Returns one sentence for each scene."""
    return {name: load(name).summary for name in names()}


def case_name(scene: str) -> str:
    """What results call a scene: its name, or that of a model's file."""
    return Path(scene).stem if is_model_file(scene) else scene


def rig_for(scene: str, rig: Rig | str | None, config: SimConfig) -> Rig:
    """The cameras that look at a scene: a rig's, its own, or those of a model.

    Raises:
        InputError: an unknown scene, rig or camera.
    """
    if rig is not None and not isinstance(rig, str):
        return rig
    from eventsweep.sim.rigs import rig as named_rig

    if is_model_file(scene):
        from eventsweep.sim.model.scenes import rig_on

        return rig_on(Path(scene), rig, config.model.mount)
    return named_rig(rig or load(scene).rig)


def prepared(
    scene: str,
    rig: Rig | str | None,
    config: SimConfig,
    seed: int,
    notice: Callable[[str], None] = lambda _line: None,
) -> Prepared:
    """A scene by its name, or made of a model's file; with the cameras that look at it.

    Args:
        scene: name, or path of a model in MJCF or URDF.
        rig: a rig, its name or calibration, or `model:NAME,NAME` for a model's own cameras; by
            default the scene's.
        config: the parameters.
        seed: of the motion.
        notice: called with one line about anything that may be unwanted.

    Raises:
        InputError: an unknown scene, rig, camera or renderer, or an unusable model.
    """
    from eventsweep.sim.rendering.drawing import drawing_of

    drawing_of(config)  # before MuJoCo is imported: a plug-in needs no graphics library
    chosen = rig_for(scene, rig, config)
    if not is_model_file(scene):
        if asked := sorted(config.model.model_fields_set - {"files", "sha256"}):
            raise InputError(
                f"{', '.join(asked)} given for scene {scene}, but only model files take it: leave "
                "it out, or name a file in MJCF (.xml) or URDF (.urdf)"
            )
        return Prepared(load(scene), chosen, config)
    from eventsweep.sim.model.scenes import scene_of

    made, noted = scene_of(Path(scene), config, chosen, seed, notice)
    return Prepared(made, chosen, noted)


def _own() -> dict[str, str]:
    """The module of each scene of this package."""
    modules = [m.name for m in pkgutil.iter_modules(__path__) if not m.ispkg]
    single = {name.replace("_", "-"): name for name in modules if not name.startswith("_")}
    return single | {name: module for module, names in _ROWS.items() for name in names}


@cache
def _points() -> dict[str, EntryPoint]:
    return {point.name.replace("_", "-"): point for point in entry_points(group=GROUP)}


def _of_point(point: EntryPoint) -> Scene:
    from eventsweep.sim.scene import Scene

    found = run_point(point, "its scene {} cannot be loaded", lambda scene: scene)
    if not isinstance(found, Scene):
        raise InputError(
            f"{point.name} = {point.value} is a {type(found).__name__}, not a Scene: fix or "
            "uninstall its package"
        )
    return found
