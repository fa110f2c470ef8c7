"""Work in a child process: what it makes and says comes back, and it takes no more than it may."""

import os
import signal
import time

import pytest

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.processes import bounded
from refusals import refused

MB = 1 << 20


def within(work, memory_bytes=200 * MB, cpu_s=5):
    bounded("the file", work, memory_bytes=memory_bytes, cpu_s=cpu_s)


def test_what_work_makes_is_in_its_file(tmp_path):
    within(lambda: (tmp_path / "made").write_text("x"))
    assert (tmp_path / "made").read_text() == "x"


def large():
    kept = []
    while True:
        kept.append(b"x" * MB)


def endless():
    while True:
        pass


def refusing():
    raise InputError("the map: is upside down")


def failing():
    raise MemoryError


@pytest.mark.parametrize(("work", "words"), [
    (refusing, "^the map: is upside down$"), (large, "the file: takes more than 200 MB of memory"),
    (endless, "the file: takes more than 1 s of computing"),
    (failing, "takes more than 200 MB of memory"),
    (lambda: os.kill(os.getpid(), signal.SIGSEGV), "its library ends the process, signal 11"),
    (lambda: os.close(9999), r"cannot be read \(OSError: .*\): correct it"),
])  # fmt: skip
def test_what_goes_wrong_becomes_one_line(work, words):
    began = time.monotonic()
    refused(words, within, work, 200 * MB, 1)
    assert time.monotonic() - began < 20


def test_memory_that_is_only_reserved_does_not_count():
    import mmap

    within(lambda: mmap.mmap(-1, 4096 * MB), 10 * MB)


def test_an_interrupt_ends_the_work(monkeypatch):
    children = []
    fork = os.fork

    def noted():
        children.append(fork())
        return children[-1]

    def interrupted(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fork", noted)
    monkeypatch.setattr("select.select", interrupted)
    with pytest.raises(KeyboardInterrupt):
        within(endless, cpu_s=60)
    with pytest.raises(ProcessLookupError):
        os.kill(children[0], 0)
