"""Cuts a camera's events into sub-intervals, and its rays with them (paper, Alg. 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emvs.kernels import CHUNK
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
    columns = [
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("a_u", "b_u", "a_v", "b_v", "c_z")
    ]
    return _rays(columns, total([part.counts for part in parts]))


def part(rays: Rays, first: int, last: int, counts: RayCounts) -> Rays:
    """Returns rays `first` to `last` (exclusive) as views, with counts of their own."""
    columns = [column[first:last] for column in (rays.a_u, rays.b_u, rays.a_v, rays.b_v, rays.c_z)]
    return _rays(columns, counts)


def total(counts: Sequence[RayCounts]) -> RayCounts:
    """Adds up what became of events."""
    sums = {name: sum(getattr(count, name) for count in counts) for name in _COUNTS}
    return RayCounts(**sums)


def with_left_out(counts: RayCounts, left_out: int) -> RayCounts:
    """Counts events that no pose covers and that were never read."""
    return replace(
        counts, events=counts.events + left_out, without_pose=counts.without_pose + left_out
    )


def _rays(columns: Sequence[NDArray[np.float32]], counts: RayCounts) -> Rays:
    a_u, b_u, a_v, b_v, c_z = columns
    c_z_max = np.maximum.reduceat(c_z, np.arange(0, len(c_z), CHUNK)) if len(c_z) else c_z
    return Rays(a_u, b_u, a_v, b_v, c_z, c_z_max, counts)
