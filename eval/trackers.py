"""Trackers: plug-ins that find a recording's poses from its events.

A plug-in offers one under the name that `--poses` chooses it by:

    [project.entry-points."eventsweep.trackers"]
    mine = "my_package.tracker"
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from eventsweep.emvs.utils.plugins import TRACKERS, offered, points

if TYPE_CHECKING:
    from eventsweep.emvs.data.recording import Recording
    from eventsweep.eval.jobs.job import Runtime

TRUE = "true"
"""What `--poses` says for the recording's own."""


class Tracker(Protocol):
    """A module or an object with this name."""

    def track(self, recording: Recording, out: Path, runtime: Runtime, in_full: bool, /) -> None:
        """Finds the poses of a recording, whose own are not used, and writes them into `out`.

        Args:
            recording: events and calibration.
            out: a new folder for poses as `eval.found_poses` reads them, or why there are none.
            runtime: threads, and what shows how far it is.
            in_full: whether everything that the tracker can tell is written, too, for people.
        """


def names() -> tuple[str, ...]:
    """What `--poses` can say."""
    return TRUE, *(point.name for point in points(TRACKERS))


def tracker(name: str) -> Tracker:
    """Loads a tracker.

    Raises:
        InputError: no plug-in brings it, or the plug-in cannot be loaded.
    """
    return cast("Tracker", offered(TRACKERS, name, "tracker", names()))
