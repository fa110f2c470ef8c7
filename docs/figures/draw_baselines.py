"""Pictures and tables of docs/baselines.md: `python docs/figures/draw_baselines.py FOLDER...`.

Each folder is what `eventsweep run --out FOLDER` wrote.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

# What writes into pages lies beside the other tools, not in a package.
sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "benchmarks" / "tables"))

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.maps.folder import read_map
from eventsweep.eval.figures.colormaps import depth_scale
from eventsweep.eval.results.results import read_results
from markdown_blocks import into_page
from table_code import Code, of_methods, of_scenes

DOCS = Path(__file__).parents[1]
# metric -> title, factor from its unit to the title's, digits
COLUMNS = {
    "points": ("points, px", 1, 0),
    "mean_error": ("mean error, cm", 100, 1),
    "common_mean_error": ("on common pixels, cm", 100, 1),
    "median_error": ("median error, cm", 100, 1),
    "bad_published": ("bad pixels, %", 1, 2),
}
BASE = "Alg1/H"


def table(results, case):
    """Markdown of every method, best first; the mean error also relative to Alg1/H."""
    rows = results.rows
    rows = rows[(rows["case"] == case) & (rows["window"] == "w000")]
    rows = rows[rows["region"].isin(["all", "common"])]
    found = {(row.method, row.metric): row for row in rows.itertuples()}
    methods = sorted({m for m, _ in found}, key=lambda m: found[m, "mean_error"].value)
    base = found[BASE, "mean_error"].value
    head = ["method", *(title for title, _, _ in COLUMNS.values()), f"mean / {BASE}"]
    lines = [f"| {' | '.join(head)} |", f"|---|{'---:|' * (len(COLUMNS) + 1)}"]
    for method in methods:
        cells = [
            f"{found[method, name].value * factor:.{digits}f}"
            for name, (_, factor, digits) in COLUMNS.items()
        ]
        ratio = found[method, "mean_error"].value / base
        lines.append(f"| `{method}` | {' | '.join(cells)} | {ratio:.2f} |")
    return "\n".join(lines)


def white_in_view(sequence, t_us):
    """(H, W) bool in camera 0's undistorted view: where the ordinary camera's picture is white."""
    camera = sequence.rig.cameras[0]
    bearing = camera.undistorted().bearing_table()
    pixels = camera.project(np.concatenate([bearing, np.ones_like(bearing[..., :1])], axis=-1))
    source = np.nan_to_num(pixels, nan=-1e4).astype(np.float32)
    image = (sequence.photo(0, t_us).image == 255).astype(np.float32)
    return cv2.remap(image, source[..., 0], source[..., 1], cv2.INTER_NEAREST) > 0


def saturation(folder, case):
    """Markdown: who is wrong where the picture is saturated; nothing where hardly any is."""
    sequence = Sequence.open(folder / case / "sequence")
    window = read_map(folder / case / "map").windows[0]
    maps = [window.depth_map(method) for method in window.info.methods]
    if not len(sequence.photo_times_us(0)):
        return ""
    t_us = maps[0].t_us
    white, truth_m = white_in_view(sequence, t_us), sequence.truth_view_depth_m(0, t_us)
    if white.mean() < 0.01:
        return ""
    lines = [
        f"The picture is saturated on {white.mean():.0%} of its pixels. Points off by more than a "
        "tenth of the depth:\n",
        "| method | where it is saturated | median error there, cm | elsewhere |",
        "|---|---:|---:|---:|",
    ]
    for found in maps:
        error_m = np.abs(found.depth_m - truth_m)
        known = found.mask & (truth_m > 0)
        there, elsewhere = known & white, known & ~white
        wrong = error_m > 0.1 * truth_m
        lines.append(
            f"| `{found.method}` | {wrong[there].mean():.0%} | "
            f"{100 * np.median(error_m[there]):.0f} | {wrong[elsewhere].mean():.0%} |"
        )
    return "\n".join(lines)


def picture(folder, case):
    """What an ordinary camera sees, the true depth, and every method's."""
    sequence = Sequence.open(folder / case / "sequence")
    window = read_map(folder / case / "map").windows[0]
    maps = [window.depth_map(method) for method in window.info.methods]
    t_us, scale = maps[0].t_us, depth_scale(sequence.depth_range_m)
    colours = mpl.colors.ListedColormap(scale.palette[:255] / 255)
    columns = 5
    rows = -(-(len(maps) + 2) // columns)
    size = (3.0 * columns, 2.4 * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", dpi=80)
    for axis in axes.flat:
        axis.set_axis_off()
    photos = len(sequence.photo_times_us(0)) > 0
    shown = sequence.photo(0, t_us).image if photos else sequence.frame(0, t_us)
    axes.flat[0].imshow((shown / 255) ** (1 / 2.2), cmap="gray")
    axes.flat[0].set_title("frame of an ordinary camera" if photos else "scene", fontsize=10)
    truth_m = sequence.truth_view_depth_m(0, t_us)
    drawn = axes.flat[1].imshow(1 / truth_m, cmap=colours, vmin=scale.low, vmax=scale.high)
    axes.flat[1].set_title("true depth", fontsize=10)
    for axis, found in zip(axes.flat[2:], maps, strict=False):
        row, column = np.nonzero(found.mask)
        limits = {"vmin": scale.low, "vmax": scale.high}
        axis.imshow(np.ones((*found.mask.shape, 3)))
        # Dots, not an image: single pixels vanish when it is scaled down
        axis.scatter(column, row, c=1 / found.depth_m[row, column], s=1.3, cmap=colours,
                     linewidths=0, **limits)  # fmt: skip
        axis.set_title(f"{found.method}: {len(row)} points", fontsize=10)
    bar = figure.colorbar(drawn, ax=axes, shrink=0.7)
    bar.set_ticks([scale.low + share * (scale.high - scale.low) for share, _ in scale.ticks],
                  labels=[label for _, label in scale.ticks])  # fmt: skip
    bar.set_label(scale.label)
    figure.canvas.draw()
    pixels = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB")
    path = DOCS / "images" / f"baselines-{case}.png"
    pixels.save(path, optimize=True)
    plt.close(figure)
    return path


def code():
    """What the numbers depend on: what `eventsweep run` does, and the tables."""
    stages = tuple(f"eventsweep.eval.stages.{name}" for name in ("simulate", "map", "score"))
    made = Code(("draw_baselines:table", "draw_baselines:saturation"), stages)
    of_cases = of_scenes(["desk", "hdr-window", "mvsec-flying"])
    return {"docs/baselines.md#baselines": made + of_cases + of_methods(["baselines"])}


def main(folders):
    """Draws every case and replaces the page's generated part."""
    parts = []
    for folder in folders:
        results = read_results(folder / "results.json")
        for case in results.rows["case"].unique():
            path = picture(folder, case)
            parts.append(f"### {case}\n\n![{case}: frame, true depth, every method]"
                         f"(images/{path.name})\n\n{table(results, case)}")  # fmt: skip
            if white := saturation(folder, case):
                parts.append(white)
    into_page(DOCS / "baselines.md", "baselines", "\n\n".join(parts) + "\n", code)


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
