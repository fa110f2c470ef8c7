"""Compiled decoders and encoders of Prophesee's EVT2, EVT2.1, EVT3 words and DAT records.

Layouts after Prophesee's documentation of its data encoding formats. Each kernel reads `words`
until they end, the output is nearly full, or a word is of no known kind; it returns how many words
it used, how many events it wrote, and whether the next word is unknown. Counters that fall by half
their range or more have wrapped; a smaller fall is time that runs backwards, as the file says.

A counter that wraps is written through its half, its largest value and zero, once per loop, so
that a decoder sees each wrap even where no event lies between two of them; decoders that take a
step of more than half the range for a glitch see none.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

Columns = tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int64], NDArray[np.uint8]]
Result = tuple[int, int, bool]
MOST_PER_WORD = 32
"""A word of EVT2.1 holds up to 32 events, one of EVT3 up to 12."""
# Places in the state array, and what stands there at the start of a file.
LOOPS: Final = 0  # how often the counter of TIME_HIGH has wrapped
HIGH: Final = 1  # last TIME_HIGH
LOW: Final = 2  # last TIME_LOW (EVT3)
Y: Final = 3  # last row (EVT3)
BASE_X: Final = 4  # next column of a vector (EVT3)
POLARITY: Final = 5  # of a vector (EVT3)
TIMED: Final = 6  # whether a time has been seen at all
UNTIMED: Final = 7  # events before that; they have no time
SIZE: Final = 8
State = NDArray[np.int64]
Whole = int | np.integer[Any]


@njit(cache=True, nogil=True)
def _raise_high(state: State, high: Whole, bits: int) -> None:
    """Takes a new TIME_HIGH of so many bits."""
    if state[TIMED] and state[HIGH] - high >= 1 << (bits - 1):
        state[LOOPS] += 1
    state[HIGH] = high
    state[TIMED] = 1


@njit(cache=True, nogil=True)
def _high_us(state: State) -> Whole:
    """Time without its six low bits (EVT2, EVT2.1), µs."""
    high_us: Whole = (state[LOOPS] << 34) | (state[HIGH] << 6)
    return high_us


@njit(cache=True, nogil=True)
def _is_passed_over(kind: Whole) -> bool:
    """External triggers, and words that continue or end others."""
    return kind == 0xA or kind == 0xE or kind == 0xF


@njit(cache=True, inline="always")
def _put(
    columns: Columns, n: int, column: Whole, row: Whole, stamp: Whole, polarity: Whole
) -> None:
    """Writes event n."""
    x, y, t_us, p = columns
    x[n] = column
    y[n] = row
    t_us[n] = stamp
    p[n] = polarity


@njit(cache=True, nogil=True)
def decode_evt2(words: NDArray[np.uint32], state: State, columns: Columns) -> Result:
    """32-bit words: kind (4), then low time (6), x (11), y (11), or high time (28)."""
    n = 0
    room = len(columns[0])
    timed = state[TIMED] != 0
    high_us = _high_us(state)
    for k in range(len(words)):
        word = np.int64(words[k])
        kind = word >> 28
        if kind <= 1:
            if n == room:
                return k, n, False
            if timed:
                stamp = high_us | ((word >> 22) & 0x3F)
                _put(columns, n, (word >> 11) & 0x7FF, word & 0x7FF, stamp, kind)
                n += 1
            else:
                state[UNTIMED] += 1
        elif kind == 8:
            _raise_high(state, word & 0xFFFFFFF, 28)
            high_us = _high_us(state)
            timed = True
        elif not _is_passed_over(kind):
            return k, n, True
    return len(words), n, False


@njit(cache=True, nogil=True)
def decode_evt21(words: NDArray[np.uint64], state: State, columns: Columns) -> Result:
    """64-bit words: kind (4), low time (6), x (11), y (11), then a bit per column from x on."""
    n = 0
    room = len(columns[0])
    for k in range(len(words)):
        valid = np.int64(words[k] & np.uint64(0xFFFFFFFF))
        word = np.int64(words[k] >> np.uint64(32))
        kind = word >> 28
        if kind <= 1:
            if n + 32 > room:
                return k, n, False
            stamp = _high_us(state) | ((word >> 22) & 0x3F)
            first = (word >> 11) & 0x7FF
            for bit in range(32):
                if (valid >> bit) & 1:
                    if state[TIMED]:
                        _put(columns, n, first + bit, word & 0x7FF, stamp, kind)
                        n += 1
                    else:
                        state[UNTIMED] += 1
        elif kind == 8:
            _raise_high(state, word & 0xFFFFFFF, 28)
        elif not _is_passed_over(kind):
            return k, n, True
    return len(words), n, False


@njit(cache=True, nogil=True)
def decode_evt3(  # noqa: C901 - one branch per kind of word
    words: NDArray[np.uint16], state: State, columns: Columns
) -> Result:
    """16-bit words: kind (4) and a value (12); rows, times and vector bases hold until replaced."""
    n = 0
    room = len(columns[0])
    timed = state[TIMED] != 0
    row: Whole
    base_x: Whole
    polarity: Whole
    row, base_x, polarity = state[Y], state[BASE_X], state[POLARITY]
    stamp = (state[LOOPS] << 24) | (state[HIGH] << 12) | state[LOW]
    k = 0
    unknown = False
    while k < len(words):
        word = np.int64(words[k])
        kind = word >> 12
        if kind == 0x2:  # ADDR_X
            if n == room:
                break
            if timed:
                _put(columns, n, word & 0x7FF, row, stamp, (word >> 11) & 1)
                n += 1
            else:
                state[UNTIMED] += 1
        elif kind == 0x4 or kind == 0x5:  # VECT_12, VECT_8
            width = 12 if kind == 0x4 else 8
            if n + width > room:
                break
            valid = word & ((1 << width) - 1)
            if valid and base_x > 0x7FF:
                unknown = True  # a vector without its base, or running off every sensor
                break
            if not timed:
                for bit in range(width):
                    state[UNTIMED] += (valid >> bit) & 1
            else:
                for bit in range(width):
                    # Written always, kept only where the bit is set: no branch to mispredict.
                    _put(columns, n, base_x + bit, row, stamp, polarity)
                    n += (int(valid) >> bit) & 1
            base_x += width
        elif kind == 0x0:  # ADDR_Y
            row = word & 0x7FF
        elif kind == 0x3:  # VECT_BASE_X
            base_x = word & 0x7FF
            polarity = (word >> 11) & 1
        elif kind == 0x6:  # TIME_LOW
            state[LOW] = word & 0xFFF
            stamp = (state[LOOPS] << 24) | (state[HIGH] << 12) | state[LOW]
        elif kind == 0x8:  # TIME_HIGH
            if not timed or state[HIGH] != word & 0xFFF:
                state[LOW] = 0  # a new high part starts at its own beginning
            _raise_high(state, word & 0xFFF, 12)
            timed = True
            stamp = (state[LOOPS] << 24) | (state[HIGH] << 12) | state[LOW]
        elif not (kind == 0x7 or _is_passed_over(kind)):
            unknown = True
            break
        k += 1
    state[Y], state[BASE_X], state[POLARITY] = row, base_x, polarity
    return k, n, unknown


@njit(cache=True, nogil=True)
def decode_dat(words: NDArray[np.uint64], state: State, columns: Columns) -> Result:
    """64-bit records: time (32, low), x (14), y (14), polarity (4)."""
    n = 0
    for k in range(len(words)):
        if n == len(columns[0]):
            return k, n, False
        stamp = np.int64(words[k] & np.uint64(0xFFFFFFFF))
        word = np.int64(words[k] >> np.uint64(32))
        if word >> 29:
            return k, n, True  # a polarity that is neither 0 nor 1
        _raise_high(state, stamp, 32)
        stamp |= state[LOOPS] << 32
        _put(columns, n, word & 0x3FFF, (word >> 14) & 0x3FFF, stamp, word >> 28)
        n += 1
    return len(words), n, False


def encoder_state() -> State:
    """No time and no row written yet."""
    state = initial_state()
    state[LOW] = state[Y] = -1
    return state


@njit(cache=True, nogil=True)
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
def encode_evt2(columns: Columns, state: State, words: NDArray[np.uint32]) -> int:
    """Fills `words`, returns how many; needs room for 8 per event and 3 per loop of 2^34 µs."""
    x, y, t_us, p = columns
    n = 0
    for k in range(len(x)):
        high = t_us[k] >> 6
        if not state[TIMED] or high != ((state[LOOPS] << 28) | state[HIGH]):
            n = _encode_high(words, n, state, high, 0x80000000, 28)
        kind = np.int64(1) if p[k] else np.int64(0)
        words[n] = (kind << 28) | ((t_us[k] & 0x3F) << 22) | (np.int64(x[k]) << 11) | np.int64(y[k])
        n += 1
    return n


@njit(cache=True, nogil=True)
def _vector_mask(columns: Columns, first: int, base_x: Whole) -> tuple[Whole, int]:
    """Bits of the events from `first` on that fit 32 columns in one vector, and how many fit."""
    x, y, t_us, p = columns
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
def encode_evt3(columns: Columns, state: State, words: NDArray[np.uint16]) -> int:
    """Fills `words`, returns how many; needs room for 8 per event and 3 per loop of 2^24 µs.

    Five or more events of one time, row and polarity with rising columns become vectors, always
    12 + 12 + 8 columns as the cameras write them: some decoders take the three words at once.
    """
    x, y, t_us, p = columns
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
        mask, count = _vector_mask(columns, k, np.int64(x[k]))
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
            mask, count = _vector_mask(columns, k, base_x)
    return n


def initial_state() -> State:
    """Nothing read yet."""
    return np.zeros(SIZE, np.int64)
