"""What only kernels call stops at intermediate code, and all computes the same."""

import gc
from contextlib import nullcontext

import numba
import numpy as np
import pytest
from numba.core import dispatcher

import eventsweep.emvs.utils.runtime  # noqa: F401  (replaces how numba compiles)
from eventsweep.emvs.utils import kernel_compiler
from eventsweep.emvs.utils.kernel_cache import kernel_files
from places import ROOT


def kernel(function, module="eventsweep.emvs.made_up", **options):
    function.__module__ = module
    return numba.njit(**options)(function)


def entry_of(compiled):
    return next(iter(compiled.overloads.values())).entry_point


def entries(module):
    """A kernel over two functions of the same types, and those."""
    plus = kernel(lambda a, b: a + b, module)
    minus = kernel(lambda a, b: a - b, module)

    def both(a, b):
        return 10 * plus(a, b) + minus(a, b)

    return kernel(both, module), plus, minus


def test_what_kernels_call_has_no_code_of_its_own_until_python_calls_it():
    both, plus, minus = entries("eventsweep.emvs.made_up")
    assert both(5.0, 2.0) == 73.0
    assert isinstance(entry_of(plus), kernel_compiler._Inner)
    assert entry_of(plus) is not entry_of(minus)
    assert (plus(5.0, 2.0), minus(5.0, 2.0)) == (7.0, 3.0)
    assert callable(entry_of(plus))
    assert both(1.0, 1.0) == 20.0
    assert gc.isenabled()


def test_functions_of_others_are_compiled_as_numba_does():
    both, plus, _ = entries("somebody.made_up")
    assert both(5.0, 2.0) == 73.0
    assert callable(entry_of(plus))


def test_where_operations_may_be_reordered_numba_compiles_as_it_does():
    files = [file.resolve().relative_to(ROOT.resolve()) for file in kernel_files()]
    named = {
        f"eventsweep.{file.with_suffix('').as_posix().replace('/', '.')}"
        for file in files
        if file.parts[0] == "emvs" and "cuda" not in file.parts
        if "fastmath" in (ROOT / file).read_text(encoding="utf-8")
    }
    assert named == set(kernel_compiler.LOOSE)
    both, plus, _ = entries(kernel_compiler.LOOSE[0])
    assert both(5.0, 2.0) == 73.0
    assert callable(entry_of(plus))


def test_a_failed_compilation_leaves_nothing_behind():
    def wrong(a):
        return a.nothing_of_the_kind

    with pytest.raises(numba.TypingError):
        kernel(wrong)(1.0)
    assert kernel_compiler._nesting.depth == 0
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError):
        kernel(lambda a: 1 // a)(0)


def test_an_unknown_numba_is_left_alone(monkeypatch):
    before = dispatcher.Dispatcher.compile
    monkeypatch.setattr(numba, "__version__", "9.9.9")
    kernel_compiler.compile_once(nullcontext)
    assert dispatcher.Dispatcher.compile is before


def test_the_numba_that_is_installed_is_known():
    assert numba.__version__.rpartition(".")[0] in kernel_compiler.TESTED


@pytest.mark.slow
def test_a_loop_in_parallel_within_a_kernel_is_machine_code():
    def doubled(values, out):
        for k in numba.prange(len(values)):
            out[k] = 2 * values[k]

    double = kernel(doubled, parallel=True)

    def outer(values):
        out = np.empty_like(values)
        double(values, out)
        return out.sum()

    assert kernel(outer)(np.arange(100.0)) == 9900.0
    assert callable(entry_of(double))
