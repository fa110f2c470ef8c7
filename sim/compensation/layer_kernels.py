"""What a pixel sees where surfaces pass before one another: compiled, one pixel at a time.

Near a depth edge no single path says where a pixel's light comes from: a wire that lies beside the
pixel in both frames may cross it in between. Every surface that comes within reach is a layer
(`layer_search_kernels`), followed on its own path; layers are composed from front to back by what
the frames' samples prove. Of the samples in a pixel-sized box around a layer's place in a frame,
those on it show its light; those beyond it prove that it is not there; those before it hide it and
prove nothing. With the frames weighed by nearness in time, 1 - s and s,

    cover = sum of weight x on / sum of weight x (on + beyond)

and the pixel's light is that of the first layer times its cover, plus what the second adds in the
rest, and so on. In a frame itself this is exactly the mean over the pixel's samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.sim.compensation.box_sums_kernels import box_sums
from eventsweep.sim.compensation.edge_reach_kernels import Seen
from eventsweep.sim.compensation.layer_search_kernels import MOST, Layers
from eventsweep.sim.compensation.path_kernels import (
    FAST,
    NO_ARRAYS,
    TO_FIRST_END,
    TO_FIRST_MIDDLE,
    TO_SECOND_MIDDLE,
    TO_SECOND_START,
    View,
    bent,
    carried,
    fused,
    light_at,
)

# A layer's numbers: those in the first frame, those in the second, and the light that it had last.
# As indices where they are handed on: for a literal, numba would compile what is called once more.
_FIRST: int = np.int64(0)  # type: ignore[assignment]
_SECOND: int = np.int64(11)  # type: ignore[assignment]
_LAST, NUMBERS = 22, 23
# In a frame: column and row, each times s and times s², at the low end of the layer's range; what
# the high end adds to these; the inverse depth under which a sample lies beyond the layer; at what
# share of the range its samples were found last; and inverse depth there, over that half-way.
_FAR, _UNDER, _SHARE, _RATIO = 4, 8, 9, 10
# Where a range is thinner, 1/m, or fewer samples are found, their depth says nothing new.
_THIN, _FEW = 1e-4, 0.02
_LEAST_ON = 1e-6
_SEARCHED_PX = 8
# The share of a pixel that still shows something behind its layers.
_LEFT = 1e-3


class Layered(NamedTuple):
    """The pixels that see several surfaces.

    Attributes:
        layers: of all such pixels.
        before: samples of the first frame.
        after: of the second.
        grid: samples per pixel and axis.
        border: pixels of the frames beyond the sensor's edge.
    """

    layers: Layers
    before: Seen
    after: Seen
    grid: int
    border: int


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def nearer_by(T: NDArray[np.float64], a: float, b: float, rho: float) -> float:
    """Depth in another view over that in this one, of a point (a, b) at inverse depth `rho`."""
    return T[2, 0] * a + T[2, 1] * b + T[2, 2] + T[2, 3] * rho  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def begin_layer(
    x: int,
    y: int,
    a: float,
    b: float,
    low: float,
    high: float,
    under: float,
    middle: NDArray[np.float64],
    whole: NDArray[np.float64],
    lens: NDArray[np.float64],
    numbers: NDArray[np.float64],
) -> float:
    """Fills a layer's numbers in one frame; returns the longest way, px.

    Args:
        x: the pixel's column.
        y: its row.
        a: x/z of its bearing.
        b: y/z.
        low: least inverse depth of the layer half-way in time, 1/m.
        high: greatest.
        under: half-way in time, samples at less inverse depth lie beyond the layer.
        middle: (4, 4) from half-time to the frame.
        whole: (4, 4) from the other frame.
        lens: see `path_kernels.distorted`.
        numbers: out, (11,).
    """
    longest = 0.0
    for end in range(2):
        rho = high if end else low
        half_u, half_v = carried(middle, a, b, rho, lens)
        # From half-way to the other frame, inverse depth changes as it did up to half-way.
        whole_u, whole_v = carried(whole, a, b, rho * nearer_by(middle, a, b, rho), lens)
        u1, u2 = bent(whole_u - x, half_u - x)
        v1, v2 = bent(whole_v - y, half_v - y)
        longest = max(longest, math.hypot(whole_u - x, whole_v - y))
        if end:
            numbers[_FAR], numbers[_FAR + 1] = u1 - numbers[0], u2 - numbers[1]
            numbers[_FAR + 2], numbers[_FAR + 3] = v1 - numbers[2], v2 - numbers[3]
        else:
            numbers[0], numbers[1], numbers[2], numbers[3] = u1, u2, v1, v2
    numbers[_UNDER] = under / nearer_by(middle, a, b, under) if under > 0.0 else -1.0
    numbers[_SHARE] = 0.5
    numbers[_RATIO] = 1.0 / nearer_by(middle, a, b, 0.5 * (low + high))
    return longest


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def begin_layers(
    x: int, y: int, layers: Layers, k: int, view: View, numbers: NDArray[np.float64]
) -> float:
    """Fills the numbers of all layers of a pixel; returns the longest way, px.

    Args:
        x: the pixel's column.
        y: its row.
        layers: of all pixels.
        k: the pixel's row there.
        view: without a border.
        numbers: out, (MOST, NUMBERS).
    """
    bearing, lens, ways = view
    a, b = np.float64(bearing[y, x, 0]), np.float64(bearing[y, x, 1])
    longest = 0.0
    for m in range(layers.number[k]):
        own, low, high = ways[layers.way[k, m]], layers.low[k, m], layers.high[k, m]
        under = -1.0
        if m + 1 < layers.number[k]:
            under = 0.5 * (low + layers.high[k, m + 1])
        first = begin_layer(
            x, y, a, b, low, high, under, own[TO_FIRST_MIDDLE], own[TO_FIRST_END], lens,
            numbers[m, :_SECOND],
        )  # fmt: skip
        second = begin_layer(
            x, y, a, b, low, high, under, own[TO_SECOND_MIDDLE], own[TO_SECOND_START], lens,
            numbers[m, _SECOND:],
        )  # fmt: skip
        numbers[m, _LAST] = -1.0
        longest = max(longest, first, second)
    return longest


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def place_of(
    x: float, y: float, numbers: NDArray[np.float64], at: int, s: float
) -> tuple[float, float]:
    """Where a layer that pixel (x, y) sees lies in a frame whose numbers begin at `at`."""
    f = numbers[at + _SHARE]
    u = fused(f, numbers[at + 4], numbers[at]) + s * fused(f, numbers[at + 5], numbers[at + 1])
    v = fused(f, numbers[at + 6], numbers[at + 2]) + s * fused(f, numbers[at + 7], numbers[at + 3])
    return fused(s, u, x), fused(s, v, y)


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def proof(
    frame: Seen, n: int, u: float, v: float, over: float, under: float
) -> tuple[float, float, float, float]:
    """What the samples of a pixel-sized box say of a layer.

    Args:
        frame: its samples.
        n: samples per pixel and axis.
        u: the box's left edge, px from the border's.
        v: its upper edge.
        over: samples nearer than this inverse depth hide the layer.
        under: samples no nearer than this lie beyond it.

    Returns:
        How many samples are on the layer and how many beyond it, as shares of a box, and the sums
        of light and of inverse depth over those on it. Outside of the frame nothing is proven.
    """
    rows, columns = frame.nearest.shape
    if not (0.0 <= u < columns - 1.0 and 0.0 <= v < rows - 1.0):
        return 0.0, 0.0, 0.0, 0.0
    j, i = int(u), int(v)
    near = max(
        max(frame.nearest[i, j], frame.nearest[i, j + 1]),
        max(frame.nearest[i + 1, j], frame.nearest[i + 1, j + 1]),
    )
    if near <= under:
        return 0.0, 1.0, 0.0, 0.0
    far = min(
        min(frame.farthest[i, j], frame.farthest[i, j + 1]),
        min(frame.farthest[i + 1, j], frame.farthest[i + 1, j + 1]),
    )
    if far > over:
        return 0.0, 0.0, 0.0, 0.0
    u, v = n * u, n * v
    if under < far and near <= over:
        middle = frame.rho[int(v) + n // 2, int(u) + n // 2]
        return 1.0, 0.0, light_at(frame.boxes, u, v), middle
    return box_sums(frame, n, u, v, over, under)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def hidden_light(
    before: Seen, after: Seen, n: int, u_a: float, v_a: float, u_b: float, v_b: float,
    over_a: float, under_a: float, over_b: float, under_b: float, s: float,
) -> float:  # fmt: skip
    """The light of a layer that both frames hide here: that of its nearest samples around.

    `n`, and for the first frame (a) and the second (b) the box's corner and the bounds of inverse
    depth, are those of `proof`; s is 0 at the first frame and 1 at the second.
    """
    for far in range(1, 2 * _SEARCHED_PX + 1):
        on, total = 0.0, 0.0
        for corner in range(4):
            du, dv = (corner % 2 - 0.5) * far, (corner // 2 - 0.5) * far
            shown, _, light, _ = proof(before, n, u_a + du, v_a + dv, over_a, under_a)
            on, total = on + (1.0 - s) * shown, total + (1.0 - s) * light
            shown, _, light, _ = proof(after, n, u_b + du, v_b + dv, over_b, under_b)
            on, total = on + s * shown, total + s * light
        if on > _LEAST_ON:
            return total / on
    return 0.0


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def found_at(
    numbers: NDArray[np.float64], at: int, low: float, high: float, on: float, depth: float
) -> None:
    """Keeps at what share of a layer's range its samples are: the path goes with their depth."""
    if on > _FEW and high - low > _THIN:
        rho = depth / on / numbers[at + _RATIO]
        numbers[at + _SHARE] = min(max((rho - low) / (high - low), 0.0), 1.0)


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def layered_light(
    x: int, y: int, layered: Layered, k: int, numbers: NDArray[np.float64], s: float
) -> tuple[float, float]:
    """The light of a pixel at time s, composed of its layers, and its nearest inverse depth, 1/m.

    Args:
        x: column.
        y: row.
        layered: all such pixels.
        k: the pixel's row there.
        numbers: in and out, of `begin_layers`; it remembers where samples were found.
        s: 0 at the first frame, 1 at the second.
    """
    layers, before, after, n, border = layered
    rest, light, nearest, t = 1.0, 0.0, -1.0, 1.0 - s
    over_a, over_b, last = np.inf, np.inf, layers.number[k] - 1
    for m in range(last + 1):
        own, low, high = numbers[m], layers.low[k, m], layers.high[k, m]
        u_a, v_a = place_of(np.float64(x + border), np.float64(y + border), own, _FIRST, s)
        u_b, v_b = place_of(np.float64(x + border), np.float64(y + border), own, _SECOND, t)
        under_a, under_b = own[_UNDER], own[_SECOND + _UNDER]
        on_a, beyond_a, light_a, depth_a = proof(before, n, u_a, v_a, over_a, under_a)
        on_b, beyond_b, light_b, depth_b = proof(after, n, u_b, v_b, over_b, under_b)
        found_at(own, _FIRST, low, high, on_a, depth_a)
        found_at(own, _SECOND, low, high, on_b, depth_b)
        on, beyond = t * on_a + s * on_b, t * beyond_a + s * beyond_b
        if on > _LEAST_ON:
            # The last one's cover is all that is left: there is nothing behind.
            cover = on / (on + beyond) if m < last else 1.0
            own[_LAST] = (t * light_a + s * light_b) / on
            light, rest = light + rest * cover * own[_LAST], rest * (1.0 - cover)
            if nearest < 0.0:
                nearest = (t * depth_a + s * depth_b) / on
        elif m == last:
            if own[_LAST] < 0.0:
                own[_LAST] = hidden_light(
                    before, after, n, u_a, v_a, u_b, v_b, over_a, under_a, over_b, under_b, s
                )
            light += rest * own[_LAST]
        if rest < _LEFT:
            break
        over_a, over_b = under_a, under_b
    return light, nearest


@numba.njit(cache=True, nogil=True)
def fill_layered_picture(
    layered: Layered, view: View, s: float, picture: NDArray[np.float32]
) -> None:
    """Puts the light of all pixels that have layers into a picture (H, W), at time s.

    Args:
        layered: these pixels.
        view: without a border.
        s: 0 at the first frame, 1 at the second.
        picture: in and out.
    """
    numbers = np.empty((MOST, NUMBERS))
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            k = layered.layers.slot[y, x]
            if k >= 0:
                begin_layers(x, y, layered.layers, k, view, numbers)
                for _ in range(2):  # once more, where the first time found them
                    light, _ = layered_light(x, y, layered, k, numbers, s)
                picture[y, x] = light


@numba.njit(cache=True, nogil=True)
def fill_layered_depths(
    layered: Layered,
    view: View,
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    share: NDArray[np.float64],
    depth_m: NDArray[np.float32],
) -> None:
    """Puts the nearest depth, m, where pixels have layers; other values stay.

    Args:
        layered: the pixels that have layers.
        view: without a border.
        x: (N,) columns.
        y: (N,) rows.
        share: (N,) times, 0 at the first frame, 1 at the second.
        depth_m: in and out, (N,).
    """
    numbers = np.empty((MOST, NUMBERS))
    for m in range(len(x)):
        i, j = int(y[m]), int(x[m])
        k = layered.layers.slot[i, j]
        if k >= 0:
            begin_layers(j, i, layered.layers, k, view, numbers)
            rho = -1.0
            for _ in range(2):
                _, rho = layered_light(j, i, layered, k, numbers, share[m])
            if rho >= 0.0:
                depth_m[m] = 1.0 / rho if rho > 0.0 else np.inf
