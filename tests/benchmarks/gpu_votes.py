"""The votes alone: the planes of all cameras cast, nothing fused and nothing brought down."""

from __future__ import annotations

import importlib
import time

import numpy as np

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.dsi import device as devices
from emvs.dsi.backend import Task
from emvs.dsi.backprojection import back_project
from emvs.dsi.method import WHOLE, single_cameras
from emvs.reference_view import reference_view
from emvs.utils.runtime import silent
from emvs.windows import choose_window


def votes_s(recording: Recording, config: MapperConfig, rounds: int) -> float:
    """What casting all votes of a window takes, s: the median of `rounds`, after a first time.

    The rays are there already, on the device that votes; its sums become float votes, as the
    fusion wants them.
    """
    device = devices.choose(config.device)
    window = choose_window(recording, config)
    view = reference_view(recording, config, window.t_ref_us)
    projector = devices.projector(device)
    rays = back_project(recording, config, window, view, silent, [WHOLE], projector).rays[WHOLE]
    chosen, camera = single_cameras(1), view.camera
    task = Task(
        chosen, chosen, len(recording.rig), camera.width_px, camera.height_px, view.rho, 0, config
    )
    backend = devices.backend(device, task, rays)
    planes, step, seconds = len(view.rho), backend.planes_in_flight, []
    for _ in range(rounds + 1):
        _wait(device.kind)
        begin = time.perf_counter()
        for first in range(0, planes, step):
            backend.cast(first, min(first + step, planes))
        _wait(device.kind)
        seconds.append(time.perf_counter() - begin)
    return float(np.median(seconds[1:]))


def _wait(kind: str) -> None:
    if kind == "cuda":
        importlib.import_module("numba.cuda").synchronize()
