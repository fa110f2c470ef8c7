"""What walks tell the pixels on their way, against sets and sorted intervals in plain Python."""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
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


def covered(du, dv, at):
    """The greatest share of each pixel that a pixel-sized box covers on its straight way."""
    crossings = [k / d for d in (du, dv) if d for k in range(-9, 10) if 0 < k / d < 1]
    most = defaultdict(float)
    for start, end in pairwise(sorted({0.0, 1.0, *crossings})):
        for share in np.linspace(start, end, 21):
            x, y = at[0] + du * share, at[1] + dv * share
            left, top = int(np.floor(x)), int(np.floor(y))
            for i, j in np.ndindex(2, 2):
                area = (1 - abs(left + j - x)) * (1 - abs(top + i - y))
                most[top + i, left + j] = max(most[top + i, left + j], area)
    return most


def pixels_told(starts, du, dv):
    """The pixels that walks by (du, dv) from several pixels tell."""
    reached = empty_reached(np.arange(24 * 24, dtype=np.int32).reshape(24, 24))
    for x, y in starts:
        walk(x, y, x + du, y + dv, 0, 0.0, 0.0, GAP, 0.0, 1.0, reached)
    return set(map(tuple, np.argwhere(reached.number.reshape(24, 24) > 0).tolist()))


@given(*(st.floats(-9, 9, width=32) for _ in range(2)))
def test_a_corner_that_a_walk_cuts_is_small_and_its_neighbours_walk_there(du, dv):
    shares = {pixel: share for pixel, share in covered(du, dv, (12, 12)).items() if share > 1e-6}
    assert {pixel for pixel, share in shares.items() if share > 0.25 + 1e-6} <= pixels_told(
        [(12, 12)], du, dv
    )
    around = [(11 + i, 11 + j) for i, j in np.ndindex(3, 3)]
    assert set(shares) <= pixels_told(around, du, dv)
