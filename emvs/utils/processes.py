"""Worker processes: they end when the process that started them does, however that ended."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import re
import signal
import sys
from contextlib import suppress
from pathlib import Path

from eventsweep.emvs.errors import InputError

_PR_SET_PDEATHSIG = 1
# Whoever asks one of these knows that a worker imports the script.
_GUARD = re.compile(rb"__name__|current_process|parent_process")


def check_guard() -> None:
    """Refuses workers for a script that would run again in each of them.

    A worker is a new Python, which imports the program's main file first.

    Raises:
        InputError: names the file, and what its calls must stand under.
    """
    main = sys.modules["__main__"]
    file, spec = getattr(main, "__file__", None), getattr(main, "__spec__", None)
    if file is None or (spec is not None and spec.name.rpartition(".")[2] == "__main__"):
        return  # an interpreter, or what workers do not import
    with suppress(OSError):
        source = Path(file).read_bytes()
        if b"\0" not in source and not _GUARD.search(source):
            raise InputError(
                f"{file}: each worker would run this script again: put its calls below "
                'if __name__ == "__main__":, or use one worker'
            )


def end_with_parent() -> None:
    """To be called by a worker first: Linux ends it at once when its parent dies, even by a kill.

    Elsewhere a worker sees only that its pipe is closed, when it next looks at it.
    """
    with suppress(AttributeError, OSError):  # not Linux
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    parent = multiprocessing.parent_process()
    if parent is not None and os.getppid() != parent.pid:  # it died in between
        os._exit(1)
