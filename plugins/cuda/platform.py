"""An NVIDIA GPU as a device of the sweep, for the group `eventsweep.devices`."""

from __future__ import annotations

from collections.abc import Sequence

from eventsweep.emvs.dsi.backend import Task
from eventsweep.emvs.dsi.rays import Rays
from eventsweep.plugins.cuda import device
from eventsweep.plugins.cuda.arrays import DeviceRays
from eventsweep.plugins.cuda.backend import CudaBackend
from eventsweep.plugins.cuda.backprojection import CudaProjector
from eventsweep.plugins.cuda.device import missing as missing


def name() -> str:
    """The GPU's name; an `InputError` where there is none."""
    return device.gpu().name


def projector() -> CudaProjector:
    """What turns events into rays on the GPU."""
    return CudaProjector()


def backend(task: Task, rays: Sequence[Rays | DeviceRays]) -> CudaBackend:
    """What computes the sweep of one split on the GPU."""
    return CudaBackend(task, rays)
