"""Python in a process of its own, commands of the program, and processors that can do less."""

import os
import subprocess
import sys

import pytest

from eventsweep.eval.cli.main import app
from places import ROOT


def python(*arguments, path=(), env=None, **more) -> "subprocess.CompletedProcess[str]":
    """Runs this Python to its end with our packages in its path, those of `path` before them."""
    search = os.pathsep.join(str(folder) for folder in (*path, ROOT))
    env = os.environ | {"PYTHONPATH": search} | (env or {})
    settings = {"capture_output": True, "text": True, "check": False, "timeout": 300, **more}
    return subprocess.run([sys.executable, *map(str, arguments)], env=env, **settings)


def command(name):
    """The program of a command, named by one word or two."""
    program = app
    for word in name.split():
        program = program[word]
    return program


def _expanded(verb):
    if app[verb].default_command is not None:
        return [verb]
    return [f"{verb} {name}" for name in app[verb] if not name.startswith("-")]


COMMANDS = tuple(name for verb in app if not verb.startswith("-") for name in _expanded(verb))


NARROW = {
    "256 bits": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+bmi,+bmi2"},
    "nothing special": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
}


def assert_same_bits(script, processor, folder, path=()):
    """A script that prints the width of vectors, and results, prints the same results.

    Modules that it imports by name lie in `path`.
    """
    printed = [_run(script, environment, folder, path) for environment in ({}, NARROW[processor])]
    if printed[0][0] == printed[1][0] or "+fma" not in _features():
        pytest.skip("this processor has no longer vectors")
    assert printed[1][0] == "8"
    assert printed[0][1:] == printed[1][1:]


def _features():
    from llvmlite.binding import get_host_cpu_features

    return get_host_cpu_features().flatten()


def _run(script, environment, folder, path):
    known = {"NUMBA_CACHE_DIR": str(folder), **environment}
    return python("-c", script, path=path, env=known, check=True).stdout.split()
