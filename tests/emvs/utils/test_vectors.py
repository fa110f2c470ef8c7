"""The processor's vectors against numpy, and their width against another one's results."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from eventsweep.emvs.utils.vectors_kernels import WIDTH, aligned, larger, load, plus, splat, store
from programs import NARROW, assert_same_bits

SAME = """
import numpy as np
from eventsweep.emvs.dsi.maxima import FocusPeak
from eventsweep.emvs.utils.vectors_kernels import WIDTH
rng = np.random.default_rng(0)
peak = FocusPeak(70, 37, "variance", 2.5)
peak.update(rng.gamma(0.5, 2, (3, 37, 70)).astype(np.float32))
print(WIDTH, peak.maximum().value.tobytes().hex())
"""


@njit
def every_word(a, b, number, out):
    one, other = load(a, 1), load(b, 0)
    results = (
        one + other, one - other, one * other, one / other, plus(one, one, other),
        larger(one, other), splat(number),
    )  # fmt: skip
    for k in range(len(results)):
        store(out, k * WIDTH, results[k])


numbers = st.floats(-100, 100, width=32)


@settings(max_examples=30)
@given(st.lists(numbers, min_size=WIDTH, max_size=WIDTH), numbers, st.integers(0, 2**32 - 1))
def test_each_word_does_what_numpy_does(values, number, seed):
    a = np.asarray([7, *values], np.float32)
    b = np.random.default_rng(seed).uniform(0.5, 2, WIDTH).astype(np.float32)
    out = np.empty(7 * WIDTH, np.float32)
    every_word(a, b, np.float32(number), out)
    x, exact = a[1:], a[1:].astype(np.float64)
    once = (exact + exact * b).astype(np.float32)
    expected = (x + b, x - b, x * b, x / b, once, np.maximum(x, b), np.full(WIDTH, number))
    for found, wanted in zip(out.reshape(7, WIDTH), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=0)


@pytest.mark.parametrize("count", [1, WIDTH, 1000])
def test_room_begins_at_a_vectors_border(count):
    for _ in range(5):
        room = aligned(count)
        assert room.ctypes.data % (4 * WIDTH) == 0
        assert room.shape == (count,)
        assert room.dtype == np.float32
        assert not room.any()


@pytest.mark.slow
@pytest.mark.parametrize("told", NARROW)
def test_a_processor_with_shorter_vectors_finds_the_same_bits(told, tmp_path):
    assert_same_bits(SAME, told, tmp_path)
