"""On what was measured: GPU, driver, CUDA, libraries and processors."""

from __future__ import annotations

import importlib
import os
import platform
import subprocess
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.runtime import versions

_LIBRARIES = ("numba-cuda", "cuda-bindings", "cuda-core", "cuda-toolkit", "llvmlite", "pyopengl")
_SMI = ("name", "driver_version", "memory.total", "clocks.max.sm", "clocks.max.mem", "power.limit")
_MIB = 1 << 20


def check_device(kind: str) -> None:
    """Refuses before any work what cannot be measured here.

    Raises:
        InputError: a mapper without a CUDA backend, or no GPU that it can use.
    """
    if kind != "cuda":
        return
    if "device" not in MapperConfig.model_fields or find_spec("eventsweep.plugins.cuda") is None:
        raise InputError(
            "this version's mapper has no CUDA backend: take one that has it, or try "
            "the script with --device cpu"
        )
    importlib.import_module("eventsweep.emvs.dsi.device").choose_device("cuda")


def machine(kind: str) -> dict[str, Any]:
    """Everything that a figure's reader wants to know; None where it cannot be found out."""
    return {
        "cpu": cpu_name(),
        "cores": len(os.sched_getaffinity(0)),
        "load_average": os.getloadavg()[0],
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "system": f"{platform.system()} {platform.release()}",
        "versions": versions() | {name: _version(name) for name in _LIBRARIES},
        "gpu": gpu() if kind == "cuda" else None,
    }


def cpu_name() -> str:
    """The processor's name as Linux tells it."""
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    return names[0] if names else platform.machine()


def gpu() -> dict[str, Any]:
    """The GPU as CUDA and its driver name it."""
    cuda: Any = importlib.import_module("numba.cuda")
    library: Any = importlib.import_module("eventsweep.plugins.cuda.device")
    used, device = library.gpu(), cuda.current_context().device
    driver = "numba.cuda.cudadrv.driver"
    return {
        "name": used.name,
        "l2_bytes": used.l2_bytes,
        "free_bytes": float(used.memory_bytes),
        "compute_capability": list(getattr(device, "compute_capability", ())) or None,
        "multiprocessors": getattr(device, "MULTIPROCESSOR_COUNT", None),
        "cuda_runtime": _cuda_version(lambda: cuda.runtime.get_version()),
        "cuda_driver": _cuda_version(lambda: importlib.import_module(driver).get_version()),
        "simulated": bool(library.SIMULATED),
        "nvidia_smi": _nvidia_smi(),
    }


# numba's simulator answers -1.
def _cuda_version(ask: Any) -> str | None:
    try:
        parts = tuple(ask())
    except Exception:  # what numba offers here changes with its version; the figure stands without
        return None
    return None if min(parts) < 0 else ".".join(map(str, parts))


def _nvidia_smi() -> dict[str, str] | None:
    """What the driver says of the first GPU: reading only, nothing is set."""
    command = ["nvidia-smi", f"--query-gpu={','.join(_SMI)}", "--format=csv,noheader", "--id=0"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    values = [value.strip() for value in done.stdout.strip().split(",")]
    return dict(zip(_SMI, values, strict=True)) if len(values) == len(_SMI) else None


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "absent"


def title(found: dict[str, Any]) -> str:
    """One sentence for people."""
    gpu_, libraries = found["gpu"], found["versions"]
    cpu = f"{found['cores']} cores of {found['cpu']}"
    python = f"Python {libraries['python']}, numba {libraries['numba']}"
    if gpu_ is None:
        return f"No GPU; {cpu}; {python}."
    smi = gpu_["nvidia_smi"] or {}
    driver = smi.get("driver_version", "unknown")
    return (
        f"{gpu_['name']}, driver {driver}, CUDA runtime {gpu_['cuda_runtime'] or 'unknown'}, "
        f"L2 {gpu_['l2_bytes'] / _MIB:.0f} MiB; {cpu}, load average {found['load_average']:.1f}; "
        f"{python}, numba-cuda {libraries['numba-cuda']}."
    )
