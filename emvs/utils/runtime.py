"""What a run is made of: progress, stop watch, threads, free memory, versions of the libraries."""

import ctypes
import gc
import importlib
import os
import platform
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import Any

import numba
from numba.core import event

from eventsweep.emvs.errors import InputError, heed_interrupt
from eventsweep.emvs.utils.kernel_cache import give_up, use_kernel_cache

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, how much of it is done, and how much there is."""
# What the numbers of a result depend on -> the distribution that carries it.
_LIBRARIES = {
    name: name
    for name in ("eventsweep", "numpy", "numba", "scipy", "opencv-python-headless", "h5py")
} | {"mujoco": "mujoco-core", "numba-cuda": "numba-cuda"}


def silent(_stage: str, _done: int, _total: int) -> None:
    """Shows no progress."""


class Stopwatch:
    """Wall time per stage, in `seconds`."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._since = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Books the time since the last lap on `stage`."""
        now = time.perf_counter()
        self.seconds[stage], self._since = now - self._since, now


_LAYERS = ("default", "safe", "forksafe", "threadsafe", "omp", "tbb", "workqueue")


def check_numba() -> None:
    """Refuses what the environment tells numba and no kernel can run with.

    Raises:
        InputError: names the variable: numba itself ends in errors that do not.
    """
    config: Any = numba.config
    if config.DISABLE_JIT:
        raise InputError("NUMBA_DISABLE_JIT is set, but kernels run only when compiled: unset it")
    layer = os.environ.get("NUMBA_THREADING_LAYER", "omp").split()
    if not set(layer) <= {*_LAYERS}:
        raise InputError(
            f"NUMBA_THREADING_LAYER is {' '.join(layer)!r}: needs one of {', '.join(_LAYERS)}; "
            "correct or unset it"
        )


check_numba()
# Threads that spin while they wait take the time of others that work: here, or in other processes.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# OpenMP is safe when several Python threads call kernels; numba's own queue ends the process.
if "NUMBA_THREADING_LAYER" not in os.environ:
    numba.config.THREADING_LAYER = "omp"  # type: ignore[attr-defined]
use_kernel_cache()


class _Compiling(event.Listener):
    """Keeps Python's collector of cycles off while numba compiles; lets others try what failed.

    What numba builds stays until it is done; looking through it again and again takes a fifteenth.
    """

    def __init__(self) -> None:
        self._handled: list[BaseException | None] = []  # as the compilations that go on began
        self._was_on = False

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        """Compiling begins; within it, of what is called."""
        if not self._handled:
            self._was_on = gc.isenabled()
            gc.disable()
        self._handled.append(sys.exception())

    def on_end(self, event: event.Event) -> None:
        """It ends, or failed: numba's `is_failed` says the opposite."""
        if sys.exception() is not self._handled.pop():
            give_up(event.data["dispatcher"])
        if not self._handled and self._was_on:
            gc.enable()


event.register("numba:compile", _Compiling())


@cache
def check_openmp() -> None:
    """Finds out before any work whether the kernels can have their threads."""
    try:
        importlib.import_module("numba.np.ufunc.omppool")
    except ImportError as error:
        heed_interrupt(error)
        if numba.config.THREADING_LAYER == "omp":  # type: ignore[attr-defined]
            raise InputError(
                f"numba cannot load OpenMP ({error}): install it, on Debian: "
                "apt-get install libgomp1"
            ) from error


def use_threads(count: int) -> int:
    """Sets how many threads the kernels use and returns it; 0 means all of them."""
    chosen = thread_count(count)
    numba.set_num_threads(chosen)
    return chosen


def thread_count(count: int) -> int:
    """How many threads the kernels get that ask for `count`; 0 means all of them."""
    available = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    return min(count, available) if count > 0 else available


def in_threads(kernel: Callable[..., None], count: int, *args: object) -> None:
    """Calls `kernel(start, stop, *args)` for parts of `range(count)`, one in each thread.

    Loops that numba shares out by itself take two to three times as long to compile. What is
    written for one number of the range must not depend on the others: then the results are the
    same for any number of threads, `numba.get_num_threads` of them.

    Args:
        kernel: compiled without the interpreter's lock, which would let one run at a time.
        count: of the parts that the work can be divided into.
        args: what else the kernel takes.
    """
    threads = max(1, min(numba.get_num_threads(), count))
    own, *others = pairwise(k * count // threads for k in range(threads + 1))
    started = [_pool().submit(kernel, *part, *args) for part in others]
    try:
        kernel(*own, *args)
    finally:
        wait(started)  # they write into the same arrays
    for each in started:
        each.result()


@cache
def _pool() -> ThreadPoolExecutor:
    """Threads beside the one that calls; they start when they are needed, and then remain."""
    return ThreadPoolExecutor(int(numba.config.NUMBA_NUM_THREADS), "kernel")  # type: ignore[attr-defined]


os.register_at_fork(after_in_child=_pool.cache_clear)  # the child has none of its parent's threads


def versions() -> dict[str, str]:
    """Python's and each library's version; "absent" where one is not installed."""
    return {"python": platform.python_version()} | {
        name: _version(distribution) for name, distribution in _LIBRARIES.items()
    }


@cache  # what is installed stays so while a process runs
def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "absent"


def give_back_memory() -> None:
    """Gives freed memory back to the system: glibc would keep what lies between used blocks."""
    with suppress(AttributeError, OSError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


def available_bytes() -> int:
    """Memory that a process can still get: the system's, or its control group's if that is less."""
    return min(_system_bytes(), _group_bytes())


def _system_bytes() -> int:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line[:12] == "MemAvailable")
    except (OSError, StopIteration, ValueError):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _group_bytes() -> int:
    group = Path("/sys/fs/cgroup")
    try:
        most = int((group / "memory.max").read_text(encoding="ascii"))
        return max(0, most - int((group / "memory.current").read_text(encoding="ascii")))
    except (OSError, ValueError):  # no control group, or one without a limit
        return 1 << 62
