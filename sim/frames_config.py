"""Every parameter of the ordinary camera in the event camera's place; imports no numpy."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from emvs.parameters import ParameterGroup


class ShutterConfig(ParameterGroup):
    """How a frame camera turns light into a picture."""

    model_config = ConfigDict(allow_inf_nan=False)

    exposure_us: Annotated[int, Field(ge=1)] = 10_000
    """How long the shutter is open, µs."""

    gain: Annotated[float, Field(gt=0)] = 1.0
    """Pixel value per mean light: 1 saturates at intensity 1."""

    bits: Annotated[int, Field(ge=1, le=8)] = 8
    """Resolution of the converter."""


class FramesConfig(ParameterGroup):
    """The pictures that an ordinary camera takes in the place of each event camera."""

    model_config = ConfigDict(allow_inf_nan=False)

    rate_hz: Annotated[float, Field(ge=0, le=10_000)] | None = None
    """Pictures per second, Hz; 0 for none; None takes the scene's own, which is 0 for most."""

    exposure_us: Annotated[int, Field(ge=1)] = 10_000
    """How long the shutter is open, µs."""

    gain: Annotated[float, Field(gt=0)] | None = None
    """Pixel value per mean light: 1 saturates at intensity 1; None exposes each picture by itself.
    """

    bits: Annotated[int, Field(ge=1, le=8)] = 8
    """Resolution of the converter."""

    auto_percentile: Annotated[float, Field(ge=0, le=100)] = 50.0
    """Automatic gain looks at this percentile of a picture's light ..."""

    auto_level: Annotated[float, Field(gt=0, le=1)] = 0.18
    """... and puts it at this share of full scale (a grey card has 0.18) ..."""

    auto_max_gain: Annotated[float, Field(gt=0)] = 256.0
    """... unless that takes a gain beyond this one: dark scenes stay dark."""
