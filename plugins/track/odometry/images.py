"""Images of half the resolution: events as pixels of twice the size would give them.

A pixel of twice the size sees the mean log intensity of the four under it, so it passes the same
contrast threshold once their events, brighter ones less darker ones, have come to four. What is
left counts on. A sensor of a megapixel then gives about a sixth of the events.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.track.odometry.checkpoint import State
from eventsweep.plugins.track.odometry.registration.events_kernels import halve
from eventsweep.plugins.track.odometry.start import Past

_TWO = np.uint16(2)


def half_camera(camera: Camera) -> Camera:
    """The same lens on a sensor of half as many columns and rows; an odd last one is left out.

    Pixel (i, j) covers (2 i, 2 j) to (2 i + 1, 2 j + 1), so its centre lies between them.
    """
    return replace(
        camera,
        width_px=camera.width_px // 2, height_px=camera.height_px // 2,
        fx_px=camera.fx_px / 2, fy_px=camera.fy_px / 2,
        cx_px=(camera.cx_px - 0.5) / 2, cy_px=(camera.cy_px - 0.5) / 2,
    )  # fmt: skip


class Images:
    """What is tracked of a rig's images: all, or half of their columns and rows.

    Packets of any size give the same events.

    Attributes:
        rig: with cameras of the resolution that is tracked.
    """

    def __init__(self, rig: Rig, *, half: bool) -> None:
        self._given, self._half = rig, half
        self.rig = replace(rig, cameras=tuple(map(half_camera, rig.cameras))) if half else rig
        self._sums: list[NDArray[np.int8]] = [
            np.zeros((camera.height_px, camera.width_px), np.int8) for camera in self.rig.cameras
        ]

    def __call__(self, packets: Sequence[Events]) -> Sequence[Events]:
        """The events that come with these of each camera."""
        if not self._half:
            return packets
        return [_halved(*each) for each in zip(packets, self._sums, strict=True)]

    def past(self, past: Past | None) -> Past | None:
        """What `past` gives, in these images; sums begin with each call."""
        if past is None:
            return None
        return lambda t0_us, t1_us: Images(self._given, half=self._half)(past(t0_us, t1_us))

    def state(self) -> State:
        """What is left of every larger pixel's sum."""
        return {"sums": [sums.copy() for sums in self._sums] if self._half else []}

    def restore(self, state: State) -> None:
        """Takes what `state` gave."""
        self._sums = state["sums"]


def _halved(events: Events, sums: NDArray[np.int8]) -> Events:
    chosen = np.empty(len(events), np.int64)
    kept = events.take(chosen[: halve(events.x, events.y, events.p, sums, chosen)])
    return Events(kept.x // _TWO, kept.y // _TWO, kept.t_us, kept.p)
