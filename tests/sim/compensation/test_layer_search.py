"""What walks tell the pixels on their way, against sets and sorted intervals in plain Python."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.sim.compensation.layer_search_kernels import empty_reached, walk

SHAPE, GAP = (9, 11), 1 / 16


class Walk(NamedTuple):
    """One walk's arguments, up to the gap, and its light."""

    x: int
    y: int
    u: float
    v: float
    way: int
    low: float
    high: float
    dark: float
    bright: float


@st.composite
def walks(draw):
    x, y = draw(st.integers(-4, 14)), draw(st.integers(-4, 12))
    du, dv = (draw(st.floats(-9, 9, width=32)) for _ in range(2))
    low = draw(st.integers(0, 4)) / 16  # at most three apart of each way: room for all
    ends = low, low + draw(st.integers(0, 2)) / 32
    light = sorted(draw(st.integers(0, 32)) / 32 for _ in range(2))
    return Walk(x, y, x + du, y + dv, draw(st.integers(0, 1)), *ends, *light)


def on_the_way(one):
    """All pixels of the sensor that a walk comes over."""
    steps = int(max(abs(one.u - one.x), abs(one.v - one.y))) + 1
    shares = np.arange(steps + 1)
    columns = np.floor(one.x + (one.u - one.x) * shares / steps).astype(int)
    rows = np.floor(one.y + (one.v - one.y) * shares / steps).astype(int)
    blocks = [
        (r + i, c + j) for r, c in zip(rows, columns, strict=True) for i, j in np.ndindex(2, 2)
    ]
    return {(r, c) for r, c in blocks if 0 <= r < SHAPE[0] and 0 <= c < SHAPE[1]}


def joined(ranges):
    """Sorted intervals of one way, those joined that are no further apart than the gap."""
    found: list[list[float]] = []
    for low, high in sorted(ranges):
        if found and low <= found[-1][1] + GAP:
            found[-1][1] = max(found[-1][1], high)
        else:
            found.append([low, high])
    return [tuple(one) for one in found]


@given(st.lists(walks(), max_size=8))
def test_every_pixel_on_the_way_learns_what_comes(all_walks):
    slot = np.arange(np.prod(SHAPE), dtype=np.int32).reshape(SHAPE)
    slot[:, 4] = -1  # nobody asks for these
    reached = empty_reached(slot)
    told = defaultdict(list)
    for one in all_walks:
        walk(*one[:7], GAP, one.dark, one.bright, reached)
        for pixel in on_the_way(one):
            told[pixel].append(one)
    for pixel in np.ndindex(SHAPE):
        k = slot[pixel]
        if k < 0:
            continue
        known = reached.number[k]
        columns = (values[:known, k] for values in (reached.way, reached.low, reached.high))
        truth = [
            (way, *ends)
            for way in (0, 1)
            for ends in joined((one.low, one.high) for one in told[pixel] if one.way == way)
        ]
        assert sorted(zip(*columns, strict=True)) == truth
        assert reached.dark[k] == min((one.dark for one in told[pixel]), default=np.inf)
        assert reached.bright[k] == max((one.bright for one in told[pixel]), default=-np.inf)
