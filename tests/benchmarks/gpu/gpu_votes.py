"""The votes alone: the planes of all cameras cast, nothing fused and nothing brought down."""

from __future__ import annotations

import importlib
import time

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.dsi.backend import Task
from eventsweep.emvs.dsi.backprojection import back_project
from eventsweep.emvs.dsi.device import backend_on, choose_device, projector_on
from eventsweep.emvs.dsi.fusion import WHOLE
from eventsweep.emvs.methods.method import single_camera
from eventsweep.emvs.reference_view import reference_view
from eventsweep.emvs.windows import choose_window


def votes_s(recording: Recording, config: MapperConfig, rounds: int) -> float:
    """What casting all votes of a window takes, s: the median of `rounds`, after a first time.

    The rays are there already, on the device that votes; its sums become float votes, as the
    fusion wants them.
    """
    device = choose_device(config.device)
    window = choose_window(recording, config)
    view = reference_view(recording, config, window.t_ref_us)
    projected = back_project(recording, window, view, [WHOLE], projector_on(device))
    chosen, camera = (single_camera(0).target(config),), view.camera
    task = Task(
        chosen, len(recording.rig), camera.width_px, camera.height_px, view.rho, 0, config,
    )  # fmt: skip
    backend = backend_on(device, task, projected.rays[WHOLE])
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
