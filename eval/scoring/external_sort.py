"""Numbers of many windows, kept on disk and read back in order: medians and curves in flat memory.

Each window adds a run, sorted. The runs are then read between two keys at a time, a million
numbers or so, and merged there: nothing is ever held whole, and nothing is approximated.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError

Floats = NDArray[np.float64]
Edges = NDArray[np.int64]

MOST_AT_ONCE = 1_000_000
"""How many numbers are held at once, unless more than that are equal."""


class SortedRuns:
    """Keys with a value each, in runs; equal keys stay in the order in which they were added.

    Attributes:
        count: how many there are.
    """

    def __init__(self, path: Path) -> None:
        """Keeps `path` and files of that name with a suffix; `path` is in an existing folder."""
        self._keys, self._values = path.with_suffix(".keys"), path.with_suffix(".values")
        self._edges = [0]

    @property
    def count(self) -> int:
        """How many there are."""
        return self._edges[-1]

    def add(self, keys: Floats, values: Floats | None = None) -> None:
        """Adds a run.

        Args:
            keys: (N,) finite, in any order.
            values: (N,) one for each key; None in every run or in none.

        Raises:
            InputError: no room on the disk.
        """
        order = np.argsort(keys, kind="stable")
        _append(self._keys, keys[order])
        if values is not None:
            _append(self._values, values[order])
        self._edges.append(self.count + len(keys))

    def chunks(self, most: int = MOST_AT_ONCE) -> Iterator[tuple[Floats, Floats]]:
        """Reads keys and values in rising order of the keys; equal keys come together.

        Args:
            most: how many at once, unless more are equal.

        Yields:
            (N,) keys and (N,) values; without values, the keys twice.
        """
        if not self.count:
            return
        keys = np.memmap(self._keys, np.float64, "r")
        values = np.memmap(self._values, np.float64, "r") if self._values.exists() else keys
        edges = np.array(self._edges)
        for low, high in _ranges(keys, edges[:-1], edges[1:], most):
            pieces = [slice(*piece) for piece in zip(low.tolist(), high.tolist(), strict=True)]
            found = np.concatenate([keys[piece] for piece in pieces])
            order = np.argsort(found, kind="stable")
            ordered = (
                found if values is keys else np.concatenate([values[piece] for piece in pieces])
            )
            yield found[order], ordered[order]

    def median(self, most: int = MOST_AT_ONCE) -> float:
        """The median of the keys, as `numpy.median` has it; NaN of none."""
        wanted, found = sorted({(self.count - 1) // 2, self.count // 2}), []
        before = 0
        for keys, _ in self.chunks(most) if self.count else ():
            found += [keys[rank - before] for rank in wanted if before <= rank < before + len(keys)]
            before += len(keys)
            if len(found) == len(wanted):
                break
        return float(np.mean(found)) if found else float("nan")


def _ranges(keys: Floats, low: Edges, high: Edges, most: int) -> Iterator[tuple[Edges, Edges]]:
    """Cuts all runs at common keys, so that at most `most` elements lie between two cuts."""
    if int((high - low).sum()) <= most:
        yield low, high
        return
    pivot = _middle(keys, low, high)
    for side in ("right", "left"):
        cut = np.array([
            begin + np.searchsorted(keys[begin:end], pivot, side)
            for begin, end in zip(low.tolist(), high.tolist(), strict=True)
        ])  # fmt: skip
        if (cut > low).any() and (cut < high).any():
            yield from _ranges(keys, low, cut, most)
            yield from _ranges(keys, cut, high, most)
            return
    yield low, high  # all equal


def _middle(keys: Floats, low: Edges, high: Edges) -> float:
    """A key with a quarter of the elements or more on either side: the runs' median of medians."""
    held = high > low
    medians = keys[(low + high)[held] // 2]
    order = np.argsort(medians)
    weights = np.cumsum((high - low)[held][order])
    return float(medians[order][np.searchsorted(weights, weights[-1] / 2)])


def _append(path: Path, numbers: Floats) -> None:
    try:
        with path.open("ab") as file:
            file.write(np.ascontiguousarray(numbers, np.float64).tobytes())
    except OSError as error:
        raise InputError(
            f"{path.parent}: cannot keep the scores of a window there ({error.strerror}): free "
            "some room, or set TMPDIR to another folder"
        ) from error
