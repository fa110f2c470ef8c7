"""Worker processes: they end when the process that started them does, however that ended."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
from contextlib import suppress

_PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """To be called by a worker first: Linux ends it at once when its parent dies, even by a kill.

    Elsewhere a worker sees only that its pipe is closed, when it next looks at it.
    """
    with suppress(AttributeError, OSError):  # not Linux
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    parent = multiprocessing.parent_process()
    if parent is not None and os.getppid() != parent.pid:  # it died in between
        os._exit(1)
