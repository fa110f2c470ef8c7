"""Two streams of events compared one to one: each event counts for at most one of the other stream.

Anything with `x`, `y`, `t_us` and `p` (0 or 1) is a stream.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numba as nb
import numpy as np
from numpy.typing import NDArray

TOLERANCE_US = 1000.0


class Stream(Protocol):
    """Columns, rows, times in µs and polarities, (N,) each, in any order."""

    @property
    def x(self) -> NDArray[Any]: ...
    @property
    def y(self) -> NDArray[Any]: ...
    @property
    def t_us(self) -> NDArray[Any]: ...
    @property
    def p(self) -> NDArray[Any]: ...


@dataclass(frozen=True)
class Agreement:
    """How some events agree with the true ones.

    Attributes:
        true: number of true events.
        found: number of the others.
        matched: number of pairs.
        median_us: median time between the two of a pair, µs; NaN without pairs. It is below the
            tolerance by construction: what is further off is lost from recall and precision.
    """

    true: int
    found: int
    matched: int
    median_us: float

    @property
    def count_error(self) -> float:
        """Share by which the found are too many; negative where they are too few."""
        return self.found / self.true - 1 if self.true else float("nan")

    @property
    def recall(self) -> float:
        """Share of the true events with a partner."""
        return self.matched / self.true if self.true else float("nan")

    @property
    def precision(self) -> float:
        """Share of the found events with a partner."""
        return self.matched / self.found if self.found else float("nan")


def agreement(found: Stream, true: Stream, tolerance_us: float = TOLERANCE_US) -> Agreement:
    """Compares events with the true ones.

    Events of one pixel and polarity at most `tolerance_us` apart are paired in the order of time,
    the earliest two first: no other choice of pairs has more of them.
    """
    errors_us = np.abs(pair_offsets_us(found, true, tolerance_us))
    median_us = float(np.median(errors_us)) if len(errors_us) else float("nan")
    return Agreement(len(true.t_us), len(found.t_us), len(errors_us), median_us)


def pair_offsets_us(found: Stream, true: Stream, tolerance_us: float) -> NDArray[np.float64]:
    """How much later the found event of each pair is, µs."""
    true_key, true_us = _ordered(true)
    found_key, found_us = _ordered(found)
    offsets_us = np.empty(min(len(true_us), len(found_us)))
    pairs = _pair(true_key, true_us, found_key, found_us, tolerance_us, offsets_us)
    return offsets_us[:pairs]


def _ordered(stream: Stream) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Keys of pixel and polarity, and times, sorted by both."""
    x, y, p = (np.asarray(part).astype(np.int64) for part in (stream.x, stream.y, stream.p))
    t_us, key = np.asarray(stream.t_us, float), (y << 32) + (x << 1) + p
    order = np.lexsort((t_us, key))
    return key[order], t_us[order]


@nb.njit(cache=True)
def _pair(true_key, true_us, found_key, found_us, tolerance_us, offsets_us):
    """Walks along both at once: of two events without a common partner the earlier one has none."""
    i = j = pairs = 0
    while i < len(true_us) and j < len(found_us):
        later_us = found_us[j] - true_us[i]
        if true_key[i] == found_key[j] and abs(later_us) <= tolerance_us:
            offsets_us[pairs] = later_us
            i, j, pairs = i + 1, j + 1, pairs + 1
        elif true_key[i] < found_key[j] or (true_key[i] == found_key[j] and later_us > 0):
            i += 1
        else:
            j += 1
    return pairs
