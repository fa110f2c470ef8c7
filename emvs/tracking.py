"""What finds poses while maps are made: it is fed events and maps, and says where the body was.

The mapper takes its poses from a recording, whenever it begins a window. So a tracker takes part by
`AlteredRecording(recording, trajectory=tracker)`.
"""

from __future__ import annotations

from typing import Protocol

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.geometry.trajectory import PoseSource
from eventsweep.emvs.reference_view import ReferenceView


class Tracker(PoseSource, Protocol):
    """Finds the poses of the body that carries the cameras."""

    def push(self, events: tuple[Events, ...], t_us: int) -> None:
        """Takes the events of every camera since the last call, and goes on to `t_us`."""

    def add_map(self, depth_map: DepthMap, view: ReferenceView) -> None:
        """Takes a map, which later events are tracked against, and the view that it belongs to."""
