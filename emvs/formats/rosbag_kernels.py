"""Compiled decoding and encoding of the event arrays in ROS messages.

An event is x, y (uint16), seconds, nanoseconds (uint32) and polarity (1 byte). ROS1 packs it into
13 bytes; ROS2 aligns each field, which gives 16 bytes an event, with x of all but the first one
two bytes before the rest.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.formats.prophesee_kernels import Columns, Whole

Bytes = NDArray[np.uint8]


@njit(cache=True, inline="always")
def _uint16(data: Bytes, k: int) -> Whole:
    return np.int64(data[k]) | (np.int64(data[k + 1]) << 8)


@njit(cache=True, inline="always")
def _uint32(data: Bytes, k: int) -> Whole:
    return (
        np.int64(data[k])
        | (np.int64(data[k + 1]) << 8)
        | (np.int64(data[k + 2]) << 16)
        | (np.int64(data[k + 3]) << 24)
    )


@njit(cache=True, nogil=True)
def decode_array(data: Bytes, stride: int, x_back: int, columns: Columns) -> int:
    """Fills the columns from one array; returns the first impossible event, or -1."""
    x, y, t_us, p = columns
    for k in range(len(x)):
        at = k * stride
        seconds, nanoseconds = _uint32(data, at + 4), _uint32(data, at + 8)
        if nanoseconds >= 1000000000 or data[at + 12] > 1:
            return k
        x[k] = _uint16(data, at - (x_back if k else 0))
        y[k] = _uint16(data, at + 2 if not (k and x_back) else at)
        t_us[k] = seconds * 1000000 + (nanoseconds + 500) // 1000
        p[k] = data[at + 12]
    return -1


@njit(cache=True, nogil=True)
def encode_array(columns: Columns, data: Bytes) -> None:
    """Fills 13 bytes per event, as ROS1 packs them."""
    x, y, t_us, p = columns
    for k in range(len(x)):
        at = 13 * k
        seconds, nanoseconds = t_us[k] // 1000000, (t_us[k] % 1000000) * 1000
        for byte in range(2):
            data[at + byte] = (x[k] >> (8 * byte)) & 0xFF
            data[at + 2 + byte] = (y[k] >> (8 * byte)) & 0xFF
        for byte in range(4):
            data[at + 4 + byte] = (seconds >> (8 * byte)) & 0xFF
            data[at + 8 + byte] = (nanoseconds >> (8 * byte)) & 0xFF
        data[at + 12] = 1 if p[k] else 0
