"""The mapper's sweep on an NVIDIA GPU; imported only where `device` asks for it."""

from contextlib import suppress

import numba
from numba import cuda  # noqa: F401  (first: it puts numba-cuda in its place)

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

with suppress(ImportError):  # numba-cuda has settings of its own, where it is installed
    from numba.cuda.core import config

    config.CACHE_DIR = numba.config.CACHE_DIR  # type: ignore[attr-defined]
