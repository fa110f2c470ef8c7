"""Other processes: workers that end with their parent, and work that must stay within bounds."""

from __future__ import annotations

import ctypes
import faulthandler
import multiprocessing
import os
import re
import resource
import select
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from eventsweep.emvs.errors import InputError, printable

_PR_SET_PDEATHSIG = 1
_REFUSED, _FAULT, _OUT_OF_MEMORY = 3, 4, 5
_MOST_WORDS = 4096  # what a pipe holds at once
_LOOKS_S = 0.02  # between looks at a child's memory
# Whoever asks one of these knows that a worker imports the script.
_GUARD = re.compile(rb"__name__|current_process|parent_process")


def check_guard(otherwise: str = "") -> None:
    """Refuses workers for a script that would run again in each of them.

    A worker is a new Python, which imports the program's main file first. `otherwise` is what else
    would do, where anything would: jobs have a worker even if it is the only one.

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
                f'if __name__ == "__main__":{otherwise}'
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


def bounded(what: str, work: Callable[[], object], *, memory_bytes: int, cpu_s: int) -> None:
    """Does work in a child process that may take so much memory and time.

    For libraries that take as much as a file tells them to, or crash. What the work makes it must
    leave in a file; it may use no thread that runs already. Without Linux it is done here.

    Args:
        what: the work's object, with which errors begin.
        work: is called without arguments.
        memory_bytes: more than this it may not fill, beyond what it begins with. Memory that is
            only reserved, as for a model's arena or a thread's stack, does not count.
        cpu_s: after so much computing it is ended, s.

    Raises:
        InputError: that of the work itself, or it takes more, or it ends the process.
    """
    if sys.platform != "linux":
        work()
        return
    mine, its = os.pipe()
    with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
        child = os.fork()  # of a process with threads, which are left alone
    if child == 0:
        _in_child(work, its, cpu_s)
    os.close(its)
    try:
        words, is_large = _waited_for(child, mine, memory_bytes)
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        os.close(mine)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if is_large or code == _OUT_OF_MEMORY:
        raise InputError(
            f"{what}: takes more than {memory_bytes >> 20} MB of memory: make it smaller"
        )
    if code == -signal.SIGXCPU:
        raise InputError(f"{what}: takes more than {cpu_s} s of computing: make it smaller")
    if code:
        said = words or f"its library ends the process, signal {-code}"
        raise InputError(
            words if code == _REFUSED else f"{what}: cannot be read ({said}): correct it"
        )


def _in_child(work: Callable[[], object], answer: int, cpu_s: int) -> None:
    code, words = _FAULT, ""
    try:
        faulthandler.disable()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the parent reports a crash
        for kind, most in ((resource.RLIMIT_CPU, cpu_s), (resource.RLIMIT_CORE, 0)):
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (most if hard < 0 else min(most, hard), hard))
        work()
        code = 0
    except MemoryError:
        code = _OUT_OF_MEMORY
    except InputError as error:
        code, words = _REFUSED, str(error)
    except BaseException as error:
        words = printable(f"{type(error).__name__}: {error}")
    finally:
        os.write(answer, words.encode(errors="replace")[:_MOST_WORDS])
        os._exit(code)


def _waited_for(child: int, answer: int, memory_bytes: int) -> tuple[str, bool]:
    """What a child said before it ended, and whether it was ended for its memory."""
    words, first = b"", _resident_bytes(child)
    while True:
        if select.select([answer], [], [], _LOOKS_S)[0]:
            part = os.read(answer, _MOST_WORDS)
            words += part
            if not part:
                return words.decode(errors="replace"), False
        elif _resident_bytes(child) - first > memory_bytes:
            os.kill(child, signal.SIGKILL)
            return "", True


def _resident_bytes(process: int) -> int:
    with suppress(OSError, IndexError, ValueError):
        pages = Path(f"/proc/{process}/statm").read_text("ascii").split()[1]
        return int(pages) * os.sysconf("SC_PAGESIZE")
    return 0
