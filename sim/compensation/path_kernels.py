"""Where in two frames lies what a pixel sees between them, and its light there: compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

PINHOLE, RADTAN, KB4 = 0, 1, 2
"""Lens models, as the numbers that compiled code takes."""
TO_FIRST_MIDDLE, TO_FIRST_END, TO_SECOND_MIDDLE, TO_SECOND_START = 0, 1, 2, 3
"""Which of `ways` is which: into the first frame from half-time and from the second frame, into the
second frame from half-time and from the first."""

FAST = {"nnan", "nsz"}
"""Every number is rounded as it is written, so that each processor finds the same bits: nothing is
reordered, and products and sums are one instruction (`fused`) only where that is said. What is
called is inlined by `forceinline`: `inline="always"` has numba type and lower the body anew at each
call. And it says its flags: numba hands a caller's down to what it compiles on the way."""
NO_ARRAYS: Any = {"_nrt": False}
"""For what makes no array: otherwise each call counts who holds each array of its tuples, which
takes longer than what most of these do."""

Path = tuple[float, float, float, float, float, float, float, float, float]
# Indices without a sign: there is no negative one to look for.
_ONE, _TWO = np.uint64(1), np.uint64(2)


class View(NamedTuple):
    """A camera and how what it sees moves, as compiled code takes them.

    Attributes:
        bearing: (H, W, 2) of all pixels, those of a border included where there is one.
        lens: (10,) see `distorted`; of the sensor without a border.
        ways: (K, 4, 4, 4) transforms of camera coordinates, see `TO_FIRST_MIDDLE`.
    """

    bearing: NDArray[np.float32]
    lens: NDArray[np.float64]
    ways: NDArray[np.float64]


class Geometry(NamedTuple):
    """What one path for each pixel follows from.

    Attributes:
        lens_view: without a border.
        rho_a: (H, W) inverse depth in the first frame, 1/m.
        rho_b: (H, W) in the second.
        body_a: (H, W) which of `ways` the first frame's surface goes.
        body_b: (H, W) the second's.
    """

    lens_view: View
    rho_a: NDArray[np.float32]
    rho_b: NDArray[np.float32]
    body_a: NDArray[np.uint16]
    body_b: NDArray[np.uint16]


def _fused(_typing: Any, one: Any, other: Any, total: Any) -> Any:
    kind = types.float32 if {one, other, total} == {types.float32} else types.float64

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        bits = ir.FloatType() if kind == types.float32 else ir.DoubleType()
        name = f"llvm.fma.f{kind.bitwidth}"
        whole = ir.FunctionType(bits, [bits] * 3)
        function = cgutils.get_or_insert_function(builder.module, whole, name)  # type: ignore[no-untyped-call]
        return builder.call(function, args)

    return kind(kind, kind, kind), codegen


fused: Any = intrinsic(_fused)
"""One x other + total, rounded once: on a processor that cannot, by the system's library."""


@numba.njit(cache=True, nogil=True, inline="always")
def light_at(light: NDArray[np.float32], u: float, v: float) -> float:
    """Catmull-Rom light at column `u` and row `v` of the grid; beyond its edge that of the edge.

    It is kept between the least and the greatest of the four nodes around the place: without that
    it rings at edges of high contrast, where rings are events.
    """
    rows, columns = light.shape
    u, v = min(max(u, 1.0), columns - 2.001), min(max(v, 1.0), rows - 2.001)
    j, i = np.uint64(u), np.uint64(v)
    a0, a1, a2, a3 = _weights(np.float32(u - j))
    b0, b1, b2, b3 = _weights(np.float32(v - i))
    top, above, below, bottom = light[i - _ONE], light[i], light[i + _ONE], light[i + _TWO]
    k, m, n = j - _ONE, j + _ONE, j + _TWO
    one = fused(a0, top[k], fused(a1, top[j], fused(a2, top[m], a3 * top[n])))
    two = fused(a0, above[k], fused(a1, above[j], fused(a2, above[m], a3 * above[n])))
    three = fused(a0, below[k], fused(a1, below[j], fused(a2, below[m], a3 * below[n])))
    four = fused(a0, bottom[k], fused(a1, bottom[j], fused(a2, bottom[m], a3 * bottom[n])))
    value = fused(b0, one, fused(b1, two, fused(b2, three, b3 * four)))
    low = min(min(above[j], above[m]), min(below[j], below[m]))
    high = max(max(above[j], above[m]), max(below[j], below[m]))
    return min(max(value, low), high)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, inline="always")
def _weights(a: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Catmull and Rom (1974): weights of the nodes at -1, 0, 1 and 2 for a place at `a`."""
    half, one = np.float32(0.5), np.float32(1.0)
    b = one - a
    w0, w3 = -half * a * b * b, -half * b * a * a
    w1 = b * b * (one + a + a) - w3
    return w0, w1, one - w0 - w1 - w3, w3


@numba.njit(cache=True, nogil=True, inline="always")
def distorted(a: float, b: float, lens: NDArray[np.float64]) -> tuple[float, float]:
    """Where a lens of focal length 1 puts the bearing (a, b) = (x/z, y/z).

    Args:
        a: x/z.
        b: y/z.
        lens: (10,) fx, fy, cx, cy, number of the model, its terms; see `emvs.geometry.camera`.
    """
    model = int(lens[4])
    if model == RADTAN:
        r2 = a * a + b * b
        radial = 1.0 + r2 * (lens[5] + r2 * (lens[6] + r2 * lens[9]))
        p1, p2 = lens[7], lens[8]
        return (
            a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a),
            b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b,
        )
    if model == KB4:
        r = math.sqrt(a * a + b * b)
        if r > 1e-12:
            t = math.atan(r)
            t2 = t * t
            scale = t * (1.0 + t2 * (lens[5] + t2 * (lens[6] + t2 * (lens[7] + t2 * lens[8])))) / r
            return a * scale, b * scale
    return a, b


@numba.njit(cache=True, nogil=True, inline="always")
def turned(T: NDArray[np.float64], a: float, b: float, rho: float) -> tuple[float, float]:
    """Bearing, in another view, of a point with bearing (a, b) and inverse depth `rho`.

    Args:
        T: (4, 4) from this camera pose to the other.
        a: x/z in this view.
        b: y/z in this view.
        rho: inverse depth in this view, 1/m; 0 at infinity.
    """
    per_z = 1.0 / fused(T[2, 0], a, fused(T[2, 1], b, fused(T[2, 3], rho, T[2, 2])))
    u = fused(T[0, 0], a, fused(T[0, 1], b, fused(T[0, 3], rho, T[0, 2]))) * per_z
    v = fused(T[1, 0], a, fused(T[1, 1], b, fused(T[1, 3], rho, T[1, 2]))) * per_z
    return u, v


@numba.njit(cache=True, nogil=True, fastmath=False, **NO_ARRAYS)
def carried(
    T: NDArray[np.float64], a: float, b: float, rho: float, lens: NDArray[np.float64]
) -> tuple[float, float]:
    """Pixel position of what `turned` looks at, through any lens."""
    u, v = turned(T, a, b, rho)
    u, v = distorted(u, v, lens)
    return lens[0] * u + lens[2], lens[1] * v + lens[3]


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def bent(whole: float, half: float) -> tuple[float, float]:
    """A and b of the parabola s (a + b s) through `half` at s = 1/2 and `whole` at s = 1."""
    b = 2.0 * (whole - 2.0 * half)
    return whole - b, b


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def path_through(
    au: float, av: float, bu: float, bv: float, ahu: float, ahv: float, bhu: float, bhv: float
) -> Path:
    """A path from its ways, px: into both frames, the whole ones and those at half-time."""
    au1, au2 = bent(au, ahu)
    av1, av2 = bent(av, ahv)
    bu1, bu2 = bent(bu, bhu)
    bv1, bv2 = bent(bv, bhv)
    longest = math.sqrt(max(au * au + av * av, bu * bu + bv * bv))
    return au1, au2, av1, av2, bu1, bu2, bv1, bv2, longest


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def way_to(
    T: NDArray[np.float64], a: float, b: float, rho: float, fx: float, fy: float
) -> tuple[float, float]:
    """By how many pixels `turned` moves a pixel, without a lens."""
    u, v = turned(T, a, b, rho)
    return fx * (u - a), fy * (v - b)


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def straight_paths(
    bearing: NDArray[np.float32],
    rho_a: NDArray[np.float32],
    rho_b: NDArray[np.float32],
    ways: NDArray[np.float64],
    lens: NDArray[np.float64],
    paths: NDArray[np.float64],
) -> None:
    """Fills the paths of a whole row that shows nothing but what stands still, without a lens.

    Args:
        bearing: (W, 2) of its pixels.
        rho_a: (W,) inverse depth in the first frame, 1/m.
        rho_b: (W,) in the second.
        ways: (4, 4, 4) transforms of camera coordinates, see `TO_FIRST_MIDDLE`.
        lens: see `distorted`.
        paths: out, (9, W) of `paths_of_row`.
    """
    a_middle, a_end, b_middle, b_start = ways[0], ways[1], ways[2], ways[3]
    fx, fy = lens[0], lens[1]
    # Pixel (x, y) has the bearing (a, b), so that a way is the change of the bearing.
    for x in range(len(rho_a)):
        a, b = np.float64(bearing[x, 0]), np.float64(bearing[x, 1])
        ra, rb = np.float64(rho_a[x]), np.float64(rho_b[x])
        r = 0.5 * (ra + rb)
        au, av = way_to(a_end, a, b, rb, fx, fy)
        bu, bv = way_to(b_start, a, b, ra, fx, fy)
        ahu, ahv = way_to(a_middle, a, b, r, fx, fy)
        bhu, bhv = way_to(b_middle, a, b, r, fx, fy)
        path = path_through(au, av, bu, bv, ahu, ahv, bhu, bhv)
        for n in range(9):
            paths[n, x] = path[n]


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def path_of(x: int, y: int, geometry: Geometry) -> Path:
    """Where what a pixel sees at time s, from 0 to 1, lies in the first frame and in the second.

    In the first frame it lies at the pixel itself at s = 0, and at s = 1 where the surface that the
    second frame shows came from; in the second frame the other way round. Half-way the surface is
    taken for one in between. A parabola goes through the three.

    Returns:
        a and b by column and by row in the first frame, for s; the same in the second, for 1 - s;
        and the longer of the two ways, px.
    """
    (bearing, lens, ways), rho_a, rho_b, body_a, body_b = geometry
    a, b = np.float64(bearing[y, x, 0]), np.float64(bearing[y, x, 1])
    ra, rb = np.float64(rho_a[y, x]), np.float64(rho_b[y, x])
    here, there = ways[body_a[y, x]], ways[body_b[y, x]]
    au, av = carried(there[TO_FIRST_END], a, b, rb, lens)
    bu, bv = carried(here[TO_SECOND_START], a, b, ra, lens)
    if body_a[y, x] == body_b[y, x]:
        ra = rb = 0.5 * (ra + rb)
    ahu, ahv = carried(here[TO_FIRST_MIDDLE], a, b, ra, lens)
    bhu, bhv = carried(here[TO_SECOND_MIDDLE], a, b, ra, lens)
    if body_a[y, x] != body_b[y, x]:
        u, v = carried(there[TO_FIRST_MIDDLE], a, b, rb, lens)
        ahu, ahv = 0.5 * (ahu + u), 0.5 * (ahv + v)
        u, v = carried(there[TO_SECOND_MIDDLE], a, b, rb, lens)
        bhu, bhv = 0.5 * (bhu + u), 0.5 * (bhv + v)
    return path_through(au - x, av - y, bu - x, bv - y, ahu - x, ahv - y, bhu - x, bhv - y)  # type: ignore[no-any-return]


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def paths_of_row(
    y: int, pixels: NDArray[np.int64], geometry: Geometry, paths: NDArray[np.float64]
) -> None:
    """Fills the paths of some pixels of a row, or of all of them where that is faster.

    Args:
        y: row.
        pixels: (n,) columns.
        geometry: of all pixels.
        paths: out, (9, W), what `path_of` returns.
    """
    (bearing, lens, ways), rho_a, rho_b, body_a, body_b = geometry
    if int(lens[4]) == PINHOLE and not (body_a[y].any() or body_b[y].any()):
        straight_paths(bearing[y], rho_a[y], rho_b[y], ways[0], lens, paths)
    else:
        for x in pixels:
            path = path_of(x, y, geometry)
            for n in range(len(path)):
                paths[n, x] = path[n]


@numba.njit(cache=True, nogil=True, inline="always")
def places_on(
    x: float, y: float, paths: NDArray[np.floating], k: int, s: float
) -> tuple[float, float, float, float]:
    """Column and row in the first frame and in the second of what pixel (x, y) sees at time s.

    Args:
        x: column.
        y: row.
        paths: (9, W) of `paths_of_row`.
        k: the pixel's column there.
        s: time, 0 at the first frame and 1 at the second.
    """
    t = 1.0 - s
    u_a = fused(s, fused(s, paths[1, k], paths[0, k]), x)
    v_a = fused(s, fused(s, paths[3, k], paths[2, k]), y)
    u_b = fused(t, fused(t, paths[5, k], paths[4, k]), x)
    v_b = fused(t, fused(t, paths[7, k], paths[6, k]), y)
    return u_a, v_a, u_b, v_b


@numba.njit(cache=True, nogil=True)
def longest_way(geometry: Geometry, paths: NDArray[np.float32]) -> float:
    """Fills `paths` (H, 9, W) with those of all rows; returns the longest way, px."""
    height, width = geometry.rho_a.shape
    pixels, row = np.arange(width), np.empty((9, width))
    longest = 0.0
    for y in range(height):
        paths_of_row(y, pixels, geometry, row)
        for x in range(width):
            longest = max(longest, row[8, x])
            for n in range(9):
                paths[y, n, x] = row[n, x]
    return longest


@numba.njit(cache=True, nogil=True, **NO_ARRAYS)
def fill_picture(
    light_a: NDArray[np.float32],
    light_b: NDArray[np.float32],
    paths: NDArray[np.float32],
    grid: int,
    border: int,
    share: float,
    picture: NDArray[np.float32],
) -> None:
    """Fills `picture` (H, W) with what all pixels see at time `share` between two frames.

    Args:
        light_a: light on the grid of the first frame.
        light_b: light on the grid of the second.
        paths: (H, 9, W) of `longest_way`.
        grid: nodes per pixel and axis.
        border: pixels between the grid's first node and the sensor's.
        share: 0 at the first frame, 1 at the second.
        picture: out.
    """
    height, width = picture.shape
    back = 1.0 - share
    for y in range(height):
        for x in range(width):
            u_a, v_a, u_b, v_b = places_on(x, y, paths[y], x, share)
            before = light_at(light_a, grid * (u_a + border), grid * (v_a + border))
            behind = light_at(light_b, grid * (u_b + border), grid * (v_b + border))
            picture[y, x] = back * before + share * behind


@numba.njit(cache=True, nogil=True)
def fill_places(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    share: NDArray[np.float64],
    geometry: Geometry,
    places: NDArray[np.int32],
) -> None:
    """Fills `places` (N, 4): column and row in the first frame, and in the second, nearest pixels.

    Args:
        x: (N,) columns at the times `share`.
        y: (N,) rows.
        share: (N,) 0 at the first frame, 1 at the second.
        geometry: of all pixels.
        places: out; within the sensor.
    """
    height, width = geometry.rho_a.shape
    alone = np.empty((9, 1))
    for n in range(len(x)):
        i, j = int(y[n]), int(x[n])
        path = path_of(j, i, geometry)
        for m in range(len(path)):
            alone[m, 0] = path[m]
        u_a, v_a, u_b, v_b = places_on(j, i, alone, 0, share[n])
        places[n, 0] = min(max(int(np.rint(u_a)), 0), width - 1)
        places[n, 1] = min(max(int(np.rint(v_a)), 0), height - 1)
        places[n, 2] = min(max(int(np.rint(u_b)), 0), width - 1)
        places[n, 3] = min(max(int(np.rint(v_b)), 0), height - 1)
