"""One picture of a case: frame, events, depth and ground truth side by side, with axes."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from eventsweep.eval.figures.colormaps import Scale, depth_scale, events_scale
from eventsweep.eval.figures.images import IndexedImage
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.report.run_data import CaseData, MethodData, WindowData
from eventsweep.eval.scoring.pairing import REFERENCE
from eventsweep.eval.scoring.predictions import FAMILY

_PANEL_INCHES, _DPI, _MOST_OTHERS, _COLUMNS = 4.2, 90, 2, 6


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
    panels = _panels(window, [chosen, *others[:most_others]])
    rows = -(-len(panels) // columns)
    columns = -(-len(panels) // rows)
    height_px, width_px = chosen.depth_m.shape
    height = rows * (0.84 * _PANEL_INCHES * height_px / width_px + 0.7) + (0.3 if title else 0.0)
    size = (_PANEL_INCHES * columns, height)
    with mpl.rc_context({"font.size": 9, "axes.titlesize": 10, "axes.titlelocation": "left"}):
        figure = LaidOutFigure(figsize=size, dpi=_DPI)
        if title:
            figure.suptitle(title, x=0.01, ha="left")
        for k, (name, image) in enumerate(panels.items()):
            axes = figure.add_subplot(rows, columns, k + 1, title=name, xlabel="x [px]")
            axes.set_ylabel("y [px]" if k % columns == 0 else "")
            axes.imshow(image.rgba(), interpolation="nearest")
        _depth_bar(figure, depth_scale(window.shown_range_m))
        stream = io.BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def _panels(window: WindowData, methods: Sequence[MethodData]) -> dict[str, IndexedImage]:
    scale = depth_scale(window.shown_range_m)
    seen = window.images(scale, events_scale(1))
    true = {name: seen.pop(name) for name in ("True depth",) if name in seen}
    return seen | {f"Depth, {m.name}": m.depth_image(scale) for m in methods} | true


def _depth_bar(figure: Figure, scale: Scale) -> None:
    """A colour bar that is even in inverse depth and labelled in metres."""
    levels = ListedColormap(scale.palette[:-1, :3] / 255)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), levels), ax=figure.axes, pad=0.01, label="depth [m]"
    )
    positions, labels = zip(*scale.ticks, strict=True)
    bar.set_ticks(positions, labels=labels)
