"""The paper's figures of the twins, in its colours and ranges, and two of what it states."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from eventsweep.eval.figures.colormaps import Scale, confidence_scale, depth_scale, events_scale
from eventsweep.eval.figures.images import (
    IndexedImage,
    confidence_image,
    depth_image,
    events_image,
    photo_image,
)
from eventsweep.eval.figures.laid_out import LaidOutFigure
from eventsweep.eval.scoring.regions import on_view
from eventsweep.plugins.paper import exposure, heading
from eventsweep.plugins.paper.evidence import Evidence, View
from eventsweep.plugins.paper.section3 import DRIFTS, FIGURE_2, LENGTHS, vio

RANGES_M = {
    "6dof": (0.45, 4.0), "desk2": (0.45, 4.0), "skate-easy": (1.0, 20.0), "bike-easy": (3.0, 200.0),
}  # fmt: skip
"""Depths from red to blue in the paper's Figure 2."""
_PANEL_INCHES, _DPI, _QUALITY = 3.2, 160, 82
_METHOD = "Alg1/H"


def figure_2(evidence: Evidence) -> bytes:
    """Depth and confidence of the four twins, and depth with an odometry's poses."""
    columns = []
    for case in FIGURE_2:
        exact, noisy = evidence.view(case), evidence.view(vio(case))
        scale = depth_scale(RANGES_M[case])
        columns.append((case, scale, _of_twin(exact, noisy, scale)))
    rows = list(columns[0][2])
    figure, axes = _grid(len(rows), len(columns), _aspect(columns[0][2][rows[0]]))
    for column, (case, scale, images) in zip(axes.T, columns, strict=True):
        for axis, row in zip(column, rows, strict=True):
            _show(axis, images[row], case if row == rows[0] else "")
            axis.set_ylabel(row if case == FIGURE_2[0] else "")
        _bar(figure, column, scale)
    return _saved(figure)


def _of_twin(exact: View, noisy: View, scale: Scale) -> dict[str, IndexedImage]:
    ours, shaken = exact.maps[_METHOD], noisy.maps[_METHOD]
    most = float(np.nanpercentile(ours.confidence[ours.mask], 90))
    return {
        "depth": ours.depth_image(scale),
        "confidence": confidence_image(ours.confidence, confidence_scale(most)),
        "depth, odometry": shaken.depth_image(scale),
        "true depth": depth_image(exact.truth.depth_m, exact.truth.scored, scale),
    }


def figure_3(evidence: Evidence) -> bytes:
    """What an ordinary and an event camera see of two HDR scenes, and the depth of each."""
    rows = []
    for case in exposure.CASES:
        view = evidence.view(case)
        near_m, far_m = view.window.depth_range_m
        rows.append((case, depth_scale((near_m, far_m)), _of_light(view)))
    names = list(rows[0][2])
    figure, axes = _grid(len(rows), len(names), _aspect(rows[0][2][names[0]]))
    for line, (case, scale, images) in zip(axes, rows, strict=True):
        for axis, name in zip(line, names, strict=True):
            _show(axis, images[name], name if case == rows[0][0] else "")
        line[0].set_ylabel(case)
        _bar(figure, line, scale, "right")
    return _saved(figure)


def _of_light(view: View) -> dict[str, IndexedImage]:
    window, scale = view.window, depth_scale(view.window.depth_range_m)
    ours, frames = view.maps[_METHOD], view.maps["Frames/sgm"]
    assert window.photo is not None
    assert window.brighter is not None
    assert window.darker is not None
    photo = on_view(window.photo.image, view.sequence.rig.cameras[0])
    most = float(np.nanpercentile(ours.confidence[ours.mask], 90))
    return {
        "frame": photo_image(photo),
        "events": events_image(window.brighter, window.darker, events_scale(1)),
        "confidence": confidence_image(ours.confidence, confidence_scale(most)),
        "depth from events (H)": ours.depth_image(scale),
        "depth from frames": frames.depth_image(scale),
        "true depth": depth_image(view.truth.depth_m, view.truth.scored, scale),
    }


def lengths(evidence: Evidence) -> bytes:
    """How much an odometry's errors cost, by the length of the window."""
    figure, axes = _plots(2)
    for axis, place in zip(axes, ("room", "corridor"), strict=True):
        for name, times in list(DRIFTS.items())[1:]:
            ratios = [_lost(evidence, place, name, window) for window in LENGTHS]
            axis.plot(list(LENGTHS.values()), ratios, marker="o", label=f"errors × {times}")
        axis.axhline(1, color="grey", linewidth=0.8)
        axis.set(title=place, xscale="log", xlabel="window [s]", ylabel="median error, times")
        axis.set_xticks(list(LENGTHS.values()), labels=[f"{s:g}" for s in LENGTHS.values()])
        axis.minorticks_off()
        axis.legend()
    return _saved(figure)


def _lost(evidence: Evidence, place: str, drift: str, window: str) -> float:
    return evidence.ratio(
        place, "median_error", _METHOD, _METHOD, window=window, of=lambda case: case + drift
    ).mean


def focus(evidence: Evidence) -> bytes:
    """Points and errors by the distance from the focus of expansion."""
    cases = ("boxes-90", "planes-90", "skate-easy", "bike-easy")
    figure, (above, below) = _plots(2)
    for case in cases:
        view = evidence.view(case)
        found = list(heading.rings(view))
        width_px = view.truth.depth_m.shape[1]
        middles = [(ring.from_px + ring.to_px) / 2 / width_px for ring in found]
        above.plot(middles, [ring.found for ring in found], marker="o", label=case)
        below.plot(middles, [ring.error for ring in found], marker="o", label=case)
    where = "distance from the focus of expansion [widths of the image]"
    above.set(xlabel=where, ylabel="points per edge pixel", title="what H reports")
    below.set(xlabel=where, ylabel="median relative error [%]", yscale="log")
    below.set_title("how far off it is")
    above.legend()
    return _saved(figure)


FIGURES: dict[str, Callable[[Evidence], bytes]] = {
    "paper-figure-2": figure_2,
    "paper-figure-3": figure_3,
    "paper-windows": lengths,
    "paper-focus": focus,
}
"""Per name of a file, what draws it."""


def _aspect(image: IndexedImage) -> float:
    height, width = image.index.shape
    return float(height / width)


def _grid(rows: int, columns: int, aspect: float) -> tuple[Figure, np.ndarray]:
    size = (_PANEL_INCHES * columns + 0.5, (_PANEL_INCHES * aspect + 0.12) * rows + 0.6)
    figure = LaidOutFigure(figsize=size, dpi=_DPI)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _plots(columns: int) -> tuple[Figure, np.ndarray]:
    figure = LaidOutFigure(figsize=(4.6 * columns, 3.4), dpi=_DPI)
    return figure, figure.subplots(1, columns)


def _show(axis: Axes, image: IndexedImage, title: str) -> None:
    axis.imshow(image.rgba(), interpolation="nearest")
    axis.set(title=title, xticks=(), yticks=())


def _bar(
    figure: Figure, axes: Sequence[Axes] | np.ndarray, scale: Scale, side: str = "bottom"
) -> None:
    levels = ListedColormap(scale.palette[:-1, :3] / 255)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), levels), ax=list(axes), location=side, label="depth [m]",
        pad=0.01, aspect=30,
    )  # fmt: skip
    positions, labels = zip(*scale.ticks, strict=True)
    bar.set_ticks(positions, labels=labels)


def _saved(figure: Figure) -> bytes:
    stream = io.BytesIO()
    with mpl.rc_context({"font.size": 9}):
        figure.savefig(stream, format="webp", pil_kwargs={"quality": _QUALITY, "method": 6})
    return stream.getvalue()
