"""The pictures of ordinary cameras, taken while the events are simulated, from the same light.

Every frame that is rendered for the events also goes into the exposure that is open; nothing is
rendered for the pictures alone, and events do not depend on whether pictures are taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emvs.data.image_stores import Photo
from emvs.errors import InputError
from sim.exposure import Exposing, Light, TimedLight, develop, shutter_for
from sim.frames_config import FramesConfig

State = dict[str, NDArray[Any]]


def spans_us(frames: FramesConfig, duration_us: int) -> list[tuple[int, int]]:
    """When the shutters open and close, µs: centred on multiples of the frame interval.

    Only whole exposures count, so there is no picture at 0.

    Raises:
        InputError: an exposure longer than the interval between pictures.
    """
    if not frames.rate_hz:
        return []
    interval_us, exposure_us = 1e6 / frames.rate_hz, frames.exposure_us
    if exposure_us > interval_us:
        raise InputError(
            f"frames.exposure_us={exposure_us}, but at frames.rate_hz={frames.rate_hz:g} there are "
            f"{interval_us:.0f} µs between frames: expose for less, or lower the rate"
        )
    middles_us = [round(k * interval_us) for k in range(int(duration_us / interval_us) + 1)]
    starts_us = [middle_us - exposure_us // 2 for middle_us in middles_us]
    return [(t, t + exposure_us) for t in starts_us if t >= 0 and t + exposure_us <= duration_us]


class FrameCamera:
    """One ordinary camera in the place of each event camera.

    Args:
        frames: rate, exposure, gain and bits.
        duration_us: length of the sequence, µs.
        state: where another photographer of the same arguments stopped.
    """

    def __init__(
        self, frames: FramesConfig, duration_us: int, state: Mapping[str, NDArray[Any]] | None
    ) -> None:
        self._frames, self._spans_us = frames, spans_us(frames, duration_us)
        self._next = 0
        self._open: list[Exposing] = []
        self._before: list[TimedLight] = []
        if state is not None and self._spans_us:
            self._restore(state)

    def take(self, t_us: int, lights: Sequence[Light]) -> list[tuple[Photo, ...]]:
        """Takes the next frame of all cameras; returns the pictures that it completes."""
        if self._next == len(self._spans_us):
            return []
        now = [(t_us, light) for light in lights]
        before, self._before = self._before, now
        done: list[tuple[Photo, ...]] = []
        while before and self._next < len(self._spans_us) and t_us > self._spans_us[self._next][0]:
            exposing = self._exposing(len(lights))
            for camera, pair in zip(exposing, zip(before, now, strict=True), strict=True):
                camera.add(*pair)
            if t_us < exposing[0].end_us:
                break
            done.append(tuple(self._developed(camera) for camera in exposing))
            self._open, self._next = [], self._next + 1
        return done

    def state(self) -> State:
        """Everything that later pictures depend on."""
        if not self._spans_us or not self._before:
            return {}
        state: State = {"photos/next": np.array(self._next)}
        state["photos/t_us"] = np.array(self._before[0][0])
        state["photos/cameras"] = np.array(len(self._before))
        for k, (_, light) in enumerate(self._before):
            state[f"photos/{k}/light"] = light
        for k, exposing in enumerate(self._open):
            assert exposing.total is not None
            state[f"photos/{k}/total"] = exposing.total
        return state

    def _restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self._next, cameras = int(state["photos/next"]), int(state["photos/cameras"])
        t_us = int(state["photos/t_us"])
        self._before = [(t_us, state[f"photos/{k}/light"]) for k in range(cameras)]
        if "photos/0/total" in state:
            for k, exposing in enumerate(self._exposing(cameras)):
                exposing.total = state[f"photos/{k}/total"]

    def _exposing(self, cameras: int) -> list[Exposing]:
        if not self._open:
            span_us = self._spans_us[self._next]
            self._open = [Exposing(*span_us) for _ in range(cameras)]
        return self._open

    def _developed(self, exposing: Exposing) -> Photo:
        light = exposing.light()
        shutter = shutter_for(light, self._frames)
        image = develop(light, shutter).image
        return Photo(exposing.start_us, exposing.end_us, shutter.gain, image)
