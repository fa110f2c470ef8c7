"""Submissions and entries as predictions of a suite, and archives as its sequences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.scoring.predictions import NamedFolder
from eventsweep.eval.suite.packages import Wanted
from eventsweep.plugins.ranking import submission
from eventsweep.plugins.ranking.archive import SequenceArchive
from eventsweep.plugins.ranking.entry import is_entry, package_of

sequences = SequenceArchive
"""Opens an archive in a folder, for the group `eventsweep.sequences`."""


def opened(
    given: Sequence[NamedFolder], wanted: Wanted, cache: Cache
) -> tuple[list[NamedFolder], dict[str, Any]]:
    """Unpacks submissions and those of entries, for the group `eventsweep.predictions`."""
    folders = [
        folder._replace(path=package_of(folder.path)) if is_entry(folder.path) else folder
        for folder in given
    ]
    return submission.opened(folders, wanted, cache)
