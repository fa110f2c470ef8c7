"""A frame camera in the event camera's place: exposure, blur, gain, saturation, 8 bits.

What reports show beside events: motion blur where the exposure is long, noise-free black and white
where the light exceeds what 8 bits hold. Light is integrated exactly between linear frames that
are close in time, the same that the events come from.

Every frame that is rendered for the events also goes into the exposure that is open; nothing is
rendered for the pictures alone, and events do not depend on whether pictures are taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.errors import InputError
from eventsweep.sim.config import FramesConfig

DENSE_PX = 0.5
"""Pictures this far apart, at most, are taken for linear in time, px."""
Light = NDArray[np.float32]
TimedLight = tuple[int, Light]
"""A frame: time, µs, and (H, W) linear intensity."""
State = dict[str, NDArray[Any]]


def blurred(light: Light, sigma_px: float) -> Light:
    """(H, W) light through a lens whose point spread function has this standard deviation, px.

    Beyond the edges the picture is mirrored, so that no light is lost. A `sigma_px` of 0 returns
    the light as it is.
    """
    if not sigma_px:
        return light
    # Of float pictures, cv2 takes the Gaussian to four standard deviations.
    border = cv2.BORDER_REFLECT
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma_px, borderType=border), np.float32)


class Exposure:
    """A shutter that is open from `start_us` to `end_us`: sums up the light, linear between frames.

    Raises:
        InputError: it closes before it opens.
    """

    def __init__(self, start_us: int, end_us: int) -> None:
        if end_us <= start_us:
            raise InputError(f"a shutter open from {start_us} to {end_us} µs: must close later")
        self.start_us, self.end_us = start_us, end_us
        self.total: NDArray[np.float64] | None = None

    def add(self, before: TimedLight, after: TimedLight) -> None:
        """Adds what comes in between two frames; they may reach beyond the exposure."""
        if after[0] > self.start_us and before[0] < self.end_us:
            part = _integral(before, after, self.start_us, self.end_us)
            self.total = part if self.total is None else self.total + part

    def light(self) -> Light:
        """(H, W) mean light of the whole exposure."""
        assert self.total is not None
        return (self.total / (self.end_us - self.start_us)).astype(np.float32)


def _integral(a: TimedLight, b: TimedLight, start_us: int, end_us: int) -> NDArray[np.float64]:
    """Light times µs of the part of [a, b] within the exposure, by the trapezoid's middle."""
    first_us, last_us = max(a[0], start_us), min(b[0], end_us)
    share = ((first_us + last_us) / 2 - a[0]) / (b[0] - a[0])
    middle = (1 - share) * a[1].astype(np.float64) + share * b[1]
    return (last_us - first_us) * middle


def develop(light: Light, gain: float = 1.0, bits: int = 8) -> NDArray[np.uint8]:
    """(H, W) uint8, linear, 255 at saturation: mean light after gain, saturation, quantisation.

    A gain of 1 saturates at intensity 1.
    """
    steps = (1 << bits) - 1
    level = np.rint(np.clip(gain * light.astype(np.float64), 0, 1) * steps)
    return np.rint(level * (255 / steps)).astype(np.uint8)


def gain_for(light: Light, frames: FramesConfig) -> float:
    """The gain for a picture of some mean light (H, W): as set, or automatic."""
    if frames.gain is not None:
        return frames.gain
    least = frames.auto_level / frames.auto_max_gain
    return frames.auto_level / max(float(np.percentile(light, frames.auto_percentile)), least)


def exposure_spans_us(frames: FramesConfig, duration_us: int) -> list[tuple[int, int]]:
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
    """One ordinary camera in the place of each event camera, behind the same lens.

    `state` says where another camera of the same arguments stopped; `lens_blur_px` is that of
    `blurred`.
    """

    def __init__(
        self, frames: FramesConfig, duration_us: int, state: Mapping[str, NDArray[Any]] | None,
        lens_blur_px: float = 0.0,
    ) -> None:  # fmt: skip
        self._lens_blur_px = lens_blur_px
        self._frames, self._spans_us = frames, exposure_spans_us(frames, duration_us)
        self._next = 0
        self._open: list[Exposure] = []
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

    def exposes(self, t_us: int) -> bool:
        """Whether a shutter is open at some time between the frame taken last and `t_us`, µs."""
        if not self._before or self._next == len(self._spans_us):
            return False
        return self._spans_us[self._next][0] < t_us

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

    def _exposing(self, cameras: int) -> list[Exposure]:
        if not self._open:
            span_us = self._spans_us[self._next]
            self._open = [Exposure(*span_us) for _ in range(cameras)]
        return self._open

    def _developed(self, exposing: Exposure) -> Photo:
        light = blurred(exposing.light(), self._lens_blur_px)
        gain = gain_for(light, self._frames)
        image = develop(light, gain, self._frames.bits)
        return Photo(exposing.start_us, exposing.end_us, gain, image)
