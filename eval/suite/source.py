"""Where a suite's sequences come from: simulated here, or a folder that a plug-in can open.

A plug-in offers a function that takes the folder, and returns None where it holds something else:

    [project.entry-points."eventsweep.sequences"]
    mine = "my_package.sequences:opened"
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.plugins import SEQUENCES, loaded, points
from eventsweep.eval.jobs.job import Job
from eventsweep.eval.results.results import ArchiveFacts
from eventsweep.eval.suite.definition import Suite


class SequenceSource(Protocol):
    """Sequences with ground truth that somebody else made."""

    @property
    def facts(self) -> ArchiveFacts:
        """What results say of it."""

    def seeds(self, cases: Sequence[str], asked: Sequence[int]) -> tuple[int, ...]:
        """The seeds of a run where none are named: of those asked for, the ones that are there."""

    def sequence(self, suite: Suite, case: str, seed: int) -> tuple[Job, str]:
        """The job that brings the sequence of a case, and the hash of its scene."""


def open_source(folder: Path) -> SequenceSource:
    """Opens a folder of sequences.

    Raises:
        InputError: nothing here can open it, or what is in it is damaged.
    """
    for point in reversed(points(SEQUENCES)):  # ours last: it says what is wrong with a folder
        source: SequenceSource | None = loaded(point, "its sequences {} cannot be used")(folder)
        if source is not None:
            return source
    raise InputError(f"{folder}: no installed plug-in can read sequences from it")
