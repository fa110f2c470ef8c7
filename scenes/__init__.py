"""The scenes: one module each, found by themselves.

A module of this package that does not begin with an underscore is a scene and defines `SCENE`; what
scenes share lies in the packages `scenes.parts` and `scenes.textures`. A scene is called what its
module is called, with dashes for underscores; both spellings are taken.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

from emvs.errors import InputError, shown

if TYPE_CHECKING:
    from sim.scene import Scene


def names() -> tuple[str, ...]:
    """Returns the names of all scenes, sorted, without importing them."""
    found = pkgutil.iter_modules(__path__)
    modules = [m.name for m in found if not m.ispkg and not m.name.startswith("_")]
    return tuple(sorted(module.replace("_", "-") for module in modules))


def load(name: str) -> Scene:
    """Returns the scene called `name`, with dashes or underscores.

    Raises:
        InputError: there is no such scene.
    """
    if not isinstance(name, str) or name.replace("_", "-") not in names():
        raise InputError(f"unknown scene {shown(name)}: choose one of {', '.join(names())}")
    module = importlib.import_module(f"{__name__}.{name.replace('-', '_')}")
    scene: Scene = module.SCENE
    return scene


def summaries() -> dict[str, str]:
    """Returns one sentence for each scene."""
    return {name: load(name).summary for name in names()}
