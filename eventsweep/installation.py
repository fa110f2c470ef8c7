"""Our packages have plain names: finds out what hides them, and puts ours first."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path

PACKAGES = ("emvs", "sim", "scenes", "eval")
"""Each imports only those before it."""

ROOT = Path(__file__).resolve().parents[1]
"""The folder that holds this package and the others."""

# Modules of this package that do without the last ones of `PACKAGES`.
_LAST_PACKAGE = {"eventsweep.mapping": "emvs", "eventsweep.simulation": "scenes"}


def hiding(package: str) -> Path | None:
    """What Python would import in the place of a package of ours; None where it is ours."""
    place = _place(package)
    if place is None or place.parent == ROOT / package:
        return None
    return place.parent if place.name == "__init__.py" else place


def _place(package: str) -> Path | None:
    """The file that a package is, or would be, imported from; None where there is none."""
    module = sys.modules.get(package)
    if module is not None:
        file = getattr(module, "__file__", None)
    else:
        spec = importlib.util.find_spec(package)
        file = None if spec is None else spec.origin
    return None if file is None else Path(file).resolve()


def refuse_hidden(module: str) -> None:
    """Refuses to import a module whose packages are hidden by others of the same name.

    Raises:
        ImportError: says in one line which folder or file hides which package.
    """
    for package in _needed(module):
        other = hiding(package)
        if other is not None:
            raise ImportError(
                f"{other} is not eventsweep's own package {package}, which it hides: rename it, or "
                "start Python where it is not on sys.path"
            )


def put_first() -> None:
    """Lets this process, and those that it starts, import our packages and no others."""
    if any(hiding(package) is not None for package in PACKAGES):
        sys.path.insert(0, str(ROOT))
        importlib.invalidate_caches()


def _needed(module: str) -> tuple[str, ...]:
    package = module.split(".")[0]
    if package not in PACKAGES:
        package = _LAST_PACKAGE.get(module, PACKAGES[-1])
    return PACKAGES[: PACKAGES.index(package) + 1]
