"""What `EventCamera.step` costs beside rendering: `python tests/benchmarks step_cost`.

A cart with a camera passes a wall; the time of the calls is told apart into drawing, events and
everything else, which is this project's own overhead.

    python tests/benchmarks step_cost --page docs/howto_model.md
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.config import SimConfig
from eventsweep.sim.event_camera import EventCamera
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.sensor.sensor import Sensor
from markdown_blocks import show

MODEL = """<mujoco><option timestep="0.002" gravity="0 0 0"/>
<asset><texture name="t" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".8 .8 .7" width="300"
height="300" mark="random" markrgb="1 1 1" random=".05"/>
<material name="t" texture="t" texrepeat="6 6"/></asset>
<worldbody><geom type="box" pos="2 0 1" size=".1 4 2" material="t"/>
<body name="cart" pos="0 0 1"><joint name="slide" type="slide" axis="0 1 0"/>
<geom type="box" size=".05 .05 .05" pos="-.1 0 0" mass="1"/><site name="eye"/></body></worldbody>
</mujoco>"""
DRAWN = ("frame", "depth", "segmentation", "at", "near_first")
STEPS, WARM = 100, 5


class Clock:
    """Sums the time inside of some methods, the outermost call of each."""

    def __init__(self) -> None:
        self.spent_s, self._depth = 0.0, 0

    def timed(self, method: Callable[..., Any]) -> Callable[..., Any]:
        """The method, with its time added."""

        def run(*arguments: Any, **named: Any) -> Any:
            self._depth += 1
            began_s = time.perf_counter()
            try:
                return method(*arguments, **named)
            finally:
                self._depth -= 1
                if not self._depth:
                    self.spent_s += time.perf_counter() - began_s

        return run


def measured(width_px: int, height_px: int, every: int) -> tuple[float, float, float]:
    """Seconds of all calls, of drawing and of the sensor, per call."""
    mujoco = import_mujoco()
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.qvel[0] = 0.5
    lens = Camera(
        width_px, height_px, 0.65 * width_px, 0.65 * width_px, width_px / 2, height_px / 2
    )
    draw, sense = Clock(), Clock()
    patches = [
        mock.patch.object(StereoRenderer, name, draw.timed(getattr(StereoRenderer, name)))
        for name in DRAWN
    ]
    patches += [
        mock.patch.object(Sensor, name, sense.timed(getattr(Sensor, name)))
        for name in ("between", "step", "start")
    ]
    for patch in patches:
        patch.start()
    took_s = 0.0
    with EventCamera(model, "site:eye", lens, config=SimConfig()) as camera:
        for k in range(STEPS + WARM):
            if k == WARM:
                took_s = draw.spent_s = sense.spent_s = 0.0
            for _ in range(every):
                mujoco.mj_step(model, data)
            began_s = time.perf_counter()
            camera.step(data)
            took_s += time.perf_counter() - began_s
    for patch in patches:
        patch.stop()
    return took_s / STEPS, draw.spent_s / STEPS, sense.spent_s / STEPS


def main() -> None:
    """Prints the table, or writes it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    lines = [
        "| Sensor | call every | per call | drawing | events | everything else | of drawing |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for width_px, height_px, every in ((346, 260, 1), (346, 260, 5), (1280, 720, 5)):
        all_s, draw_s, sense_s = measured(width_px, height_px, every)
        rest_s = all_s - draw_s - sense_s
        numbers = " | ".join(f"{1e3 * s:.1f} ms" for s in (all_s, draw_s, sense_s, rest_s))
        share = f"{100 * rest_s / draw_s:.0f} %"
        lines.append(f"| {width_px}×{height_px} | {2 * every} ms | {numbers} | {share} |")
    text = "\n".join(lines) + "\n"
    show(text, asked.page, "step-cost")


if __name__ == "__main__":
    main()
