"""Decoder state of the EVT formats: what a word means depends on the words before it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

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


def initial_state() -> State:
    """Nothing read yet."""
    return np.zeros(SIZE, np.int64)
