"""Code beside the core: entry points of packages, functions named by the user, libraries of extras.

The plug-ins of this distribution, folders of `eventsweep.plugins`, come through the same entry
points as those of other packages.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from eventsweep.emvs.errors import InputError, heed_interrupt, offer, said
from eventsweep.emvs.utils.inputs import check_file
from eventsweep.emvs.utils.release import install_extra

Value = TypeVar("Value")
FUNCTION = "MODULE:FUNCTION or FILE.py:FUNCTION"
_NAMES = (
    "verbs", "methods", "devices", "trackers", "checks", "sequences", "predictions", "renderers",
    "scorers",
)  # fmt: skip
GROUPS = tuple(f"eventsweep.{name}" for name in _NAMES)
VERBS, METHODS, DEVICES, TRACKERS, CHECKS, SEQUENCES, PREDICTIONS, RENDERERS, SCORERS = GROUPS
"""Groups of entry points that the core reads; each is described where it is read."""
_OURS, _FOLDER = "eventsweep.plugins.", Path(__file__).parents[2] / "plugins"


@cache
def points(group: str) -> tuple[EntryPoint, ...]:
    """The entry points of a group, by name, those of our own plug-ins first.

    A plug-in whose folder was taken out of a checkout takes its entry points along.
    """
    found = sorted(entry_points(group=group), key=lambda point: (not is_ours(point), point.name))
    return tuple(point for point in found if not is_ours(point) or _is_there(point))


def is_ours(point: EntryPoint) -> bool:
    """Whether it is of a plug-in of this distribution."""
    return point.module.startswith(_OURS)


def _is_there(point: EntryPoint) -> bool:
    folder = point.module.removeprefix(_OURS).partition(".")[0]
    return (_FOLDER / folder / "__init__.py").is_file()


def modules_of(points: Iterable[EntryPoint]) -> tuple[str, ...]:
    """The modules of our own plug-ins that entry points lie in: their code counts by imports."""
    return tuple(dict.fromkeys(point.module for point in points if is_ours(point)))


def offered(group: str, name: str, kind: str, known: Iterable[str]) -> Any:
    """What a plug-in offers under a name, loaded.

    Raises:
        InputError: no plug-in offers it, with all names that are `known`; or it cannot be loaded.
    """
    for point in points(group):
        if point.name == name:
            return loaded(point, f"its {kind} {{}} cannot be used")
    raise InputError(f"unknown {kind} {name!r}: {offer(known, 'no plug-in offers one')}")


def loaded(point: EntryPoint, what: str) -> Any:
    """What an entry point names; errors are those of `run_point`."""
    return run_point(point, what, lambda found: found)


def run_point(point: EntryPoint, what: str, run: Callable[[Any], Value]) -> Value:
    """Loads an entry point of an installed package, and makes something of it by `run`.

    Raises:
        InputError: it cannot be imported, or fails; `what` names what does, with a place for it, as
            in `its scene {} cannot be loaded`.
    """
    try:
        return run(point.load())
    except Exception as error:  # whatever a stranger's code raises
        heed_interrupt(error)
        reason = " ".join(str(error).split()) or type(error).__name__
        package = point.dist.name if point.dist else "a package"
        raise InputError(
            f"{package}: {what.format(f'({point.name} = {point.value})')} ({reason}): fix or "
            "uninstall it"
        ) from error


def extra_module(name: str, purpose: str, extra: str, cure: str = "") -> Any:
    """Imports a library that comes with an extra.

    Raises:
        InputError: it cannot be loaded; begins with a `purpose`, as in `Parquet needs pyarrow`, and
            ends with a `cure` where the library is there.
    """
    try:
        return import_module(name)
    except (ImportError, OSError) as error:  # libraries of the system may be missing
        heed_interrupt(error)
        missing = isinstance(error, ModuleNotFoundError) and name.startswith(error.name or name)
        why = (
            f"is not installed: {install_extra(extra)}"
            if missing
            else f"fails: {said(error)}{cure}"
        )
        raise InputError(f"{purpose}, which {why}") from error


def files_of(points: Iterable[EntryPoint]) -> list[Path]:
    """All files of other packages that entry points lie in, but for what Python compiled of them.

    None of them is imported; a package that is not there has none.
    """
    files: set[Path] = set()
    for name in {point.module.partition(".")[0] for point in points if not is_ours(point)}:
        spec = find_spec(name)
        folders = [] if spec is None else spec.submodule_search_locations or []
        if spec is not None and spec.origin and not folders:
            files.add(Path(spec.origin))
        files |= {path for folder in folders for path in Path(folder).rglob("*") if path.is_file()}
    return sorted(path for path in files if path.suffix != ".pyc")


def named(name: str) -> Any:
    """What `FUNCTION` names; a module may lie in the working directory.

    Raises:
        InputError: no name of this form, or a file without the function.
        Exception: whatever the code raises while it is imported.
    """
    place, colon, attribute = name.rpartition(":")
    if not colon or not place or not attribute:
        raise InputError(f"needs {FUNCTION}")
    if not place.endswith(".py"):
        with _working_directory():
            return getattr(import_module(place), attribute)
    check_file(Path(place))  # a pipe would be waited for
    values = runpy.run_path(place, run_name="eventsweep_plugin")
    if attribute not in values:
        raise InputError(f"{place} has no function {attribute}")
    return values[attribute]


@contextmanager
def _working_directory() -> Iterator[None]:
    """Looks there last, so that nothing in it hides a module of the installation."""
    sys.path.append("")
    try:
        yield
    finally:
        sys.path.remove("")
