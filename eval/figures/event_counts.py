"""The picture of `eventsweep info`: events per pixel and polarity, and their rate over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eventsweep.emvs.utils.files import atomic_path
from eventsweep.eval.event_statistics import StreamCount
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.figures.plots import ESTIMATE_COLOUR, TRUTH_COLOUR

_MOST_STREAMS = 8


def draw_counts(path: Path, title: str, names: list[str], counts: list[StreamCount]) -> None:
    """Writes a PNG with a row per stream (the first 8): brighter, darker, rate over time."""
    shown = list(zip(names, counts, strict=True))[:_MOST_STREAMS]
    figure = LaidOutFigure(figsize=(12, 0.5 + 2.7 * max(len(shown), 1)))
    figure.suptitle(title)
    axes = figure.subplots(len(shown), 3, squeeze=False, width_ratios=(1, 1, 1.3))
    for row, (name, count) in zip(axes, shown, strict=True):
        _images(figure, row, name, count)
        _rates(row[2], count)
    with atomic_path(path) as partial:
        figure.savefig(partial, format="png", dpi=110)


def _images(figure: Figure, row: Any, name: str, count: StreamCount) -> None:
    image = count.image()
    for axis, k, word in zip(row, (1, 0), ("brighter", "darker"), strict=False):
        guessed = "" if count.size_px else ", up to the largest pixel"
        axis.set_title(f"{name}: {word}{guessed}", fontsize=10)
        if image is None:
            axis.text(
                0.5, 0.5, "no events, or the file does not\nsay the sensor's size", ha="center"
            )
            axis.set_axis_off()
            continue
        lit = image[image > 0]
        top = max(float(np.percentile(lit, 99)) if lit.size else 1.0, 1.0)
        drawn = axis.imshow(image[k], cmap="gray_r", vmin=0, vmax=top, interpolation="nearest")
        axis.set(xlabel="column, px", ylabel="row, px")
        if k == 0:
            figure.colorbar(drawn, ax=axis, label="events per pixel", extend="max")


def _rates(axis: Any, count: StreamCount) -> None:
    starts_us, per_bin = count.rates()
    axis.set(xlabel="time since the first event, s", ylabel="rate, kev/s")
    if not len(starts_us):
        return
    edges_s = np.append(starts_us, starts_us[-1] + count.bin_us) - (count.first_us or 0)
    for k, colour, word in ((1, ESTIMATE_COLOUR, "brighter"), (0, TRUTH_COLOUR, "darker")):
        rate = per_bin[k] / count.bin_us * 1e3
        dash = "-" if k else (0, (3, 1))
        axis.stairs(rate, edges_s * 1e-6, color=colour, label=word, linestyle=dash)
    axis.set_ylim(bottom=0)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
