"""What surrounds a command: variables, closed and broken streams, a script without a guard."""

import os
import subprocess
import sys

import numba
import pytest

from eventsweep.emvs.utils import processes
from eventsweep.emvs.utils.cache import Cache
from eventsweep.emvs.utils.runtime import check_numba
from eventsweep.eval.cli.main import main
from programs import python
from refusals import command_refused, refused


@pytest.mark.parametrize("threads", ["0", "-3", "abc", "1.5"])
def test_threads_that_numba_cannot_have_are_one_line(monkeypatch, capsys, threads):
    """Numba ends with a traceback that does not name the variable."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    line = command_refused(capsys, "list", "scenes")
    assert f"NUMBA_NUM_THREADS is {threads}: needs a whole number of at least 1" in line


def test_kernels_that_would_not_be_compiled_are_refused(monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    refused("NUMBA_DISABLE_JIT is set.*unset it", check_numba)


def test_a_threading_layer_that_numba_does_not_know_is_refused(monkeypatch):
    monkeypatch.setenv("NUMBA_THREADING_LAYER", "tbb omp")
    check_numba()
    monkeypatch.setenv("NUMBA_THREADING_LAYER", "nonsense")
    refused("NUMBA_THREADING_LAYER is 'nonsense': needs one of", check_numba)


def test_whoever_asks_for_a_kernel_is_told_that_it_is_not_compiled(tmp_path):
    done = python("-m", "eventsweep", "list", "scenes", env={"NUMBA_DISABLE_JIT": "1"})
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "NUMBA_DISABLE_JIT" in done.stderr


def test_a_cache_in_the_place_of_a_file_is_refused_before_any_job(tmp_path):
    (tmp_path / "cache").write_text("mine")
    refused("cache is a file", Cache, tmp_path / "cache")


@pytest.fixture
def events(tmp_path):
    """A command that reads and writes, in a folder whose name is not in ASCII."""
    folder = tmp_path / "ünï"
    folder.mkdir()
    (folder / "ev.csv").write_text("t_us,x,y,p\n1,2,3,1\n5,2,3,0\n")
    return (
        "-m",
        "eventsweep",
        "convert",
        folder / "ev.csv",
        folder / "ev.npz",
        "--to",
        "npz",
        "--width-px",
        "9",
        "--height-px",
        "9",
    )


@pytest.mark.parametrize("broken", ["out", "both", "closed", "C", "ascii"])
def test_streams_that_cannot_be_written_to_end_no_command(events, broken):
    """`| head` ends the reading, not the work; where letters are not known they are escaped."""
    read, write = os.pipe()
    os.close(read)
    streams = {
        "out": {"stdout": write}, "both": {"stdout": write, "stderr": write},
        "closed": {"preexec_fn": lambda: [os.close(1), os.close(2)]},
    }  # fmt: skip
    language = {"C": {"LC_ALL": "C", "PYTHONUTF8": "0"}, "ascii": {"PYTHONIOENCODING": "ascii"}}
    with os.fdopen(write, "w"):
        done = subprocess.run(
            [sys.executable, *map(str, events)], check=False, **streams.get(broken, {}),
            env={**os.environ, **language.get(broken, {})},
        )  # fmt: skip
    assert done.returncode == 0
    assert events[4].is_file()


def test_a_full_standard_output_is_one_line(events):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = python(*events, stdout=full, stderr=subprocess.PIPE, capture_output=False)
    assert done.returncode == 2
    assert "stdout>: cannot be written (No space left on device)" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_streams_are_given_back(capsys):
    before = sys.stdout, sys.stderr
    assert main(["--version"]) == 0
    assert (sys.stdout, sys.stderr) == before


CALL = 'import {0}\n{1}{2}{0}.check_guard()\n{2}print("went on")\n'
GUARDS = {"": 1, 'if __name__ == "__main__":\n': 0}


@pytest.mark.parametrize("guard", GUARDS)
def test_a_script_that_every_worker_would_run_again_is_told_so(tmp_path, guard):
    script = tmp_path / "script.py"
    indent = "    " * bool(guard)
    script.write_text(CALL.format(processes.__name__, guard, indent))
    done = python(script)
    assert done.returncode == GUARDS[guard]
    assert ("went on" in done.stdout) == bool(guard)
    last = f"{script}: each worker would run this script again: put its calls below if __name__"
    assert (last in done.stderr) == (not guard)
    done = python("-c", CALL.format(processes.__name__, "", ""))  # workers import nothing of it
    assert "went on" in done.stdout, done.stderr
