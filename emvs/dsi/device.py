"""Which device computes the sweep: the CPU, or an NVIDIA GPU where there is one."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from eventsweep.emvs.config import DeviceName
from eventsweep.emvs.dsi.backend import Backend, CpuBackend, Task
from eventsweep.emvs.dsi.backprojection import AnyRays, CpuProjector, Projector

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Device:
    """What computes: its kind, and the GPU's name, which is `cpu` for the CPU."""

    kind: Literal["cpu", "cuda"]
    name: str


CPU = Device("cpu", "cpu")


def choose_device(wanted: DeviceName) -> Device:
    """The device of a name; `auto` takes a GPU where one can be used, and logs what it took.

    Raises:
        InputError: `cuda`, and no GPU that can be used: why, and how to cure it.
    """
    if wanted == "cpu":
        return CPU
    # A GPU's libraries take seconds to load, and not everybody has them.
    from eventsweep.emvs.dsi.cuda import device as cuda_device

    reason = cuda_device.missing()
    if wanted == "auto" and reason is not None:
        _log.warning("device auto took the CPU: %s", reason)
        return CPU
    device = Device("cuda", cuda_device.gpu().name)
    if wanted == "auto":
        _log.warning("device auto took the GPU %s", device.name)
    return device


def check_device(wanted: DeviceName) -> None:
    """Refuses a GPU that is not there.

    Raises:
        InputError: why, and how to cure it.
    """
    if wanted == "cuda":
        choose_device(wanted)


def projector_on(device: Device) -> Projector:
    """What turns events into rays on a device."""
    if device.kind == "cpu":
        return CpuProjector()
    from eventsweep.emvs.dsi.cuda.backprojection import CudaProjector

    return CudaProjector()


def backend_on(device: Device, task: Task, rays: Sequence[AnyRays]) -> Backend:
    """What computes the sweep of one split on a device, where the rays of every volume lie.

    Raises:
        InputError: a GPU with too little memory for a single plane.
    """
    # They come from this device's own projector.
    device_rays: Any = rays
    if device.kind == "cpu":
        return CpuBackend(task, device_rays)
    from eventsweep.emvs.dsi.cuda.backend import CudaBackend

    return CudaBackend(task, device_rays)
