"""Draws the maps of docs/baselines.md: `python docs/figures/draw_baselines_esvo.py SEQUENCE`.

SEQUENCE is a simulated twin of MVSEC's flights; its first second is mapped by the thresholds of the
published table.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

# What writes into pages lies beside the other tools, not in a package.
sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "benchmarks" / "tables"))

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.figures.colormaps import depth_scale
from markdown_blocks import into_page
from table_code import Code, of_methods, of_scenes

DOCS = Path(__file__).parents[1]
NAMES = ("Alg1/H", "ESVO/own-rate", "ESVO/window", "GTS/events")


def maps_of(sequence):
    """Depth maps by name, true depth at their time, and processor seconds of each."""
    found, taken = {}, {}
    for name in NAMES:
        config = MapperConfig(duration_s=1.0, threshold_c=14, median_px=9, max_confidence=57.7,
                              methods=(name,))  # fmt: skip
        for _ in range(2):  # the first compiles
            begin = time.process_time()
            found[name] = map_window(sequence, config).depth_maps[name]
            taken[name] = time.process_time() - begin
    times_us = sequence.truth_times_us(0)
    nearest_us = int(times_us[np.argmin(np.abs(times_us - found[NAMES[0]].t_us))])
    return found, sequence.truth_view_depth_m(0, nearest_us), taken


def picture(sequence, found, truth_m, path):
    """True depth and the maps made here, near in red."""
    scale = depth_scale(sequence.depth_range_m)
    colours = mpl.colors.ListedColormap(scale.palette[:255] / 255)
    figure, axes = plt.subplots(1, 5, figsize=(17, 2.9), layout="constrained", dpi=80)
    limits = {"vmin": scale.low, "vmax": scale.high, "cmap": colours}
    with np.errstate(divide="ignore"):
        drawn = axes[0].imshow(np.where(truth_m > 0, 1 / truth_m, np.nan), **limits)
    axes[0].set_title("true depth", fontsize=10)
    for axis, name in zip(axes[1:], NAMES, strict=True):
        rows, columns = np.nonzero(found[name].mask)
        axis.imshow(np.ones((*truth_m.shape, 3)))
        axis.scatter(columns, rows, c=1 / found[name].depth_m[rows, columns], s=0.8, linewidths=0,
                     **limits)  # fmt: skip
        axis.set_title(f"{name}: {len(rows)} points", fontsize=10)
    for axis in axes:
        axis.set_axis_off()
    bar = figure.colorbar(drawn, ax=axes, shrink=0.8)
    bar.set_ticks([scale.low + share * (scale.high - scale.low) for share, _ in scale.ticks],
                  labels=[label for _, label in scale.ticks])  # fmt: skip
    bar.set_label(scale.label)
    figure.savefig(path)
    plt.close(figure)


def code():
    """What the numbers depend on."""
    simulated = of_scenes(["mvsec-flying"]) + Code(modules=("eventsweep.eval.stages.simulate",))
    return {
        "docs/baselines.md#esvo": Code(("draw_baselines_esvo:maps_of",))
        + simulated
        + of_methods(NAMES)
    }


def main(folder):
    """Draws, and replaces the page's generated part."""
    sequence = Sequence.open(folder)
    found, truth_m, taken = maps_of(sequence)
    path = DOCS / "images" / "baselines_esvo-mvsec-flying.png"
    picture(sequence, found, truth_m, path)
    cost = ", ".join(f"`{name}` {seconds:.1f} s" for name, seconds in taken.items())
    text = (
        f"![mvsec-flying: true depth and maps](images/{path.name})\n\n"
        f"Processor time for this second: {cost}.\n"
    )
    into_page(DOCS / "baselines.md", "esvo", text, code)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
