"""Draws docs/images/lenses.png and light.png: `python docs/figures/draw_lenses_and_light.py`."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from eventsweep import scenes
from eventsweep.sim.config import ShutterConfig, SimConfig
from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.sensor.frame_camera import Exposure, develop

IMAGES = Path(__file__).parents[1] / "images"
RIG_NAMES = ("mvsec", "dsec", "tumvie-kb4")
HDR_SCENE, SHUTTER = "hdr-window", ShutterConfig(exposure_us=20_000)


def moved_by_lens_px(camera):
    """How far the lens moves each pixel from where a pinhole would see it."""
    straight = camera.undistorted().bearing_table()
    moved = (camera.bearing_table() - straight) * (camera.fx_px, camera.fy_px)
    return np.hypot(moved[..., 0], moved[..., 1])


def lenses():
    """What a pinhole and the lens see, and how far apart they are."""
    scene = scenes.load("desk")
    T_world_body = scene.motion(0.5, 0).T_world_body(0.25)
    figure, rows = plt.subplots(3, 4, figsize=(13, 7.6), layout="constrained")
    for name, axes in zip(RIG_NAMES, rows, strict=True):
        camera = RIGS[name].cameras[0]
        with StereoRenderer(scene.spec(), RIGS[name], 2, scene.depth_range_m) as renderer:
            sensor, depth_m = renderer.frame(0, T_world_body), renderer.depth(0, T_world_body)
            straight_m = renderer.depth(0, T_world_body, view=camera.undistorted())
        shown = [(sensor.intensity, "gray", "light on the sensor"),
                 (1 / depth_m, "magma", "inverse depth on the sensor"),
                 (1 / straight_m, "magma", "inverse depth, pinhole view"),
                 (moved_by_lens_px(camera), "viridis", "moved by the lens, px")]  # fmt: skip
        for axis, (image, colours, title) in zip(axes, shown, strict=True):
            depths = colours == "magma"
            drawn = axis.imshow(image, cmap=colours, vmin=0 if depths else None,
                                vmax=1 / depth_m.min() if depths else None)  # fmt: skip
            axis.set_title(f"{name}: {title}", fontsize=9)
            axis.axis("off")
        figure.colorbar(drawn, ax=axes[-1], shrink=0.7)
    figure.savefig(IMAGES / "lenses.png", dpi=80)


def light():
    """What a frame camera loses where light spans more than 8 bits, and while it moves."""
    scene = scenes.load(HDR_SCENE)
    motion = scene.motion(0.5, 0)
    rig = RIGS["davis346"]
    with StereoRenderer(scene.spec(), rig, 2, scene.depth_range_m, floats=True) as renderer:
        exposing = Exposure(200_000, 200_000 + SHUTTER.exposure_us)
        dense = SimConfig(sampling="linear", max_displacement_px=0.5)
        span_us = [exposing.start_us, exposing.end_us]
        for before, after in pairwise(adaptive_frames(renderer, motion, span_us, dense)):
            exposing.add(*((e.t_us, e.frames[0].intensity) for e in (before, after)))
        sharp = renderer.frame(0, motion.T_world_body(0.21)).intensity
    shown = [(np.log10(np.maximum(sharp, 1e-6)), "magma", "log10 of light, one instant")]
    for percentile in (40, 95):
        gain = 0.45 / float(np.percentile(exposing.light(), percentile))
        photo = develop(exposing.light(), ShutterConfig(exposure_us=SHUTTER.exposure_us, gain=gain))
        white, black = np.mean(photo == 255), np.mean(photo == 0)
        title = f"20 ms, gain {gain:.2g}: {white:.0%} white, {black:.0%} black"
        shown.append(((photo / 255) ** (1 / 2.2), "gray", title))
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.5), layout="constrained")
    for axis, (image, colours, title) in zip(axes, shown, strict=True):
        drawn = axis.imshow(image, cmap=colours)
        axis.set_title(title, fontsize=10)
        axis.axis("off")
        if colours == "magma":
            figure.colorbar(drawn, ax=axis, shrink=0.8)
    ends = np.percentile(sharp, [0.1, 99.9])
    span_db = 20 * np.log10(ends[1] / ends[0])
    figure.suptitle(f"{HDR_SCENE}: {span_db:.0f} dB between 0.1 % and 99.9 % of the pixels")
    figure.savefig(IMAGES / "light.png", dpi=80)


if __name__ == "__main__":
    lenses()
    light()
