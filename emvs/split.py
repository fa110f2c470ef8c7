"""Cuts a camera's events into sub-intervals, and its rays with them (paper, Alg. 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emvs.rays import RayCounts, Rays
from emvs.recipe import Split

_COUNTS = ("events", "without_pose", "without_ray", "backwards", "dropped")


def cuts(t_us: NDArray[np.int64], split: Split, t0_us: int, t1_us: int) -> NDArray[np.int64]:
    """Returns the (intervals + 1,) events where a camera's sub-intervals begin and end.

    Args:
        t_us: (N,) int64, the camera's events in the window, sorted.
        split: how many, of equal count or of equal time.
        t0_us: begin of the window, included.
        t1_us: end of the window, excluded.
    """
    edge = np.arange(split.intervals + 1, dtype=np.int64)
    if split.by == "count":
        edge *= len(t_us)
        edge //= split.intervals
        return edge
    inner_us = t0_us + edge[1:-1] * (t1_us - t0_us) // split.intervals
    edge[1:-1] = np.searchsorted(t_us, inner_us, side="left")
    edge[-1] = len(t_us)
    return edge


def concatenated(parts: Sequence[Rays]) -> Rays:
    """Joins rays in the order given."""
    if len(parts) == 1:
        return parts[0]
    columns = [np.concatenate(pieces) for pieces in zip(*(p.columns for p in parts), strict=True)]
    return Rays.of(columns, total([part.counts for part in parts]))


def part(rays: Rays, first: int, last: int, counts: RayCounts) -> Rays:
    """Returns rays `first` to `last` (exclusive) as views, with counts of their own."""
    return Rays.of([column[first:last] for column in rays.columns], counts)


def total(counts: Sequence[RayCounts]) -> RayCounts:
    """Adds up what became of events."""
    sums = {name: sum(getattr(count, name) for count in counts) for name in _COUNTS}
    return RayCounts(**sums)


def with_left_out(counts: RayCounts, left_out: int) -> RayCounts:
    """Counts events that no pose covers and that were never read."""
    return replace(
        counts, events=counts.events + left_out, without_pose=counts.without_pose + left_out
    )
