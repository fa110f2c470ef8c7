"""Trackers: plug-ins that find a recording's poses from its events.

A plug-in offers one under the name that `--poses` chooses it by:

    [project.entry-points."eventsweep.trackers"]
    mine = "my_package.tracker"
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from eventsweep.emvs.utils.plugins import TRACKERS, offered, points

if TYPE_CHECKING:
    from eventsweep.eval.progress import Display

TRUE = "true"
"""What `--poses` says for the recording's own."""


class Tracker(Protocol):
    """A module or an object with these names."""

    STAGE: str
    """The module of its stage of jobs, which does what `eval.suite.stages` says of `track`."""

    def track_stage(self, progress: Display, /) -> Callable[[Path, Path], None]:
        """Tracks a recording, its first argument, into a folder, its second.

        The folder holds poses as `eval.found_poses` reads them, or why there are none.
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
