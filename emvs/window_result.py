"""One mapped window: depth maps by method, and what became of its events and votes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.dsi.rays import RayCounts
from eventsweep.emvs.dsi.slices import Slices
from eventsweep.emvs.dsi.voting import VoteCounts
from eventsweep.emvs.errors import ByName
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.windows import Window


@dataclass(frozen=True)
class CameraCounts:
    """What became of one camera's events and of their votes.

    Attributes:
        events: by event; `events.rays` of them voted, once per plane.
        votes: by event and plane.
    """

    events: RayCounts
    votes: VoteCounts

    def to_json(self) -> dict[str, int]:
        """Plain numbers; `events` is the sum of the five that follow it."""
        return {
            "events": self.events.events,
            "voting": self.events.rays,
            "without_pose": self.events.without_pose,
            "without_ray": self.events.without_ray,
            "looking_backwards": self.events.backwards,
            "dropped_tail": self.events.dropped,
            "votes_counted": self.votes.counted,
            "votes_outside_image": self.votes.outside,
            "votes_behind_camera": self.votes.behind,
        }


@dataclass(frozen=True, eq=False)
class WindowResult:
    """One window, mapped.

    Attributes:
        window: the stretch of time.
        view: the reference view.
        depth_maps: method name -> depth map.
        counts: one per camera.
        slices: one image row of every fused volume.
        event_image: (2, H, W) uint32 events of camera 0 per pixel: darker, brighter.
        seconds: wall time per stage.
        config: what was asked for.
        device: what computed the sweep: `cpu`, or a GPU's name; `cpu` where only baselines ran.
    """

    window: Window
    view: ReferenceView
    depth_maps: Mapping[str, DepthMap]
    counts: tuple[CameraCounts, ...]
    slices: Slices
    event_image: NDArray[np.uint32]
    seconds: Mapping[str, float]
    config: MapperConfig
    device: str = "cpu"

    def __post_init__(self) -> None:
        object.__setattr__(self, "depth_maps", ByName("method", self.depth_maps))

    def __repr__(self) -> str:
        camera, window = self.view.camera, self.window
        points = ", ".join(
            f"{name} {depth_map.points}" for name, depth_map in self.depth_maps.items()
        )
        return (
            f"WindowResult({window.t0_us} to {window.t1_us} µs, view of {camera.width_px} x "
            f"{camera.height_px} px at {window.t_ref_us} µs, on {self.device};\n"
            f"  points: {points})"
        )
