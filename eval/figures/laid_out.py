"""Figures that are drawn once: matplotlib draws one with a layout twice, at first to throw away.

Where many look the same but for their content, one is laid out and the others take its places.
"""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.transforms import Bbox

Places = list[Bbox]
"""Where the axes of a figure lie."""


class LaidOutFigure(Figure):
    """A figure with constrained layout, for `savefig` alone.

    `savefig` draws such a figure with a layout engine and nothing visible, and then without an
    engine. The first needs no more than the layout, which measures what it needs by itself.

    Args:
        places: where its axes lie; filled in if empty. For figures whose labels, ticks and legends
            take the same room, drawn in one style and format.
        settings: of `Figure`.
    """

    def __init__(self, places: Places | None = None, **settings: Any) -> None:
        super().__init__(layout="constrained", **settings)
        self._places = places

    def draw(self, renderer: Any) -> None:
        """Draws all, or only finds the layout where there is an engine for it."""
        engine = self.get_layout_engine()
        if not isinstance(engine, ConstrainedLayoutEngine):
            super().draw(renderer)
        elif self._places:
            for axes, place in zip(self.axes, self._places, strict=True):
                axes.set_position(place)
        else:
            engine.execute(self)
            if self._places is not None:
                self._places += [axes.get_position(original=True) for axes in self.axes]
