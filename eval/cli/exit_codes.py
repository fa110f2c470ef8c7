"""From exceptions to exit codes: one line on the error stream, and nothing half-written."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from emvs.errors import InputError

OK, BAD_INPUT, INTERRUPTED = 0, 2, 130

# Modules whose functions HDF5 calls from C: an interrupt that is raised there passes through
# libraries that do not expect it, which lose it or crash.
_CALLED_FROM_C = frozenset({"emvs.data.hdf5"})
_SOON_S = 0.05

# The libraries name their parameters; these are their flags.
_FLAGS = {
    "set force=True": "add --force",
    "set resume=False": "add --fresh",
    "resume=False": "--fresh",
    "frames.rate_hz": "--sim.frames.rate-hz",
    "imu.rate_hz": "--sim.imu.rate-hz",
    "inpaint=True": "--map.inpaint",
}


@dataclass
class ExitCode:
    """The process's exit code, known when the context ends."""

    value: int = OK


@contextmanager
def exit_code() -> Iterator[ExitCode]:
    """Turns what a user, the disk or the memory can cause into one line and a code.

    Anything else is a fault of the program and keeps its traceback.
    """
    code = ExitCode()
    # A polite kill ends like Ctrl-C, so that temporary folders are removed.
    signal.signal(signal.SIGTERM, _interrupt)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _send_again
    try:
        yield code
    except InputError as error:
        code.value = _tell(with_flags(str(error)), BAD_INPUT)
    except KeyboardInterrupt:
        words = "interrupted: no half-written output; the same command takes up finished parts"
        code.value = _tell(words, INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        code.value = _tell(f"{error}: free the disk or choose another output", BAD_INPUT)
    except MemoryError as error:
        words = f"{error}: not enough memory; lower the resolution, the planes or the window"
        code.value = _tell(words, BAD_INPUT)
    finally:
        sys.unraisablehook = sys.__unraisablehook__


def with_flags(words: str) -> str:
    """What a library says of its parameters, as the command line's flags."""
    for parameter, flag in _FLAGS.items():
        words = words.replace(parameter, flag)
    return words


def _send_again(lost: sys.UnraisableHookArgs) -> None:
    """Python drops an interrupt that arrives inside a destructor: it comes once more."""
    if isinstance(lost.exc_value, KeyboardInterrupt):
        _interrupt_soon()
    else:
        sys.__unraisablehook__(lost)


def _interrupt(_number: int, frame: FrameType | None) -> None:
    if _is_called_from_c(frame):
        _interrupt_soon()
    else:
        raise KeyboardInterrupt


def _is_called_from_c(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_globals.get("__name__") in _CALLED_FROM_C:
            return True
        frame = frame.f_back
    return False


def _interrupt_soon() -> None:
    later = threading.Timer(_SOON_S, os.kill, (os.getpid(), signal.SIGTERM))
    later.daemon = True
    later.start()


def _tell(words: str, code: int) -> int:
    sys.stderr.write(f"eventsweep: {' '.join(words.split())}\n")
    return code
