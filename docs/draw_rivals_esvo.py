"""Writes picture and table of docs/rivals_esvo.md: `python docs/draw_rivals_esvo.py RUN CASE`.

RUN is what `eventsweep run CASE --out RUN` wrote, with Alg1/H, EMVS and SGM; the ESVO and GTS maps
of the same window are made here.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from emvs.config import MapperConfig
from emvs.data.sequence import Sequence
from emvs.output import read_map
from emvs.rivals import esvo, gts
from emvs.view import reference_view
from emvs.window import choose_window
from eval.colour import depth_scale

DOCS = Path(__file__).parent
PUBLISHED = {"ESVO/own-rate": 1.25, "ESVO/window": 1.25, "SGM/window": 1.76, "EMVS/cam0": 1.68,
             "GTS/events": 19.4, "Alg1/H": 1.0}  # fmt: skip


def maps_of(run, case):
    """Depth maps by name, true depth at their time, and processor seconds of those made here."""
    sequence = Sequence.open(run / case / "sequence")
    stored = read_map(run / case / "map").windows[0]
    found = {name: stored.depth_map(name) for name in stored.info.methods}
    config = MapperConfig()
    window = choose_window(sequence, config)
    view = reference_view(sequence, config, window.t_ref_us)
    taken = {}
    for estimate in (esvo.estimate, esvo.estimate_window, gts.estimate):
        begin = time.process_time()
        made = estimate(sequence, window, view, config)
        taken[made.method] = time.process_time() - begin
        found[made.method] = made
    times_us = sequence.truth_times_us(0)
    nearest_us = int(times_us[np.argmin(np.abs(times_us - view.t_us))])
    return sequence, found, sequence.truth_view_depth_m(0, nearest_us), taken


def table(found, truth_m):
    """Markdown, best mean error first."""
    rows = {}
    for name, made in found.items():
        known = made.mask & (truth_m > 0)
        error_m = np.abs(made.depth_m[known] - truth_m[known])
        rows[name] = int(known.sum()), 100 * error_m.mean(), 100 * np.median(error_m)
    base = rows["Alg1/H"][1]
    lines = ["| method | points, px | mean, cm | median, cm | mean / Alg1/H | published |",
             "|---|---:|---:|---:|---:|---:|"]  # fmt: skip
    for name, (points, mean, median) in sorted(rows.items(), key=lambda row: row[1][1]):
        other = f"{PUBLISHED[name]:g}" if name in PUBLISHED else ""
        lines.append(f"| `{name}` | {points} | {mean:.1f} | {median:.1f} | {mean / base:.2f} | "
                     f"{other} |")  # fmt: skip
    return "\n".join(lines)


def picture(sequence, found, truth_m, path):
    """True depth and the maps made here, near in red."""
    scale = depth_scale(sequence.depth_range_m)
    colours = mpl.colors.ListedColormap(scale.palette[:255] / 255)
    names = ["Alg1/H", "ESVO/own-rate", "ESVO/window", "GTS/events"]
    figure, axes = plt.subplots(1, 5, figsize=(17, 2.9), layout="constrained", dpi=80)
    limits = {"vmin": scale.low, "vmax": scale.high, "cmap": colours}
    with np.errstate(divide="ignore"):
        drawn = axes[0].imshow(np.where(truth_m > 0, 1 / truth_m, np.nan), **limits)
    axes[0].set_title("true depth", fontsize=10)
    for axis, name in zip(axes[1:], names, strict=True):
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


def main(run, case):
    """Draws, and replaces the page's generated part."""
    sequence, found, truth_m, taken = maps_of(run, case)
    path = DOCS / "images" / f"rivals_esvo-{case}.png"
    picture(sequence, found, truth_m, path)
    page, begin, end = DOCS / "rivals_esvo.md", "<!-- esvo: begin -->", "<!-- esvo: end -->"
    cost = ", ".join(f"`{name}` {seconds:.1f} s" for name, seconds in taken.items())
    body = "\n\n".join([begin, f"![{case}: true depth and maps](images/{path.name})",
                        table(found, truth_m), f"Processor time, compilation included: {cost}.",
                        end])  # fmt: skip
    text = page.read_text(encoding="utf-8")
    page.write_text(re.sub(f"{begin}.*{end}", lambda _: body, text, flags=re.S), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
