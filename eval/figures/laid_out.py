"""Figures that are drawn once: matplotlib draws one with a layout twice, at first to throw away."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine


class LaidOutFigure(Figure):
    """A figure with constrained layout, for `savefig` alone.

    `savefig` draws such a figure with a layout engine and nothing visible, and then without an
    engine. The first needs no more than the layout, which measures what it needs by itself; of a
    figure `like` another, whose labels take the same room, that one's is taken.
    """

    def __init__(self, like: Figure | None = None, **settings: Any) -> None:
        super().__init__(layout="constrained", **settings)
        self._like = like

    def draw(self, renderer: Any) -> None:
        """Draws all, or only finds the layout where there is an engine for it."""
        engine = self.get_layout_engine()
        if not isinstance(engine, ConstrainedLayoutEngine):
            super().draw(renderer)
        elif self._like is None:
            engine.execute(self)
        else:
            for axes, known in zip(self.axes, self._like.axes, strict=True):
                axes.set_position(known.get_position(original=True))
