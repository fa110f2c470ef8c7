"""Which device computes the sweep: the CPU, or what a plug-in brings, such as an NVIDIA GPU.

A plug-in offers a device under the name that users choose it by:

    [project.entry-points."eventsweep.devices"]
    mine = "my_package.platform"
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, cast

from eventsweep.emvs.dsi.backend import Backend, CpuBackend, Task
from eventsweep.emvs.dsi.backprojection import AnyRays, CpuProjector, Projector
from eventsweep.emvs.utils.plugins import DEVICES, files_of, modules_of, offered, points

AUTO = "auto"
_log = logging.getLogger(__name__)


class Platform(Protocol):
    """What computes sweeps on a device: a module or an object with these functions."""

    def missing(self) -> str | None:
        """Why nothing can be computed here, and how to cure it; None where it can."""

    def name(self) -> str:
        """The device that is used, as its maker calls it.

        Raises:
            InputError: there is none: why, and how to cure it.
        """

    def projector(self) -> Projector:
        """What turns events into rays that stay on the device."""

    def backend(self, task: Task, rays: Sequence[Any]) -> Backend:
        """What computes the sweep of one split, where the rays of every volume lie.

        Raises:
            InputError: too little memory for a single plane.
        """


@dataclass(frozen=True)
class Device:
    """What computes: its kind, and the name of the one that is used, which is `cpu` for the CPU."""

    kind: str
    name: str


CPU = Device("cpu", "cpu")


def names() -> tuple[str, ...]:
    """What a device can be chosen by."""
    return CPU.kind, *(point.name for point in points(DEVICES)), AUTO


def choose_device(wanted: str) -> Device:
    """The device of a name; `auto` takes another than the CPU where it can, and logs what it took.

    Raises:
        InputError: an unknown device, or one that cannot be used: why, and how to cure it.
    """
    if wanted == CPU.kind:
        return CPU
    if wanted != AUTO:
        return Device(wanted, _platform(wanted).name())
    reason = "no plug-in with another device is installed"
    for point in points(DEVICES):
        platform = _platform(point.name)
        missing = platform.missing()
        if missing is None:
            device = Device(point.name, platform.name())
            _log.warning("device auto took the GPU %s", device.name)
            return device
        reason = missing
    _log.warning("device auto took the CPU: %s", reason)
    return CPU


def check_device(wanted: str) -> None:
    """Refuses a device that cannot be used.

    Raises:
        InputError: why, and how to cure it.
    """
    if wanted != AUTO:
        choose_device(wanted)


def code_of_device(wanted: str) -> tuple[tuple[str, ...], tuple[Path, ...]]:
    """Modules of a plug-in of ours, or files of another package, that a device comes with."""
    its = [point for point in points(DEVICES) if point.name == wanted]
    return modules_of(its), tuple(files_of(its))


def projector_on(device: Device) -> Projector:
    """What turns events into rays on a device."""
    return CpuProjector() if device == CPU else _platform(device.kind).projector()


def backend_on(device: Device, task: Task, rays: Sequence[AnyRays]) -> Backend:
    """What computes the sweep of one split on a device, where the rays of every volume lie.

    Raises:
        InputError: a device with too little memory for a single plane.
    """
    # They come from this device's own projector.
    device_rays: Any = rays
    if device == CPU:
        return CpuBackend(task, device_rays)
    return _platform(device.kind).backend(task, device_rays)


def _platform(name: str) -> Platform:
    """Loads what computes on a device: a GPU's libraries take seconds, and not everybody has them.

    Raises:
        InputError: no plug-in brings it, or the plug-in cannot be loaded.
    """
    return cast("Platform", offered(DEVICES, name, "device", names()))
