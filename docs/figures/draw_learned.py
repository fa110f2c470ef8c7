"""Picture of the page `learned.md`: `python docs/figures/draw_learned.py MAP [METHOD...] PICTURE`.

A map's methods side by side on one depth scale, and below each its stated error.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.maps.folder import read_map
from eventsweep.eval.cli.exit_codes import exit_code

_MOST_ERROR = 0.2
_PANEL_INCHES = 3.4


def shown_depth(axes: Axes, depth_map: DepthMap, span_m: tuple[float, float]) -> None:
    """Depth of the points, red near to blue far, even in inverse depth."""
    image = np.where(depth_map.mask, 1 / depth_map.depth_m, np.nan)
    low, high = 1 / span_m[1], 1 / span_m[0]
    drawn = axes.imshow(image, cmap="jet", vmin=low, vmax=high, interpolation="nearest")
    axes.set_title(f"{depth_map.method}, {depth_map.points} points", fontsize=9)
    bar = plt.colorbar(drawn, ax=axes, shrink=0.8)
    ticks = [m for m in (0.3, 0.5, 0.8, 1, 1.5, 2, 4) if span_m[0] <= m <= span_m[1]]
    bar.set_ticks([1 / m for m in ticks], labels=[f"{m:g}" for m in ticks])
    bar.set_label("depth [m]", fontsize=8)


def shown_error(axes: Axes, depth_map: DepthMap) -> None:
    """Stated error relative to depth, of the points."""
    if depth_map.error_m is None:
        axes.set_axis_off()
        return
    share = np.where(depth_map.mask, 100 * depth_map.error_m / depth_map.depth_m, np.nan)
    norm = LogNorm(0.1, 100 * _MOST_ERROR, clip=True)
    drawn = axes.imshow(share, cmap="viridis_r", norm=norm, interpolation="nearest")
    bar = plt.colorbar(drawn, ax=axes, shrink=0.8)
    bar.set_label("stated error [% of depth]", fontsize=8)


def draw(folder: Path, methods: list[str], path: Path) -> None:
    """Draws the first window of a map."""
    window = read_map(folder).windows[0]
    maps = [window.depth_map(name) for name in methods or window.info.methods]
    span = np.concatenate([one.depth_m[one.mask] for one in maps])
    span_m = float(np.quantile(span, 0.01)), float(np.quantile(span, 0.99))
    size = (_PANEL_INCHES * len(maps), 1.35 * _PANEL_INCHES)
    figure, panels = plt.subplots(2, len(maps), figsize=size, layout="constrained", squeeze=False)
    for column, depth_map in zip(panels.T, maps, strict=True):
        shown_depth(column[0], depth_map, span_m)
        shown_error(column[1], depth_map)
        for axes in column:
            axes.set_xlabel("x [px]", fontsize=8)
            axes.set_ylabel("y [px]", fontsize=8)
            axes.tick_params(labelsize=7)
    figure.savefig(path, dpi=110)


def main(arguments: list[str] | None = None) -> int:
    """Draws; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("methods", nargs="*")
    parser.add_argument("picture", type=Path)
    chosen = parser.parse_args(arguments)
    with exit_code() as code:
        draw(chosen.map, chosen.methods, chosen.picture)
    return code.value


if __name__ == "__main__":
    sys.exit(main())
