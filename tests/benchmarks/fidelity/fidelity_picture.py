"""The picture of the fidelity study: how many true events have a partner, over how near."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eventsweep.emvs.utils.files import atomic_path

# Okabe and Ito's colours, told apart by all; lines differ as well.
_STYLES = (("#777777", ":"), ("#E69F00", "--"), ("#0072B2", "-"), ("#009E73", "-."))
_NEAREST_US, _FURTHEST_US, _ACROSS = 10, 10_000, 4
AT_US = np.geomspace(_NEAREST_US, _FURTHEST_US, 61)


def draw(recalls: Mapping[str, Mapping[str, NDArray[np.float64]]], path: Path) -> None:
    """Draws one panel per scene with one curve per way to simulate, as a PNG.

    Args:
        recalls: by scene and way, the share of true events with a partner within each of `AT_US`.
        path: the picture.
    """
    rows = -(-len(recalls) // _ACROSS)
    figure = Figure(figsize=(2.9 * _ACROSS, 2.5 * rows + 0.4), layout="constrained", dpi=100)
    panels = np.atleast_1d(figure.subplots(rows, _ACROSS, sharex=True, sharey=True)).ravel()
    for axes, (scene, ways) in zip(panels, recalls.items(), strict=False):
        for (way, recall), (colour, style) in zip(ways.items(), _STYLES, strict=False):
            axes.plot(AT_US, 100 * recall, style, color=colour, label=way)
        axes.set(title=scene, xscale="log", ylim=(0, 100), xlim=(_NEAREST_US, _FURTHEST_US))
        axes.grid(alpha=0.3)
    for axes in panels[len(recalls) :]:
        axes.set_axis_off()
    figure.supxlabel("time error (µs)")
    figure.supylabel("true events with a partner so near (%)")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(names))
    with atomic_path(path) as partial, partial.open("wb") as file:
        figure.savefig(file, format="png")
