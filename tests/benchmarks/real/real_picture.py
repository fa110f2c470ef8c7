"""The picture of `real_check`: a frame, what the frames say of depth, and methods beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray
from PIL import Image

from eventsweep.emvs.depth.depth_map import DepthMap
from frame_depth import FrameDepth
from study_learned import most_reliable

_COLOURS = 255
_DEPTH_M, _ERROR_PERCENT = (0.4, 2.0), (0, 3)


def draw(truth: FrameDepth, maps: Sequence[DepthMap], baseline_m: float, path: Path) -> None:
    """Writes a PNG: frame and true depth left; each method's depth above, its error below.

    All report as many points as the first one, those that they hold most reliable.
    """
    figure, axes = plt.subplots(2, 1 + len(maps), figsize=(13, 5), layout="constrained", dpi=80)
    axes[0, 0].imshow(truth.frame, cmap="gray")
    axes[0, 0].set(title="frame")
    _dots(axes[1, 0], np.where(truth.known, truth.depth_m, np.nan), "depth from frames, m", False)
    for column, one in enumerate(maps, 1):
        mask = most_reliable(one, baseline_m * one.camera.fx_px, maps[0].points)
        _dots(
            axes[0, column], np.where(mask, one.depth_m, np.nan), f"{one.method}: depth, m", False
        )
        percent = 100 * np.abs(one.depth_m - truth.depth_m) / truth.depth_m
        shown = np.where(mask & truth.known, percent, np.nan)
        _dots(axes[1, column], shown, f"{one.method}: |error|, %", True)
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    Image.fromarray(pixels).convert("RGB").quantize(_COLOURS).save(path, optimize=True)
    plt.close(figure)


def _dots(axes: Axes, image: NDArray[np.floating], title: str, is_error: bool) -> None:
    rows, columns = np.nonzero(np.isfinite(image))
    low, high = _ERROR_PERCENT if is_error else _DEPTH_M
    shown = axes.scatter(
        columns, rows, c=image[rows, columns], s=1.6, linewidths=0, vmin=low, vmax=high,
        cmap="inferno" if is_error else "turbo_r",
    )  # fmt: skip
    axes.set(title=title, xlim=(0, image.shape[1]), ylim=(image.shape[0], 0), aspect="equal")
    axes.set_facecolor("#d8d8d8")
    axes.figure.colorbar(shown, ax=axes, shrink=0.7)
