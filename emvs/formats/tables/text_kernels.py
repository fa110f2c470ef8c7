"""Compiled text: numbers to columns and back, in exact integer arithmetic."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.formats.prophesee_kernels import Columns, Whole

Bytes = NDArray[np.uint8]

_MOST = 1 << 62


@njit(cache=True, nogil=True)
def _is_gap(c: int) -> bool:
    """Blank, tab, comma, semicolon, carriage return."""
    return c == 32 or c == 9 or c == 44 or c == 59 or c == 13


@njit(cache=True, nogil=True)
def _number(  # noqa: C901 - one pass over the digits
    text: Bytes, k: int, stop: int
) -> tuple[Whole, Whole, bool, int]:
    """Reads a decimal number: mantissa, power of ten, sign, place behind it (-1: no number)."""
    negative = text[k] == 45
    if negative or text[k] == 43:
        k += 1
    mantissa: Whole
    power: Whole
    digits: Whole
    exponent: Whole
    mantissa, power, digits, seen, point = np.int64(0), 0, 0, 0, False
    while k < stop:
        c = np.int64(text[k])
        if 48 <= c <= 57:
            seen += 1
            if digits < 18:
                mantissa = 10 * mantissa + (c - 48)
                digits += mantissa > 0
                power -= point
            else:
                power += not point
        elif c == 46 and not point:
            point = True
        else:
            break
        k += 1
    if not seen:
        return 0, 0, False, -1
    if k < stop and (text[k] == 101 or text[k] == 69):
        k += 1
        down = k < stop and text[k] == 45
        if k < stop and (text[k] == 45 or text[k] == 43):
            k += 1
        exponent, first = 0, k
        while k < stop and 48 <= text[k] <= 57 and exponent < 1000:
            exponent = 10 * exponent + (np.int64(text[k]) - 48)
            k += 1
        if k == first:
            return 0, 0, False, -1
        power += -exponent if down else exponent
    if k < stop and text[k] != 10 and not _is_gap(text[k]):
        return 0, 0, False, -1
    return mantissa, power, negative, k


@njit(cache=True, nogil=True)
def _scaled(mantissa: Whole, power: Whole) -> tuple[Whole, bool]:
    """`mantissa * 10**power`, rounded to the nearest whole number, and whether it was whole."""
    while power > 0 and mantissa < _MOST // 10 and mantissa > 0:
        mantissa *= 10
        power -= 1
    if power > 0 and mantissa > 0:
        return _MOST + 1, True
    rest = False
    while power < -1 and mantissa > 0:
        rest |= mantissa % 10 != 0
        mantissa //= 10
        power += 1
    if power < 0:
        last = mantissa % 10
        rest |= last != 0
        mantissa = mantissa // 10 + (last >= 5)
    return mantissa, not rest


@njit(cache=True, nogil=True)
def _truth(text: Bytes, k: int, stop: int) -> tuple[Whole, int]:
    """1 for `true`, 0 for `false`, in any case, and the place behind it (-1: neither)."""
    value = np.int64((text[k] | 32) == 116)
    word = b"true" if value else b"false"
    end = k + len(word)
    if end > stop or (end < stop and text[end] != 10 and not _is_gap(text[end])):
        return value, -1
    for j in range(len(word)):
        if text[k + j] | 32 != word[j]:
            return value, -1
    return value, end


@njit(cache=True, nogil=True)
def parse_rows(  # noqa: C901 - one pass over the bytes
    text: Bytes,
    order: NDArray[np.int64],
    power: int,
    whole_times: bool,
    columns: Columns,
) -> tuple[int, int]:
    """Reads whole lines of numbers; returns the rows, and where a bad line begins (-1: none).

    `order[f]` says what field f is: 0 time, 1 x, 2 y, 3 polarity, 4 ns that are added to the time,
    -1 anything; a time counts `10**power` µs and is a whole number where `whole_times`. Blank lines
    and lines that begin with `#` are passed over.
    """
    x, y, t_us, p = columns
    n, k = 0, 0
    values = np.zeros(5, np.int64)
    while k < len(text):
        line = k
        while k < len(text) and _is_gap(text[k]):
            k += 1
        if k == len(text):
            break
        if text[k] == 10:
            k += 1
            continue
        if text[k] == 35:
            while k < len(text) and text[k] != 10:
                k += 1
            continue
        for field in range(len(order)):
            if k == len(text) or text[k] == 10:
                return n, line
            what = order[field]
            if what < 0:
                while k < len(text) and text[k] != 10 and not _is_gap(text[k]):
                    k += 1
            elif what == 3 and text[k] > 64:
                values[3], k = _truth(text, k, len(text))
                if k < 0:
                    return n, line
            else:
                mantissa, exponent, negative, k = _number(text, k, len(text))
                if k < 0:
                    return n, line
                exponent += power if what == 0 else -3 if what == 4 else 0
                value, whole = _scaled(mantissa, exponent)
                if not whole and (0 < what < 4 or whole_times):
                    return n, line
                values[what] = -value if negative else value
            while k < len(text) and _is_gap(text[k]):
                k += 1
        if k < len(text) and text[k] != 10:
            return n, line
        if not 0 <= values[4] <= 1000000 or values[0] < 0:
            return n, line
        values[0] += values[4]
        good = 0 <= values[0] <= _MOST and 0 <= values[1] <= 65535 and 0 <= values[2] <= 65535
        if not good or values[3] < -1 or values[3] > 1:
            return n, line
        t_us[n], x[n], y[n], p[n] = values[0], values[1], values[2], values[3] > 0
        n += 1
    return n, -1


@njit(cache=True, nogil=True)
def _put(text: Bytes, n: int, value: Whole, least: int) -> int:
    """Writes a number >= 0 with at least so many digits; returns the place behind it."""
    digits, rest = 1, value // 10
    while rest > 0:
        digits += 1
        rest //= 10
    digits = max(digits, least)
    for k in range(digits):
        text[n + digits - 1 - k] = 48 + value % 10
        value //= 10
    return n + digits


@njit(cache=True, nogil=True)
def format_rows(columns: Columns, seconds: bool, gap: int, text: Bytes) -> int:
    """Writes `t x y p` lines, time in seconds with six decimals or in µs; needs 40 bytes a line."""
    x, y, t_us, p = columns
    n = 0
    for k in range(len(t_us)):
        if seconds:
            n = _put(text, n, t_us[k] // 1000000, 1)
            text[n] = 46
            n = _put(text, n + 1, t_us[k] % 1000000, 6)
        else:
            n = _put(text, n, t_us[k], 1)
        text[n] = gap
        n = _put(text, n + 1, np.int64(x[k]), 1)
        text[n] = gap
        n = _put(text, n + 1, np.int64(y[k]), 1)
        text[n] = gap
        text[n + 1] = 49 if p[k] else 48
        text[n + 2] = 10
        n += 3
    return n
