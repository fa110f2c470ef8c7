"""Submissions and entries as predictions of a suite, and archives as its sequences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval.scoring.predictions import NamedFolder
from eventsweep.eval.suite.packages import Wanted
from eventsweep.plugins.ranking.archive import SequenceArchive
from eventsweep.plugins.ranking.entry import is_entry, package_of
from eventsweep.plugins.ranking.submission import Asked
from eventsweep.plugins.ranking.submission import opened as opened_submissions


def opened(
    given: Sequence[NamedFolder], wanted: Wanted, cache: Cache
) -> tuple[list[NamedFolder], dict[str, Any]]:
    """Unpacks submissions, for the group `eventsweep.predictions`."""
    asked = Asked(wanted.suite, wanted.cases, wanted.seeds, wanted.archive)
    return opened_submissions([_package(one) for one in given], asked, cache)


def sequences(folder: Path) -> SequenceArchive:
    """Opens an archive, for the group `eventsweep.sequences`."""
    return SequenceArchive(folder)


def _package(given: NamedFolder) -> NamedFolder:
    """Of an entry to a ranking its package; anything else as it is."""
    return given._replace(path=package_of(given.path)) if is_entry(given.path) else given
