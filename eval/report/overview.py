"""One picture of a case: frame, events, depth and ground truth side by side, with axes."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import partial

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eventsweep.eval.figures.colormaps import Scale, depth_scale, events_scale
from eventsweep.eval.figures.images import depth_image, events_image, frame_image, point_size_px
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.report.run_data import CaseData, MethodData, WindowData
from eventsweep.eval.scoring.pairing import REFERENCE
from eventsweep.eval.scoring.predictions import FAMILY

_PANEL_INCHES, _DPI, _MOST_OTHERS, _COLUMNS = 4.2, 90, 2, 6
Drawing = Callable[[Axes], None]


def overview_png(
    case: CaseData, title: str = "", ranked: Sequence[str] = (), *, most_others: int = _MOST_OTHERS,
    columns: int = _COLUMNS,
) -> bytes:  # fmt: skip
    """Draws the first window of a case with its best depth as a PNG; what is not known is left out.

    Of the methods in `ranked`, the best first, the first that has a map is drawn; where none is
    ranked, the harmonic mean. Beside it stand up to `most_others` depth maps of others.
    """
    window = case.windows[0]
    by_name = {method.name: method for method in window.methods}
    wished = (by_name[name] for name in (*ranked, REFERENCE) if name in by_name)
    chosen = next(wished, window.methods[0])
    others = [m for m in window.methods if m.name.startswith(FAMILY) and m is not chosen]
    drawings = _drawings(window, [chosen, *others[:most_others]])
    rows = -(-len(drawings) // columns)
    columns = -(-len(drawings) // rows)
    height_px, width_px = chosen.depth_m.shape
    height = rows * (0.84 * _PANEL_INCHES * height_px / width_px + 0.7) + (0.3 if title else 0.0)
    size = (_PANEL_INCHES * columns, height)
    with mpl.rc_context({"font.size": 9, "axes.titlesize": 10, "axes.titlelocation": "left"}):
        figure = LaidOutFigure(figsize=size, dpi=_DPI)
        if title:
            figure.suptitle(title, x=0.01, ha="left")
        for k, (name, draw) in enumerate(drawings.items()):
            axes = figure.add_subplot(rows, columns, k + 1, title=name, xlabel="x [px]")
            axes.set_ylabel("y [px]" if k % columns == 0 else "")
            draw(axes)
        _depth_bar(figure, depth_scale(window.depth_range_m))
        stream = io.BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def _drawings(window: WindowData, methods: Sequence[MethodData]) -> dict[str, Drawing]:
    scale = depth_scale(window.depth_range_m)
    point_px = point_size_px(methods[0].depth_m.shape[1])
    drawings: dict[str, Drawing] = {}
    if window.frame is not None:
        frame = frame_image(window.frame).rgba()
        drawings["Frame"] = lambda axes: _show(axes, frame)
    if window.brighter is not None and window.darker is not None:
        events = events_image(window.brighter, window.darker, events_scale(1)).rgba()
        drawings["Events"] = lambda axes: _show(axes, events)
    for method in methods:
        depth = depth_image(method.depth_m, method.mask, scale, point_px).rgba()
        drawings[f"Depth, {method.name}"] = partial(_show, rgba=depth)
    if window.truth is not None:
        truth = depth_image(window.truth.depth_m, window.truth.scored, scale).rgba()
        drawings["True depth"] = lambda axes: _show(axes, truth)
    return drawings


def _show(axes: Axes, rgba: NDArray[np.uint8]) -> None:
    axes.imshow(rgba, interpolation="nearest")


def _depth_bar(figure: Figure, scale: Scale) -> None:
    """A colour bar that is even in inverse depth and labelled in metres."""
    levels = ListedColormap(scale.palette[:-1, :3] / 255)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), levels), ax=figure.axes, pad=0.01, label="depth [m]"
    )
    positions, labels = zip(*scale.ticks, strict=True)
    bar.set_ticks(positions, labels=labels)
