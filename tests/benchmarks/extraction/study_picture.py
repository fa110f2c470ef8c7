"""The picture of `docs/extraction.md`: depth and error of Alg1/H and of ours, at equal points."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray
from PIL import Image

from eventsweep.emvs.reference_view import inverse_depth_at
from study_cache import StudySample
from study_variants import BASE, OURS, VariantEstimate, Volumes, estimates

_COLOURS = 255
_SHOWN = {BASE: "Alg1/H", OURS: "ours, same number of points"}


def draw(sample: StudySample, path: Path) -> None:
    """Writes a PNG: depth above, error in plane steps below, Alg1/H left, ours right."""
    found = estimates(Volumes.of(sample))
    figure, axes = plt.subplots(2, 2, figsize=(9, 7.2), layout="constrained", dpi=80)
    for column, (name, title) in enumerate(_SHOWN.items()):
        depth_m, error = _depth_and_error(sample, found[name])
        _panel(axes[0, column], depth_m, f"{title}: depth, m", "turbo_r", _range_m(sample))
        shown = f"{title}: |error|, planes"
        _panel(axes[1, column], error, shown, "inferno", (0, 5))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    drawn = Image.fromarray(pixels).convert("RGB")
    drawn.quantize(_COLOURS).save(path, optimize=True)
    plt.close(figure)


def _depth_and_error(
    sample: StudySample, estimate: VariantEstimate
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rho, reported = sample.view.rho, estimate.mask & sample.truth.scored
    depth_m = np.reciprocal(inverse_depth_at(rho, estimate.position))
    step = abs(float(rho[0]) - float(rho[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        error = abs(1 / depth_m - 1 / sample.truth.depth_m) / step
    return np.where(reported, depth_m, np.nan), np.where(reported, error, np.nan)


def _range_m(sample: StudySample) -> tuple[float, float]:
    return float(1 / sample.view.rho[0]), float(1 / sample.view.rho[-1])


def _panel(
    axes: Axes, image: NDArray[np.float32], title: str, colours: str, limits: tuple[float, float]
) -> None:
    rows, columns = np.nonzero(np.isfinite(image))
    # Dots, not an image: single pixels vanish when it is scaled down
    shown = axes.scatter(
        columns, rows, c=image[rows, columns], s=1.2, cmap=colours, vmin=limits[0], vmax=limits[1],
        linewidths=0,
    )  # fmt: skip
    axes.set(title=title, xlim=(0, image.shape[1]), ylim=(image.shape[0], 0), aspect="equal")
    axes.set_facecolor("#d8d8d8")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.figure.colorbar(shown, ax=axes, shrink=0.85)
