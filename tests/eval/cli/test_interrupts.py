"""An interrupt ends a command with 130 and one line, whatever library is being loaded or called."""

import sys
from contextlib import nullcontext
from itertools import pairwise

import pytest

from cost_stream import MovingEdges
from eventsweep.emvs.errors import InputError, heed_interrupt
from eventsweep.eval.cli import exit_codes
from eventsweep.eval.cli.main import main
from programs import python

# Sends an interrupt to itself so many seconds after the import of a library begins.
AIMED = """
import os, signal, sys, threading
library, seconds, *arguments = sys.argv[1:]

class Aim:
    def find_spec(self, name, path=None, target=None):
        if name == library:
            sys.meta_path.remove(self)
            print("aimed", flush=True)
            threading.Timer(float(seconds), os.kill, (os.getpid(), signal.SIGINT)).start()

sys.meta_path.insert(0, Aim())
signal.signal(signal.SIGINT, signal.default_int_handler)
from eventsweep.eval.cli.main import main
sys.exit(main(arguments))
"""
TIMED = """
import sys, time
import numpy
began = time.perf_counter()
__import__(sys.argv[1])
print(time.perf_counter() - began)
"""


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "edges"
    MovingEdges((64, 48), 20_000, windows=5).write(folder)
    return folder


def mapping(sequence, out):
    windows = ("--map.window-s", "0.1", "--map.stride-s", "0.005", "--map.planes", "100")
    return ("map", sequence, "--out", out, "--method", "Alg1/H", *windows, "--no-check", "--quiet")


def meshing(sequence, _out):
    """Of many windows: it goes on for seconds after the import."""
    maps = sequence.parent / "maps"
    if not maps.exists():
        windows = ("--map.window-s", "0.1", "--map.stride-s", "0.1", "--map.planes", "20")
        asked = ("map", str(sequence), "--out", str(maps), "--method", "Alg1/H", *windows)
        assert main([*asked, "--quiet"]) == 0
    return ("fuse", maps, "--mesh", "--mesh-part", "1", "--quiet")


def simulating(_sequence, out):
    return ("simulate", "planes", "--out", out, "--seconds", "1", "--quiet")


def scheduling(_sequence, out):
    """Nobody listens there: the command waits for an answer."""
    return ("suite", "quick", "--out", out, "--scheduler", "tcp://127.0.0.1:9", "--quiet")


LOADED = {
    "open3d": meshing, **dict.fromkeys(("h5py", "hdf5plugin", "numba", "scipy", "cv2"), mapping),
    "mujoco": simulating, "distributed": scheduling,
}  # fmt: skip


def interrupted(sequence, tmp_path, library, aims):
    """Aims interrupts at the import of a library, evenly over the time that it takes."""
    lasts_s = float(python("-c", TIMED, library).stdout)
    for k in range(aims):
        words = LOADED[library](sequence, tmp_path / f"{library}-{k}")
        done = python("-c", AIMED, library, lasts_s * k / aims, *words)
        assert done.stdout == "aimed\n"
        assert (k, done.returncode) == (k, 130), done.stderr
        assert done.stderr.startswith("eventsweep: interrupted"), (k, done.stderr)
        assert done.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("library", LOADED)
def test_interrupts_aimed_at_the_import_of_a_library_are_heeded(sequence, tmp_path, library):
    interrupted(sequence, tmp_path, library, 24 if library == "open3d" else 4)


@pytest.mark.parametrize(
    "ending",
    ["return", "raise InputError('no open3d')", "raise OSError(5)", "raise AttributeError('half')"],
)
def test_an_interrupt_that_a_library_lost_is_no_success(ending, capsys):
    """A library swallowed it, or made another error of it: the command ends as interrupted."""

    def command():
        with exit_codes.exit_code() as code:
            try:
                exit_codes._interrupt(2, None)
            except KeyboardInterrupt:
                exec(ending.replace("return", "pass"), {"InputError": InputError})
        return code.value

    assert command() == 130
    assert capsys.readouterr().err.startswith("eventsweep: interrupted")
    with exit_codes.exit_code() as code:
        pass
    assert code.value == 0  # the next command was not interrupted


def chained(*links):
    """The last error, each made from the one before; of two, the first only in its context."""
    for before, after in pairwise(links):
        after.__context__, after.__suppress_context__ = before, True
        after.__cause__ = before if len(links) > 2 else None
    return links[-1]


@pytest.mark.parametrize(("links", "heeded"), [
    ((KeyboardInterrupt(), ImportError("initialisation failed")), True),
    ((KeyboardInterrupt(), OSError(), ImportError()), True),
    ((ValueError(), ImportError()), False), ((ImportError("no such module"),), False),
])  # fmt: skip
def test_an_error_made_of_an_interrupt_is_told_from_others(links, heeded):
    with pytest.raises(KeyboardInterrupt) if heeded else nullcontext():
        heed_interrupt(chained(*links))


def test_users_of_the_library_get_the_interrupt(monkeypatch):
    """Not an error that says to install open3d."""
    from eventsweep.emvs.depth.tsdf import load_open3d

    class Lost:
        def find_spec(self, name, path=None, target=None):
            if name == "open3d":
                try:
                    raise KeyboardInterrupt
                except KeyboardInterrupt as error:
                    raise ImportError("initialisation failed") from error

    monkeypatch.setattr(sys, "meta_path", [Lost(), *sys.meta_path])
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    with pytest.raises(KeyboardInterrupt):
        load_open3d()
