"""Which graphics library draws: the GPU's EGL where there is one that works, else software.

Only a machine that has a GPU's device file is tried out, in a process of its own
(`sim.graphics.probe`), because a driver can crash or hang whoever starts it. What is found holds
for this process and, through the environment, for those that it starts.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from eventsweep.emvs.errors import InputError

# Why drawing is done in software although there is a GPU; `sim.simulate` gives notice of it.
NOTE = "EVENTSWEEP_GRAPHICS_NOTE"
# Which of several GPUs draws.
DEVICE = "MUJOCO_EGL_DEVICE_ID"
_PROBE = Path(__file__).with_name("probe.py")
# The first start of a driver that serves several GPUs takes seconds.
_LIMIT_S = 60.0
_GPU_FILES = ("dev/nvidiactl", "dev/dri/renderD*", "dev/dxg")
# Where drivers leave their EGL beside the places that libglvnd looks in by itself.
_VENDOR_FILES = (
    "usr/local/nvidia/share/glvnd/egl_vendor.d/*.json",
    "run/opengl-driver/share/glvnd/egl_vendor.d/*.json",
)
_VENDOR, _VENDOR_FOLDERS = "__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS"
_STEERING = (_VENDOR, _VENDOR_FOLDERS, DEVICE)
_SOFTWARE = re.compile(r"llvmpipe|softpipe|swrast|swr\b|software|swiftshader|basic render", re.I)


@dataclass(frozen=True)
class Driver:
    """What draws, as OpenGL names it, and how many devices EGL lists: 1 if it was not asked."""

    vendor: str
    renderer: str
    version: str
    devices: int = field(default=1, compare=False)

    @property
    def hardware(self) -> bool:
        """Whether a GPU draws."""
        return _SOFTWARE.search(f"{self.vendor} {self.renderer}") is None

    @property
    def identity(self) -> str:
        """What decides the pixels: all but the width of llvmpipe's vectors, which does not."""
        return f"{re.sub(r', [0-9]+ bits', '', self.renderer)}, {self.vendor}, {self.version}"


@dataclass(frozen=True)
class Choice:
    """A graphics library.

    Attributes:
        backend: egl or osmesa.
        environment: variables that must be set before it is loaded.
        note: why a GPU is not used; empty where there is nothing to tell.
    """

    backend: str
    environment: Mapping[str, str] = field(default_factory=dict)
    note: str = ""

    def adopt(self) -> None:
        """Makes it the choice of this process and of those that it starts."""
        os.environ.update({"MUJOCO_GL": self.backend, **self.environment})
        if self.note:
            os.environ[NOTE] = self.note


def has_gpu(root: Path = Path("/")) -> bool:
    """Whether the system has a GPU's device file: the only machines worth trying a driver on."""
    return bool(_any(root, _GPU_FILES))


@cache
def choose(installed: tuple[str, ...], root: Path = Path("/")) -> Choice:
    """Chooses among the installed libraries, egl, osmesa or both, the preferred one first.

    Raises:
        InputError: EGL is installed and does not start, and OSMesa is not.
    """
    if installed[0] != "egl" or not has_gpu(root):
        return Choice(installed[0])
    tried: list[Driver | str] = []
    for environment in _environments(root):
        tried.append(probe("egl", environment))
        if isinstance(tried[-1], Driver) and tried[-1].hardware:
            return Choice("egl", environment)
    first = tried[0]
    if isinstance(first, Driver):
        return Choice("egl", note="the GPU offers no EGL here")
    if "osmesa" in installed:
        return Choice("osmesa", note=f"EGL does not start ({first})")
    raise InputError(
        f"EGL does not start ({first}): fix the GPU's driver, or render in software, on Debian: "
        "apt-get install libosmesa6"
    )


def probe(backend: str, environment: Mapping[str, str] | None = None) -> Driver | str:
    """Starts a graphics library in a process of its own, once for each environment.

    Returns what draws, or why nothing does, in a few words. The environment is added to this
    process's.
    """
    steering = {name: os.environ[name] for name in _STEERING if name in os.environ}
    return _probed(backend, tuple(sorted((steering | dict(environment or {})).items())))


def equal_devices(driver: Driver) -> tuple[int, ...]:
    """EGL's numbers of the devices that draw as `driver`, the current one, does.

    Only equal devices may share a sequence, or its bytes would depend on the number of workers.
    """
    if driver.devices < 2 or not driver.hardware or DEVICE in os.environ:
        return ()
    numbers = range(driver.devices)
    return tuple(n for n in numbers if probe("egl", {DEVICE: str(n)}) == driver)


@cache
def _probed(backend: str, environment: tuple[tuple[str, str], ...]) -> Driver | str:
    # PyOpenGL's variable is MuJoCo's doing once it is loaded, and holds for this process only.
    ours = {"MUJOCO_GL"} | ({"PYOPENGL_PLATFORM"} if "OpenGL" in sys.modules else set())
    outside = {name: value for name, value in os.environ.items() if name not in ours}
    command = [sys.executable, "-P", str(_PROBE), backend]
    process = subprocess.Popen(
        command, env=outside | dict(environment), text=True, errors="replace",
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        said, complained = process.communicate(timeout=_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        # Inside a hanging driver not even that ends it: it is left behind.
        with suppress(subprocess.TimeoutExpired):
            process.wait(1)
        return f"no answer within {_LIMIT_S:g} s"
    if process.returncode == 0:
        with suppress(ValueError, TypeError, IndexError):
            return Driver(**json.loads(said.splitlines()[-1]))
    return _reason(process.returncode, complained)


def _environments(root: Path) -> list[dict[str, str]]:
    """The user's own, and one per place where a driver may have left its EGL."""
    if _VENDOR in os.environ or _VENDOR_FOLDERS in os.environ:
        return [{}]
    return [{}, *({_VENDOR: str(file)} for file in _any(root, _VENDOR_FILES))]


def _any(root: Path, patterns: tuple[str, ...]) -> list[Path]:
    return [file for pattern in patterns for file in sorted(root.glob(pattern))]


def _reason(code: int, complained: str) -> str:
    if code < 0:
        return f"it ends by {signal.Signals(-code).name}"
    lines = complained.strip().splitlines()
    return lines[-1].strip()[:160] if lines else f"exit code {code}"
