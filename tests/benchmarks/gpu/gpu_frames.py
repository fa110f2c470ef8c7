"""Pictures per second, by every renderer, on the GPU and in software."""

from __future__ import annotations

import ctypes.util
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.sim.graphics import choice
from gpu_plan import BenchmarkPlan

DRAW = Path(__file__).with_name("gpu_draw.py")
_LIMIT_S = 120.0
KINDS = ("classic", "float", "filament")
FINE_KINDS = ("kernels", "shader")
# How far light of a shader may be from that of the kernels, of full scale; and depth, of itself.
_APART = 1e-6
_STEERING = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "LIBGL_ALWAYS_SOFTWARE")
_MESA_EGL = "usr/share/glvnd/egl_vendor.d/*mesa*.json"
_LAVAPIPE = "usr/share/vulkan/icd.d/lvp_icd*.json"


@dataclass(frozen=True)
class Drawn:
    """One renderer at one size.

    Attributes:
        kind: classic, float or filament; of fine frames kernels or shader.
        where: `GPU` or `software`: what was asked for.
        rig: whose camera 0 was drawn.
        per_s: pictures per second, read back into memory; None where nothing was drawn.
        drawn_by: what drew, in its own words; or why nothing did.
        apart: of a shader, how far light and depth are from those of the kernels.
    """

    kind: str
    where: str
    rig: str
    per_s: float | None
    drawn_by: str
    apart: tuple[float, float] | None = None

    def faults(self) -> list[str]:
        """What is wrong with the pictures."""
        if self.apart is None or all(one <= _APART for one in self.apart):
            return []
        light, depth = self.apart
        return [
            f"frames: {self.kind} of {self.rig} on {self.where}: light {light:.2g} and depth "
            f"{depth:.2g} from the kernels', above {_APART:g}"
        ]


def frames(plan: BenchmarkPlan) -> list[Drawn]:
    """Measures every renderer that there is, each in a process of its own.

    Raises:
        InputError: MuJoCo or PyOpenGL is not installed.
    """
    absent = [name for name in ("mujoco", "OpenGL") if find_spec(name) is None]
    if absent:
        raise InputError(f"{' and '.join(absent)} not installed: pip install mujoco pyopengl")
    return list(_all(plan))


def _all(plan: BenchmarkPlan) -> Iterator[Drawn]:
    for kind in (*KINDS, *FINE_KINDS):
        for where in ("GPU", "software"):
            chosen = _environment(kind, where)
            for rig in plan.fine_rigs if kind in FINE_KINDS else plan.frame_rigs:
                if isinstance(chosen, str):
                    yield Drawn(kind, where, rig, None, chosen)
                else:
                    yield _drawn(kind, where, rig, plan.frame_s, chosen)


def _environment(kind: str, where: str) -> dict[str, str] | str:
    """Variables that make this renderer draw there, or why it cannot."""
    if where == "GPU":
        if not choice.has_gpu():
            return "there is no GPU"
        chosen = {} if kind == "filament" else _egl()
        return chosen if chosen is not None else "the GPU offers no EGL"
    if kind == "filament":
        files = _found(_LAVAPIPE)
        named = {"VK_DRIVER_FILES": files, "VK_ICD_FILENAMES": files}
        return named if files else "Mesa's lavapipe is not installed"
    if ctypes.util.find_library("OSMesa"):
        return {"MUJOCO_GL": "osmesa"}
    files = _found(_MESA_EGL)
    mesa = {
        "MUJOCO_GL": "egl",
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "__EGL_VENDOR_LIBRARY_FILENAMES": files,
    }
    return mesa if files else "neither OSMesa nor Mesa's EGL is installed"


def _egl() -> dict[str, str] | None:
    """What makes EGL draw on the GPU, or None."""
    try:
        chosen = choice.choose(("egl", "osmesa"))
    except InputError:
        return None
    return None if chosen.note else {"MUJOCO_GL": "egl", **chosen.environment}


def _found(pattern: str) -> str:
    return ":".join(str(path) for path in sorted(Path("/").glob(pattern)))


def _drawn(kind: str, where: str, rig: str, seconds: float, chosen: Mapping[str, str]) -> Drawn:
    kept = {name: value for name, value in os.environ.items() if name not in _STEERING}
    command = [sys.executable, str(DRAW), kind, rig, str(seconds)]
    try:
        done = subprocess.run(
            command, env=kept | dict(chosen), capture_output=True, text=True, errors="replace",
            timeout=_LIMIT_S + seconds,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Drawn(kind, where, rig, None, f"no answer within {_LIMIT_S + seconds:g} s")
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode != 0 or not lines:
        said = (done.stderr or done.stdout).strip().splitlines()
        return Drawn(
            kind, where, rig, None, f"exit {done.returncode}: {(said or ['silent'])[-1][:160]}"
        )
    found = json.loads(lines[-1])
    device = re.search(r"Selected physical device '([^']+)'", done.stdout)
    by = f"{found['drawn_by']}: {device[1]}" if device else found["drawn_by"]
    software = choice.Driver("", by, "").hardware is False
    if software != (where == "software"):
        return Drawn(kind, where, rig, None, f"drawn by {by} instead")
    apart = tuple(found["apart"]) if "apart" in found else None
    return Drawn(kind, where, rig, found["per_s"], by, apart)
