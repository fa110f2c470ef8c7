"""Draws docs/images/howto_model.png and howto_robot.png: `python docs/figures/draw_model.py`.

The model is the one that the page `howto_model.md` prints, with more pixels.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import mujoco
import numpy as np
from numpy.typing import NDArray

import eventsweep as es
from eventsweep.eval.figures.colormaps import depth_scale
from eventsweep.eval.figures.images import depth_image

DOCS = Path(__file__).parents[1]
EVENTS_US, FALL_S, FALLEN_US = 5_000, 0.3, 250_000
TIMES_US = (400_000, 900_000)
GAMMA = 2.2  # of screens; the cameras' light is linear
OUTSIDE = (
    '<camera name="outside" pos="-.8 -1 1.4" xyaxes=".8 -.6 0 .25 .33 .9" fovy="50" '
    'resolution="346 260"/></worldbody>'
)
RED, BLUE = (0.84, 0.15, 0.12), (0.10, 0.36, 0.80)
Picture = NDArray[np.floating]


def page_model() -> str:
    """The page's MJCF, with a camera that looks on and as many pixels as a DAVIS346."""
    text = (DOCS / "howto_model.md").read_text(encoding="utf-8")
    (found,) = re.findall(r"<mujoco.*?</mujoco>", text, re.DOTALL)
    finer: str = found.replace('resolution="80 60"', 'resolution="346 260"')
    return finer.replace("</worldbody>", OUTSIDE)


def seen_from_outside(model: Any, data: Any) -> Picture:
    """The model and its room."""
    with es.EventCamera(model, "outside") as camera:
        camera.step(data)
        return np.asarray(camera.intensity() ** (1 / GAMMA))


def over(grey: Picture, events: es.Events) -> Picture:
    """Red where pixels became brighter last, blue where darker, over a pale frame."""
    picture = np.repeat(0.45 + 0.55 * grey[..., None], 3, axis=2)
    picture[events.y, events.x] = np.where(events.p[:, None] == 1, RED, BLUE)
    return np.clip(picture, 0, 1)


def extent_m(depth_m: Picture) -> tuple[float, float]:
    """Nearest and farthest depth."""
    known_m = depth_m[np.isfinite(depth_m)]
    return float(known_m.min()), float(known_m.max())


def coloured(depth_m: Picture, range_m: tuple[float, float]) -> Picture:
    """Depth in the colours of the pages."""
    return depth_image(depth_m, np.isfinite(depth_m), depth_scale(range_m)).rgba() / 255


def put(axis: Any, picture: Picture, title: str) -> None:
    """Shows a picture with what it is above it."""
    axis.imshow(picture, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    axis.set_title(title, fontsize=10)
    axis.axis("off")


def draw_model() -> None:
    """A model of one's own, and the sequence that `simulate` makes of it."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "drone.xml"
        path.write_text(page_model())
        model = mujoco.MjModel.from_xml_path(str(path))
        outside = seen_from_outside(model, mujoco.MjData(model))
        falls = es.ModelConfig(mount="left", motion="dynamics")
        config = es.SimConfig(duration_s=FALL_S, truth_interval_s=0.05, model=falls)
        sequence = es.simulate(str(path), Path(name) / "seq", config, rig="model:left,right")
        events = sequence.events(0, FALLEN_US - EVENTS_US, FALLEN_US)
        frame = sequence.truth_intensity(0, FALLEN_US) / 255
        depth_m = sequence.truth_depth_m(0, FALLEN_US)
        range_m = extent_m(depth_m)
    figure, axes = plt.subplots(1, 4, figsize=(15, 3.2), layout="constrained")
    put(axes[0], outside, "drone.xml, which falls")
    put(axes[1], frame ** (1 / GAMMA), f"its left camera after {FALLEN_US / 1e6:g} s")
    put(
        axes[2], over(frame, events), f"{len(events):,} events of the {EVENTS_US / 1e3:g} ms before"
    )
    put(axes[3], coloured(depth_m, range_m), f"exact depth, {range_m[0]:.1f} to {range_m[1]:.1f} m")
    figure.savefig(DOCS / "images" / "howto_model.png", dpi=80)


def draw_robot() -> None:
    """What an event camera beside `mj_step` sends, while the page's controller flies."""
    model = mujoco.MjModel.from_xml_string(page_model())
    data = mujoco.MjData(model)
    shown: list[tuple[str, Picture, Picture]] = []
    with es.EventCamera(model, "left") as camera:
        camera.step(data)
        sent = [es.Events.empty()]
        while len(shown) < len(TIMES_US):
            data.ctrl[:] = 9.81 * 0.5 + 2 * (0.8 - data.qpos[2]), -1e-3
            mujoco.mj_step(model, data)
            sent = [*sent, camera.step(data)][-round(EVENTS_US / (1e6 * model.opt.timestep)) :]
            t_us = round(1e6 * data.time)
            if t_us >= TIMES_US[len(shown)]:
                events = es.Events.concat(sent)
                title = f"{t_us / 1e6:g} s: {len(events):,} events of the last calls"
                shown.append((title, over(camera.intensity(), events), camera.depth_m()))
    outside = seen_from_outside(model, data)
    figure, axes = plt.subplots(1, 4, figsize=(15, 3.2), layout="constrained")
    put(axes[0], outside, "the robot, flying sideways")
    for axis, (title, picture, _) in zip(axes[1:3], shown, strict=True):
        put(axis, picture, title)
    depth_m = shown[-1][2]
    range_m = extent_m(depth_m)
    put(axes[3], coloured(depth_m, range_m), f"depth then, {range_m[0]:.1f} to {range_m[1]:.1f} m")
    figure.savefig(DOCS / "images" / "howto_robot.png", dpi=80)


if __name__ == "__main__":
    draw_model()
    draw_robot()
