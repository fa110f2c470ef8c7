"""The command line, `eventsweep` and `python -m eventsweep`, wherever it is started."""

from __future__ import annotations

import gc
import os
import signal
import sys


def _leave(_number: int, _frame: object) -> None:
    """Ends at once: until the command begins there is nothing to tidy up."""
    os.write(2, b"eventsweep: interrupted before it began\n")
    os._exit(130)


def _is_worker() -> bool:
    """Whether this process was started by another of ours, which ends it as it sees fit."""
    processes = sys.modules.get("multiprocessing.process")
    if processes is None:
        return False
    # While a spawned process imports its main module it knows no parent yet.
    is_starting = getattr(processes.current_process(), "_inheriting", False)
    return is_starting or processes.parent_process() is not None


# Imports take a quarter of a second, in which Ctrl-C would show where it struck. `exit_code` of
# `eventsweep.eval.cli` takes over.
if __name__ in ("__main__", "eventsweep.__main__") and not _is_worker():
    signal.signal(signal.SIGTERM, _leave)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def main() -> None:
    """Runs one command and ends the process with its code."""
    # Matrices here are small: BLAS threads would spin, take the others' time and gain nothing.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.disable()  # what imports make stays: looking through it again and again frees nothing
    from eventsweep.eval.cli.main import main as command

    gc.enable()
    command()


if __name__ == "__main__":
    main()
