"""A frame camera in the event camera's place: exposure time, gain, saturation, 8 bits.

What reports show beside events: motion blur where the exposure is long, noise-free black and white
where the light exceeds what 8 bits hold. Light is integrated exactly between linear frames that
are close in time, the same that the events come from.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from emvs.errors import InputError
from sim.config import SimConfig
from sim.motion import Motion
from sim.sampling import FrameSource, exposures

Light = NDArray[np.float32]


class ShutterConfig(BaseModel):
    """How a frame camera turns light into a picture."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    exposure_us: Annotated[int, Field(ge=1)] = 10_000
    """How long the shutter is open, µs."""

    gain: Annotated[float, Field(gt=0)] = 1.0
    """Pixel value per mean light: 1 saturates at intensity 1."""

    bits: Annotated[int, Field(ge=1, le=8)] = 8
    """Resolution of the converter."""


class Photograph(NamedTuple):
    """One picture of a frame camera.

    Attributes:
        image: (H, W) uint8, linear, 255 at saturation.
        light: (H, W) float32 mean intensity over the exposure.
        saturated: share of the pixels at the upper end.
        black: share of the pixels at 0.
    """

    image: NDArray[np.uint8]
    light: Light
    saturated: float
    black: float


def mean_light(frames: Iterable[tuple[int, Light]], start_us: int, end_us: int) -> Light:
    """Averages light over [`start_us`, `end_us`], linear between frames.

    Args:
        frames: times, µs, rising, and (H, W) intensities; read one by one.
        start_us: when the shutter opens, µs.
        end_us: when it closes, µs; later.

    Raises:
        InputError: the frames do not reach from the start to the end, or do not rise.
    """
    if end_us <= start_us:
        raise InputError(f"a shutter open from {start_us} to {end_us} µs: must close later")
    total: NDArray[np.float64] | None = None
    before: tuple[int, Light] | None = None
    reached_us = start_us
    for t_us, light in frames:
        if before is not None and t_us <= before[0]:
            raise InputError(f"frame at {t_us} µs after one at {before[0]} µs: times must rise")
        if before is not None and t_us > start_us and before[0] < end_us:
            part = _integral(before, (t_us, light), start_us, end_us)
            total = part if total is None else total + part
            reached_us = min(t_us, end_us)
        elif before is None and t_us > start_us:
            break
        before = (t_us, light)
    if total is None or reached_us < end_us:
        raise InputError(
            f"frames do not cover the exposure from {start_us} to {end_us} µs: render more of them"
        )
    return (total / (end_us - start_us)).astype(np.float32)


def _integral(
    a: tuple[int, Light], b: tuple[int, Light], start_us: int, end_us: int
) -> NDArray[np.float64]:
    """Light times µs of the part of [a, b] within the exposure, by the trapezoid's middle."""
    first_us, last_us = max(a[0], start_us), min(b[0], end_us)
    share = ((first_us + last_us) / 2 - a[0]) / (b[0] - a[0])
    middle = (1 - share) * a[1].astype(np.float64) + share * b[1]
    return (last_us - first_us) * middle


def develop(light: Light, shutter: ShutterConfig) -> Photograph:
    """Applies gain, saturation and quantisation to mean light (H, W)."""
    steps = (1 << shutter.bits) - 1
    level = np.rint(np.clip(shutter.gain * light.astype(np.float64), 0, 1) * steps)
    image = np.rint(level * (255 / steps)).astype(np.uint8)
    return Photograph(image, light, float((level == steps).mean()), float((level == 0).mean()))


def exposed_for(light: Light, percentile: float = 50.0, level: float = 0.45) -> float:
    """Returns the gain that puts a percentile of the light at `level` of full scale.

    Raises:
        InputError: no light there.
    """
    found = float(np.percentile(light, percentile))
    if found <= 0:
        raise InputError(f"percentile {percentile:g} of the light is {found:g}: needs some light")
    return level / found


def photograph(
    source: FrameSource,
    motion: Motion,
    camera: int,
    start_us: int,
    config: SimConfig,
    shutter: ShutterConfig,
) -> Photograph:
    """Takes a picture with one of the rig's cameras while the rig moves.

    Args:
        source: the renderer.
        motion: the head's curve.
        camera: which camera.
        start_us: when the shutter opens, µs.
        config: how densely frames are taken during the exposure.
        shutter: exposure, gain and bits.

    Raises:
        InputError: motion too fast for the configuration.
    """
    end_us = start_us + shutter.exposure_us
    taken = exposures(source, motion, [start_us, end_us], config)
    frames = ((e.t_us, e.frames[camera].intensity) for e in taken)
    return develop(mean_light(frames, start_us, end_us), shutter)
