"""Draws docs/images/truth.png: `python docs/figures/draw_truth.py`.

The desk for 50 ms, with everything that the simulator can tell of it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from eventsweep import scenes
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.eval.figures.colormaps import depth_scale
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.simulate import simulate

PICTURE = Path(__file__).parents[1] / "images" / "truth.png"
TRUTH = ("flow", "segmentation", "boundary", "event_depth")
STRIDE_PX, EVENTS_US = 20, 5_000


def draw_flow(axis, sequence, t_us):
    """Arrows over the grey frame: where each point goes until the next stored time."""
    frame, flow_px = sequence.truth_intensity(0, t_us), sequence.truth_flow_px(0, t_us)
    rows, columns = np.mgrid[: frame.shape[0], : frame.shape[1]][:, ::STRIDE_PX, ::STRIDE_PX]
    moved = flow_px[rows, columns]
    axis.imshow(128 + frame / 2, cmap="gray", vmin=0, vmax=255)
    axis.quiver(columns, rows, moved[..., 0], moved[..., 1], np.hypot(*moved.T).T, cmap="plasma",
                angles="xy", scale_units="xy", scale=0.3, width=0.004)  # fmt: skip
    longest_px = np.nanmax(np.hypot(flow_px[..., 0], flow_px[..., 1]))
    step_ms = np.diff(sequence.truth_times_us(0))[0] / 1000
    title = f"flow in {step_ms:g} ms, at most {longest_px:.1f} px; arrows 3.3 times as long"
    axis.set_title(title, fontsize=10)


def draw_segments(axis, sequence, t_us):
    """A colour for each geom."""
    ids = sequence.truth_segmentation(0, t_us)
    colours = np.random.default_rng(3).integers(40, 256, (int(ids.max()) + 2, 3), np.uint8)
    axis.imshow(colours[ids + 1])
    axis.set_title(f"segmentation, {len(np.unique(ids))} geoms in view", fontsize=10)


def draw_boundary(axis, sequence, t_us):
    """Black where depth jumps."""
    axis.imshow(sequence.truth_boundary(0, t_us), cmap="gray_r", vmin=0, vmax=1)
    axis.set_title("depth boundary", fontsize=10)


def draw_events(figure, axis, sequence):
    """Every event of a few milliseconds in the colour of its surface's depth."""
    events = sequence.events(0, 0, EVENTS_US)
    depth_m = sequence.event_depth_m(0, 0, EVENTS_US)
    scale = depth_scale(tuple(float(f"{m:.1g}") for m in np.percentile(depth_m, (1, 99))))
    colours = mpl.colors.ListedColormap(scale.palette[:255] / 255)
    drawn = axis.scatter(events.x, events.y, c=1 / depth_m, cmap=colours, s=1.2, linewidths=0,
                         vmin=scale.low, vmax=scale.high)  # fmt: skip
    camera = sequence.rig.cameras[0]
    axis.set(xlim=(-0.5, camera.width_px - 0.5), ylim=(camera.height_px - 0.5, -0.5),
             aspect="equal")  # fmt: skip
    axis.set_title(f"depth per event, first {EVENTS_US // 1000} ms", fontsize=10)
    bar = figure.colorbar(drawn, ax=axis, fraction=0.035, pad=0.02, label="depth, m")
    bar.set_ticks([scale.low + at * (scale.high - scale.low) for at, _ in scale.ticks],
                  labels=[label for _, label in scale.ticks])  # fmt: skip


def main():
    """Simulates and draws four panels."""
    scene = scenes.load("desk")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "desk"
        simulate(scene, RIGS[scene.rig], SimConfig(duration_s=0.05, truth=TRUTH), 0, path)
        sequence = Sequence.open(path)
        t_us = int(sequence.truth_times_us(0)[0])
        figure, axes = plt.subplots(2, 2, figsize=(10, 7.3), layout="constrained")
        draw_flow(axes[0, 0], sequence, t_us)
        draw_segments(axes[0, 1], sequence, t_us)
        draw_boundary(axes[1, 0], sequence, t_us)
        draw_events(figure, axes[1, 1], sequence)
    for axis in axes.flat:
        axis.set(xticks=[], yticks=[])
    figure.savefig(PICTURE, dpi=80)


if __name__ == "__main__":
    main()
