"""From exceptions to exit codes: one line on the error stream, and nothing half-written."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.addresses import shown
from eventsweep.eval.cli.flag_names import with_flags

if TYPE_CHECKING:
    from eventsweep.emvs.maps.folder import MapInfo

OK, INCOMPLETE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

# Where an interrupt must not be raised, for it would pass through libraries that do not expect it,
# which lose it, crash, or make another error of it: functions that HDF5 calls from C, and imports.
_NOT_NOW = frozenset(
    {
        "eventsweep.emvs.data.hdf5",
        "_frozen_importlib",
        "_frozen_importlib_external",
        "importlib._bootstrap",
        "importlib._bootstrap_external",
    }
)
# What calls it may itself be running inside an import, which ends only when the command does.
_OUTERMOST = "eventsweep.eval.cli.main"
_SOON_S = 0.05
_INTERRUPTED = "interrupted: no half-written output; run the same command to resume"

_came: list[int] = []
"""Interrupts since the command began: if it ends otherwise, a library lost one."""


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
    _came.clear()
    try:
        yield code
        if _came and code.value != INTERRUPTED:
            code.value = _say("", OK)
    except (Exception, KeyboardInterrupt) as error:
        ending = _ending(error)
        if ending is None:
            raise
        code.value = ending
    finally:
        sys.unraisablehook = sys.__unraisablehook__
        for thread in threading.enumerate():
            if isinstance(thread, _Later):
                thread.cancel()


def _ending(error: BaseException) -> int | None:
    """Says in one line why a command ended; returns its code, None for a fault of the program."""
    if _came or isinstance(error, KeyboardInterrupt):  # half-imported libraries end in anything
        return _say(_INTERRUPTED, INTERRUPTED)
    if isinstance(error, InputError):
        return _say(with_flags(error), BAD_INPUT)
    if isinstance(error, OSError):
        return _say(_joined(error, "free the disk or choose another output"), BAD_INPUT)
    if isinstance(error, RuntimeError) and str(error).startswith("Symlink loop"):
        return _say(f"{error}: these links lead in a circle, correct the path", BAD_INPUT)
    if isinstance(error, MemoryError):
        cure = "not enough memory; lower the resolution, the planes or the window"
        return _say(_joined(error, cure), BAD_INPUT)
    return None


def _joined(error: Exception, cure: str) -> str:
    """What an error says, if it says anything, and the cure."""
    return ": ".join(filter(str.strip, (str(error), cure)))


def incomplete(maps: Iterable[MapInfo], *, allowed: bool) -> int:
    """The exit code of sliding windows, some of which could not be mapped; says so in one line."""
    maps = list(maps)
    skipped = [window for info in maps for window in info.skipped]
    if allowed or not skipped:
        return OK
    total = len(skipped) + sum(len(info.windows) for info in maps)
    first = f"{skipped[0].name}: {skipped[0].reason}"
    words = (
        f"{len(skipped)} of {total} windows could not be mapped ({first}); the others are "
        "complete; if that is expected, add --allow-skipped"
    )
    return _say(with_flags(words), INCOMPLETE)


def _send_again(lost: sys.UnraisableHookArgs) -> None:
    """Python drops an interrupt that arrives inside a destructor: it comes once more."""
    if isinstance(lost.exc_value, KeyboardInterrupt):
        _interrupt_soon()
    else:
        sys.__unraisablehook__(lost)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _came.append(number)
    if _must_wait(frame):
        _interrupt_soon()
    else:
        raise KeyboardInterrupt


def _must_wait(frame: FrameType | None) -> bool:
    while frame is not None and (name := frame.f_globals.get("__name__")) != _OUTERMOST:
        if name in _NOT_NOW:
            return True
        frame = frame.f_back
    return False


class _Later(threading.Timer):
    """Sends the interrupt once more, unless the command has ended by then."""

    def __init__(self) -> None:
        super().__init__(_SOON_S, os.kill, (os.getpid(), signal.SIGTERM))
        self.daemon = True


def _interrupt_soon() -> None:
    _Later().start()


def _say(words: str, code: int) -> int:
    """Says why a command ends; an interrupt that a library made another error of is one still."""
    if _came:
        words, code = _INTERRUPTED, INTERRUPTED
    sys.stderr.write(f"eventsweep: {' '.join(shown(words).split())}\n")
    return code
