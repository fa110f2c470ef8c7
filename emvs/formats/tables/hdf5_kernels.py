"""Compiled conversion of MVSEC's rows of doubles: x, y, seconds, polarity."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.formats.prophesee_kernels import Columns


@njit(cache=True, nogil=True)
def convert_rows(rows: NDArray[np.float64], columns: Columns) -> int:
    """Fills the columns; returns the first row that is no event, or -1."""
    x, y, t_us, p = columns
    for k in range(len(rows)):
        column, row, stamp, sign = rows[k, 0], rows[k, 1], rows[k, 2] * 1e6, rows[k, 3]
        # Written so that NaN fails each comparison.
        if not (0 <= column <= 65535 and 0 <= row <= 65535 and 0 <= stamp < 2.0**62):
            return k
        if column != np.floor(column) or row != np.floor(row):
            return k
        if not (sign == 1 or sign == -1 or sign == 0):
            return k
        x[k], y[k], t_us[k], p[k] = int(column), int(row), int(np.rint(stamp)), sign > 0
    return -1
