"""Compiled encoders of EVT2 and EVT3; `state` is what a decoder would know at this point.

A counter that wraps is written through its half, its largest value and zero, once per loop, so
that a decoder sees each wrap even where no event lies between two of them; decoders that take a
step of more than half the range for a glitch see none.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from emvs.io.events.evt_state import HIGH, LOOPS, LOW, TIMED, State, Whole, Y, initial_state

Column = NDArray[np.uint16]


def encoder_state() -> State:
    """No time and no row written yet."""
    state = initial_state()
    state[LOW] = state[Y] = -1
    return state


@njit(cache=True)
def _encode_high(
    words: NDArray[np.uint32] | NDArray[np.uint16],
    n: int,
    state: State,
    high: Whole,
    kind: int,
    bits: int,
) -> int:
    """Writes TIME_HIGH words up to the (unwrapped) value `high`; returns the new count."""
    top = (1 << bits) - 1
    if not state[TIMED]:
        words[n] = kind
        n += 1
        state[TIMED] = 1
    half = 1 << (bits - 1)
    while state[LOOPS] < high >> bits:
        if state[HIGH] < half:
            words[n] = kind | half
            n += 1
        if state[HIGH] != top:
            words[n] = kind | top
            n += 1
        words[n] = kind
        n += 1
        state[LOOPS] += 1
        state[HIGH] = 0
    if high & top != state[HIGH]:
        if (high & top) - state[HIGH] > half:
            words[n] = kind | half
            n += 1
        words[n] = kind | (high & top)
        n += 1
        state[HIGH] = high & top
    return n


@njit(cache=True, nogil=True)
def encode_evt2(
    x: Column,
    y: Column,
    t_us: NDArray[np.int64],
    p: NDArray[np.uint8],
    state: State,
    words: NDArray[np.uint32],
) -> int:
    """Fills `words`, returns how many; needs room for 8 per event and 3 per loop of 2^34 µs."""
    n = 0
    for k in range(len(x)):
        high = t_us[k] >> 6
        if not state[TIMED] or high != ((state[LOOPS] << 28) | state[HIGH]):
            n = _encode_high(words, n, state, high, 0x80000000, 28)
        kind = np.int64(1) if p[k] else np.int64(0)
        words[n] = (kind << 28) | ((t_us[k] & 0x3F) << 22) | (np.int64(x[k]) << 11) | np.int64(y[k])
        n += 1
    return n


@njit(cache=True)
def _vector_mask(
    x: Column, y: Column, t_us: NDArray[np.int64], p: NDArray[np.uint8], first: int, base_x: Whole
) -> tuple[Whole, int]:
    """Bits of the events from `first` on that fit 32 columns in one vector, and how many fit."""
    mask, k = np.int64(0), first
    before: Whole = base_x - 1
    while (
        k < len(x)
        and before < x[k] < base_x + 32
        and y[k] == y[first]
        and t_us[k] == t_us[first]
        and (p[k] != 0) == (p[first] != 0)
    ):
        before = np.int64(x[k])
        mask |= np.int64(1) << (before - base_x)
        k += 1
    return mask, k - first


@njit(cache=True, nogil=True)
def encode_evt3(
    x: Column,
    y: Column,
    t_us: NDArray[np.int64],
    p: NDArray[np.uint8],
    state: State,
    words: NDArray[np.uint16],
) -> int:
    """Fills `words`, returns how many; needs room for 8 per event and 3 per loop of 2^24 µs.

    Five or more events of one time, row and polarity with rising columns become vectors, always
    12 + 12 + 8 columns as the cameras write them: some decoders take the three words at once.
    """
    n = 0
    k = 0
    while k < len(x):
        high = t_us[k] >> 12
        low = t_us[k] & 0xFFF
        if not state[TIMED] or high != ((state[LOOPS] << 12) | state[HIGH]):
            n = _encode_high(words, n, state, high, 0x8000, 12)
            state[LOW] = -1
        if low != state[LOW]:
            words[n] = 0x6000 | low
            state[LOW] = low
            n += 1
        if y[k] != state[Y]:
            words[n] = y[k]
            state[Y] = y[k]
            n += 1
        sign = np.int64(0x800) if p[k] else np.int64(0)
        mask, count = _vector_mask(x, y, t_us, p, k, np.int64(x[k]))
        if count < 5:
            words[n] = 0x2000 | sign | np.int64(x[k])
            n += 1
            k += 1
            continue
        base_x = np.int64(x[k])
        row, stamp, positive = y[k], t_us[k], p[k] != 0
        words[n] = 0x3000 | sign | base_x
        n += 1
        while count >= 4:
            words[n] = 0x4000 | (mask & 0xFFF)
            words[n + 1] = 0x4000 | ((mask >> 12) & 0xFFF)
            words[n + 2] = 0x5000 | (mask >> 24)
            n += 3
            k += count
            base_x += 32
            if k == len(x) or y[k] != row or t_us[k] != stamp or (p[k] != 0) != positive:
                break
            mask, count = _vector_mask(x, y, t_us, p, k, base_x)
    return n
