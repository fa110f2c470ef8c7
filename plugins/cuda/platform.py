"""An NVIDIA GPU as a device of the sweep, for the group `eventsweep.devices`."""

from __future__ import annotations

from eventsweep.plugins.cuda import device
from eventsweep.plugins.cuda.backend import CudaBackend as backend
from eventsweep.plugins.cuda.backprojection import CudaProjector as projector
from eventsweep.plugins.cuda.device import missing

__all__ = ["backend", "missing", "name", "projector"]


def name() -> str:
    """The GPU's name; an `InputError` where there is none."""
    return device.gpu().name
