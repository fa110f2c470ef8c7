"""What walks tell the pixels on their way, against sets and sorted intervals in plain Python.

And whose surfaces they are, where a body passes before a wall.
"""

from collections import defaultdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.compensation.fine_frame import FineFrame
from eventsweep.sim.compensation.interval import Passage, interval_between
from eventsweep.sim.compensation.layer_search_kernels import empty_reached, walk
from eventsweep.sim.rendering.base import Frame, Samples
from eventsweep.sim.rendering.moving_bodies import BodyPixels

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


WALL_M, BODY_M, SIZE, BORDER, REACH_PX = 2.5, 1.0, 16, 10, 8.0


def shown(edge_px, grid):
    """A fine frame and its body's pixels: a body above a level edge, a wall below."""
    wide = SIZE + 2 * BORDER
    rows_px = (np.arange(grid * wide) + 0.5) / grid - 0.5 - BORDER
    depth_m = np.where(rows_px < edge_px, BODY_M, WALL_M)[:, None].repeat(grid * wide, 1)
    light = np.full(depth_m.shape, 0.5, np.float32)
    nearest_m = depth_m.reshape(wide, grid, wide, grid).min((1, 3))[BORDER:-BORDER, BORDER:-BORDER]
    inner = np.full((SIZE, SIZE), 0.5, np.float32)
    samples = Samples(light, (1 / depth_m).astype(np.float32))
    frame = FineFrame(Frame(inner, nearest_m.astype(np.float32), samples), grid, REACH_PX)
    at_px = np.stack(np.meshgrid(*[np.arange(-BORDER, SIZE + BORDER)] * 2), -1).reshape(-1, 2)
    own = at_px[at_px[:, 1] < edge_px]
    return frame, BodyPixels(own, np.zeros((len(own), 3)), np.zeros(len(own), np.int32))


@given(st.floats(6, 9), st.sampled_from([3, 4, 6]), st.floats(0, 0.01))
def test_a_body_is_never_taken_for_the_wall_behind_it(edge_px, grid, head_m):
    """Wherever its edge lies, and however little the head moves: depths are those of each way."""
    camera = Camera(SIZE, SIZE, 100.0, 100.0, 7.5, 7.5)
    poses = [np.eye(4) for _ in range(3)]
    poses[1][0, 3], poses[2][0, 3] = head_m / 2, head_m

    def moved(now_us, later_us):
        T = np.eye(4)[None].copy()
        T[0, 0, 3] = 5e-5 * (later_us - now_us) / 10
        return T

    frame, body = shown(edge_px, grid)
    shape = SIZE + 2 * BORDER, SIZE + 2 * BORDER
    interval = interval_between((0, 10_000), tuple(poses), shape, (body, body), moved, BORDER)
    layers = Passage(camera, frame, frame, interval).layered.layers
    assert len(layers.number) > 0
    rho = np.array([1 / WALL_M, 1 / BODY_M])
    for k, number in enumerate(layers.number):
        expected = rho[layers.way[k, :number]]
        assert np.allclose(layers.low[k, :number], expected, atol=1e-3)
        assert np.allclose(layers.high[k, :number], expected, atol=1e-3)
