"""A stage whose jobs behave as they are told; workers import it by name."""

import os
import resource
import signal
import time
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.jobs.job import RESULT


def run(parameters, inputs, out: Path, runtime) -> None:
    """Counts that it ran, misbehaves as asked, then joins what its inputs said."""
    log = Path(parameters["log"])
    log.mkdir(parents=True, exist_ok=True)
    (log / f"{parameters['id']}.{time.time_ns()}.{os.getpid()}").touch()
    _ACTS[parameters.get("act", "write")](parameters, log)
    words = [(path / RESULT).read_text() for path in inputs]
    (out / RESULT).write_text("+".join([*words, str(parameters["id"])]))


def runs(log: Path, name: str) -> int:
    return len(list(log.glob(f"{name}.*"))) if log.is_dir() else 0


def _die(parameters, log):
    os.kill(os.getpid(), signal.SIGKILL)


def _die_once(parameters, log):
    if runs(log, parameters["id"]) == 1:
        _die(parameters, log)


def _fail(parameters, log):
    raise ZeroDivisionError("as asked")


def _fail_once(parameters, log):
    if runs(log, parameters["id"]) == 1:
        _fail(parameters, log)


def _refuse(parameters, log):
    raise InputError("3 came, needs 4: add one")


def _sleep(parameters, log):
    time.sleep(parameters["seconds"])


def _full_disk(parameters, log):
    with Path("/dev/full").open("w") as file:
        file.write("x")


def _threads(parameters, log):
    """Runs a kernel that was compiled before, then compiles one, for which numba looks again."""
    import numba
    import numpy as np

    numba.set_num_threads(1)
    assert numba.config.NUMBA_NUM_THREADS == 1
    assert numba.njit(lambda values: values.sum())(np.arange(4)) == 6


def _small_files(parameters, log):
    """Lets no file of this process grow beyond 1 kB, as a quota would."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
    try:
        (log / "large").write_bytes(bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)


_ACTS = {
    "write": lambda parameters, log: None, "die": _die, "die once": _die_once, "fail": _fail,
    "fail once": _fail_once, "refuse": _refuse, "sleep": _sleep, "full disk": _full_disk,
    "small files": _small_files, "threads": _threads,
}  # fmt: skip
