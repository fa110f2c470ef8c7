"""What looks doubtful before a recording is mapped, for the group `eventsweep.checks`."""

from __future__ import annotations

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.plugins.diagnose.check.recording import quick_check


def doubts(recording: Recording, config: MapperConfig) -> list[str]:
    """A line on each doubtful or wrong finding that needs no mapping."""
    return [finding.line() for finding in quick_check(recording, config)]
