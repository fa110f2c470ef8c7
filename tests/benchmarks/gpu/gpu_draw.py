"""Draws one rig's view of a scene for a while and counts pictures: a program of its own.

Usage: `python tests/benchmarks gpu_draw KIND RIG SECONDS`; KIND is classic, float, or for fine
frames kernels or shader: what makes light of their samples. The last line on standard output is
JSON.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from eventsweep import scenes
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.base import Frame
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.sampling import border_px, with_sampling

SCENE = "desk"
_BATCH = 4
_COMPARED = 5


def rate(draw: Callable[[float], object], duration_s: float, seconds: float) -> float:
    """Pictures per second along the scene's motion, after a few that only warm up."""
    for _ in range(_BATCH):
        draw(0.0)
    begin, count = time.perf_counter(), 0
    while time.perf_counter() - begin < seconds or count < _BATCH:
        for _ in range(_BATCH):
            draw(0.01 * count % duration_s)
            count += 1
    return count / (time.perf_counter() - begin)


def classic(rig_name: str, seconds: float, *, floats: bool) -> dict[str, Any]:
    """Pictures of camera 0 as the simulator draws them: intensity and depth, in memory."""
    scene, rig = scenes.load(SCENE), named_rig(rig_name)
    motion = scene.motion(scene.duration_s, 0)
    with StereoRenderer(scene.spec(), rig, 1, scene.depth_range_m, floats=floats) as renderer:
        found = rate(
            lambda t_s: renderer.frame(0, motion.T_world_body(t_s)), scene.duration_s, seconds
        )
        return {"per_s": found, "drawn_by": renderer.description}


def fine(rig_name: str, seconds: float, *, shader: bool) -> dict[str, Any]:
    """Fine frames of camera 0, sampled as `accurate` does; from a shader, held against the kernels.

    `apart` is the greatest difference of light, of full scale, and of the depth, of itself.
    """
    scene, rig = scenes.load(SCENE), named_rig(rig_name)
    motion, config = scene.motion(scene.duration_s, 0), with_sampling(SimConfig(), rig)
    assert config.supersample is not None
    arguments = scene.spec(), rig, config.supersample, scene.depth_range_m
    border = border_px(config)
    with StereoRenderer(*arguments, border_px=border, shader=shader) as renderer:
        poses = [motion.T_world_body(0.1 * k % scene.duration_s) for k in range(_COMPARED)]
        frames = [renderer.frame(0, pose) for pose in poses]
        found = rate(
            lambda t_s: renderer.frame(0, motion.T_world_body(t_s)), scene.duration_s, seconds
        )
        drawn_by = renderer.description
    if not shader:
        return {"per_s": found, "drawn_by": drawn_by}
    with StereoRenderer(*arguments, border_px=border, shader=False) as renderer:
        apart = [
            _apart(frame, renderer.frame(0, p)) for frame, p in zip(frames, poses, strict=True)
        ]
    return {"per_s": found, "drawn_by": drawn_by, "apart": np.max(apart, axis=0).tolist()}


def _apart(found: Frame, expected: Frame) -> tuple[float, float]:
    assert found.samples is not None
    assert expected.samples is not None
    rho, true_rho = 1 / found.nearest_depth_m, 1 / expected.nearest_depth_m
    return (
        float(np.abs(found.samples.light - expected.samples.light).max()),
        float((np.abs(rho - true_rho) / np.maximum(true_rho, 1e-9)).max()),
    )


def main(kind: str, rig_name: str, seconds: str) -> None:
    """Draws, prints, and ends without tearing anything down: that can crash."""
    if kind in ("kernels", "shader"):
        found = fine(rig_name, float(seconds), shader=kind == "shader")
    else:
        found = classic(rig_name, float(seconds), floats=kind == "float")
    sys.stdout.write("\n" + json.dumps(found) + "\n")
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
