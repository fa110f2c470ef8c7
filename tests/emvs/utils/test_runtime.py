"""Work that is shared out among threads is all done, once, whatever their number."""

import os

import numba
import numpy as np
import pytest

from eventsweep.emvs.utils import runtime


def count(start, stop, parts, out):
    parts.append((start, stop))
    out[start:stop] += 1


@pytest.mark.parametrize("pieces", [0, 1, 2, 7, 64])
@pytest.mark.parametrize("threads", [1, 2])
def test_every_piece_is_done_once(threads, pieces):
    runtime.use_threads(threads)
    parts, out = [], np.zeros(pieces, int)
    try:
        runtime.in_threads(count, pieces, parts, out)
        assert len(parts) == max(1, min(pieces, numba.get_num_threads()))
    finally:
        runtime.use_threads(0)
    assert (out == 1).all()


@pytest.mark.parametrize("failing", [0, 1])
def test_what_a_thread_raises_is_raised(failing):
    def fail(start, _stop):
        if min(start, 1) == failing:
            raise ZeroDivisionError

    if numba.get_num_threads() > failing:
        with pytest.raises(ZeroDivisionError):
            runtime.in_threads(fail, 2)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own():
    out = np.zeros(2, int)
    runtime.in_threads(count, 2, [], out)
    child = os.fork()
    if child == 0:
        try:
            runtime.in_threads(count, 2, [], out)
            os._exit(0 if (out == 2).all() else 1)
        finally:
            os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
