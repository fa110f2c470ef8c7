"""Depth maps of others as they are handed in: folders, or what a plug-in can unpack.

A plug-in offers a function that takes what was given, what is wanted and the cache, and returns
what `open_packages` does:

    [project.entry-points."eventsweep.predictions"]
    mine = "my_package.predictions:opened"
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.plugins import PREDICTIONS, loaded, points
from eventsweep.eval.scoring.predictions import NamedFolder
from eventsweep.eval.suite.definition import Suite

Stated = dict[str, Any]


@dataclass(frozen=True)
class Wanted:
    """What a prediction must hold: cases and seeds of a suite, of an archive's version if any."""

    suite: Suite
    cases: tuple[str, ...]
    seeds: tuple[int, ...]
    archive: str = ""


def open_packages(
    more: Sequence[str], wanted: Wanted, cache: Cache
) -> tuple[list[NamedFolder], Stated]:
    """Unpacks packed depth maps into the cache; plain folders stay as they are.

    They are those that the suite's definition names, and more, each `NAME=DIR` or `DIR`.

    Returns:
        The folders, in the order given; and by the method's name in scores, facts of those that
        state them.

    Raises:
        InputError: a package that is damaged, or holds something else than is wanted.
    """
    folders = [NamedFolder(Path(place), name) for name, place in wanted.suite.predictions.items()]
    folders += map(NamedFolder.of, more)
    stated: Stated = {}
    for point in reversed(points(PREDICTIONS)) if folders else ():  # ours last: it refuses the rest
        opened = loaded(point, "its predictions {} cannot be used")
        folders, facts = opened(folders, wanted, cache)
        stated |= facts
    return folders, stated
