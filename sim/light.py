"""How light is measured: 8 bits, or linear floating point over any dynamic range."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict

from emvs.parameters import ParameterGroup

LightRenderer = Literal["auto", "classic", "float"]


class LightConfig(ParameterGroup):
    """The picture's light."""

    model_config = ConfigDict(allow_inf_nan=False)

    renderer: LightRenderer = "auto"
    """`classic` draws 8 bits per channel and sample, cut at 1; `float` draws 32-bit linear light
    without end; `auto` takes `float` for scenes that say `hdr`, else `classic`."""

    def floats(self, hdr: bool) -> bool:
        """Whether a scene is drawn in floating point; `hdr` is what the scene asks for."""
        return self.renderer == "float" or (self.renderer == "auto" and hdr)
