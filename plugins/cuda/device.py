"""The GPU as numba offers it: whether there is one, what it is, and how its kernels are started."""

# Numba's names appear at run time, real or simulated.
# mypy: disable-error-code="no-untyped-call, attr-defined"

from __future__ import annotations

import operator
import threading
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numba
from numba import cuda
from numba.cuda.cudadrv.driver import CudaAPIError

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.release import install_extra

# The simulator runs kernels as plain Python on the CPU, for tests on tiny inputs: a Python thread
# for each of theirs.
SIMULATED = bool(numba.config.ENABLE_CUDASIM)

# Counters are spread over so many places that threads seldom wait for each other; a power of 2.
SLOTS = 4 if SIMULATED else 256
THREADS = 8 if SIMULATED else 256  # of a block
_STRIDED_BLOCKS = 2 if SIMULATED else 4096  # of a row, in loops that stride
_L2_BYTES = 32 << 20  # where a device does not tell


# Products that are rounded before anything is added to them, as the CPU's are. The GPU's compiler
# would join product and sum into one rounding, and a ray at the image's rim would then vote on one
# device and not on the other.
if SIMULATED:
    product = double_product = operator.mul
else:
    from numba.cuda import libdevice

    product, double_product = libdevice.fmul_rn, libdevice.dmul_rn

CUDA_ERRORS = (CudaAPIError,)  # such as: out of memory
Launch = tuple[int | tuple[int, int], int, Any]

_of_thread = threading.local()
# Small grids are right for small images; numba would warn of each.
numba.config.CUDA_LOW_OCCUPANCY_WARNINGS = 0


@dataclass(frozen=True)
class Gpu:
    """The GPU that is used: the first that CUDA shows (`CUDA_VISIBLE_DEVICES` says which).

    Attributes:
        name: as its maker calls it.
        l2_bytes: its second-level cache.
        memory_bytes: free memory, when asked.
    """

    name: str
    l2_bytes: int
    memory_bytes: float


def missing() -> str | None:
    """Why there is no GPU to compute on, and how to cure it; None where there is one."""
    if SIMULATED:
        return None
    if find_spec("numba_cuda") is None:
        return f"numba-cuda is not installed: {install_extra('cuda')}, or choose device cpu"
    if not cuda.is_available():
        reason = " ".join(str(cuda.cuda_error() or "CUDA finds no GPU").split()).rstrip(".")
        return f"{reason}; check that nvidia-smi shows a GPU, or choose device cpu"
    return None


def gpu() -> Gpu:
    """The GPU, with the memory that is free now.

    Raises:
        InputError: there is none.
    """
    reason = missing()
    if reason is not None:
        raise InputError(f"device cuda cannot be used: {reason}")
    context = cuda.current_context()
    if SIMULATED:
        return Gpu("numba's simulator", _L2_BYTES, context.get_memory_info().free)
    context.deallocations.clear()  # what is let go of counts as free
    device = cuda.get_current_device()
    name = device.name.decode() if isinstance(device.name, bytes) else str(device.name)
    l2_bytes = int(device.L2_CACHE_SIZE) or _L2_BYTES
    return Gpu(name, l2_bytes, context.get_memory_info().free)


def stream() -> Any:
    """The calling thread's queue of work on the GPU: threads do not wait for each other's."""
    if not hasattr(_of_thread, "stream"):
        _of_thread.stream = cuda.stream()
    return _of_thread.stream


def each(items: int) -> Launch:
    """How to start a loop with a thread per item."""
    return max(1, -(-items // THREADS)), THREADS, stream()


def strided(items: int, rows: int = 1) -> Launch:
    """How to start a loop that strides over the items of each of several rows."""
    blocks = min(max(1, -(-items // THREADS)), _STRIDED_BLOCKS)
    return (blocks, rows), THREADS, stream()
