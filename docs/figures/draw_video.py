"""Draws docs/images/video.png: `python docs/figures/draw_video.py`.

A video of the desk in 240 frames per second, and the events that `video_to_events` makes of it, by
ideal pixels and by those of a DAVIS346.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import eventsweep as es
from eventsweep import scenes
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.sensor_presets import PresetName, SensorConfig

IMAGES = Path(__file__).parents[1] / "images"
RATE_HZ, COUNT, SHOWN = 240.0, 30, 24
WINDOW_US = 8000
PRESETS: tuple[PresetName, ...] = ("ideal", "davis346")
LINEAR = es.VideoConfig(encoding="linear")
Frame = NDArray[np.uint8]
RED, BLUE = (0.84, 0.15, 0.12), (0.10, 0.36, 0.80)


def film(path: Path) -> list[Frame]:
    """Writes a video of 8 bits, linear as other pictures of the renderer; returns its frames."""
    scene = scenes.load("desk")
    rig, motion = RIGS["davis346"], scene.motion(1.0, 0)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, (346, 260))
    frames: list[Frame] = []
    with StereoRenderer(scene.spec(), rig, 3, scene.depth_range_m) as renderer:
        for k in range(COUNT):
            light = renderer.frame(0, motion.T_world_body(0.4 + k / RATE_HZ)).intensity
            frames.append(np.rint(255 * np.clip(light, 0, 1)).astype(np.uint8))
            writer.write(cv2.merge([frames[-1]] * 3))
    writer.release()
    return frames


def over(grey: Frame, events: es.Events) -> NDArray[np.float64]:
    """Red where pixels became brighter last, blue where darker, over a pale frame."""
    picture: NDArray[np.float64] = np.repeat(0.45 + 0.55 * grey[..., None] / 255, 3, axis=2)
    colours = np.where(events.p[:, None] == 1, RED, BLUE)
    picture[events.y, events.x] = colours
    return picture


def main() -> None:
    """Draws it."""
    with tempfile.TemporaryDirectory() as name:
        frames = film(Path(name) / "desk.avi")
        t_us = round(SHOWN / RATE_HZ * 1e6)
        panels: dict[str, Any] = {
            f"frame {SHOWN} of the video, {RATE_HZ:g} Hz": frames[SHOWN] / 255
        }
        for preset in PRESETS:
            config = es.PixelConfig(sensor=SensorConfig(preset=preset))
            told = es.video_to_events(Path(name) / "desk.avi", Path(name) / preset, config, LINEAR)
            events = es.Sequence(told.path).events(0, t_us - WINDOW_US, t_us)
            title = f"{preset}: {len(events):,} events of the {WINDOW_US // 1000} ms before"
            panels[title] = over(frames[SHOWN], events)
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.6), layout="constrained")
    for axis, (title, picture) in zip(axes, panels.items(), strict=True):
        axis.imshow(picture, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
        axis.set_title(title, fontsize=10)
        axis.axis("off")
    figure.savefig(IMAGES / "video.png", dpi=80)


if __name__ == "__main__":
    main()
