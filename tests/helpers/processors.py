"""A machine that is told that its processor can do less."""

import pytest

from programs import python

NARROW = {
    "256 bits": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+bmi,+bmi2"},
    "nothing special": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
}


def assert_same_bits(script, told, folder, path=()):
    """A script that prints the width of vectors, and results, prints the same results.

    Modules that it imports by name lie in `path`.
    """
    found = [_run(script, environment, folder, path) for environment in ({}, NARROW[told])]
    if found[0][0] == found[1][0] or "+fma" not in _features():
        pytest.skip("this processor has no longer vectors")
    assert found[1][0] == "8"
    assert found[0][1:] == found[1][1:]


def _features():
    from llvmlite.binding import get_host_cpu_features

    return get_host_cpu_features().flatten()


def _run(script, environment, folder, path):
    known = {"NUMBA_CACHE_DIR": str(folder), **environment}
    return python("-c", script, path=path, env=known, check=True).stdout.split()
