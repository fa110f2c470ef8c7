"""The compiled loop of the voting, and the machine operations that numba has no words for."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit
from numba.core import cgutils, types
from numba.extending import intrinsic

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.emvs.utils.vectors_kernels import WIDTH, address

# A thousand rays (16 kB) stay in L1 while every plane of the pass reads them again.
CHUNK = 1024
# Votes that miss the image go here: spread, so that none waits for the store before it.
DUMP_CELLS = 512
_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_SPREAD = np.int32(DUMP_CELLS - 1)  # a mask: DUMP_CELLS is a power of 2
_INT8, _INT32 = ir.IntType(8), ir.IntType(32)
_PAIR = ir.VectorType(ir.FloatType(), 2)


def grid_cells(width_px: int, height_px: int) -> int:
    """Returns the length of a scratch plane: the image, the dump and a row below the dump.

    A whole number of vectors: where one plane begins at a vector's border, all of them do.
    """
    cells = width_px * height_px + DUMP_CELLS + width_px + 2
    return -(-cells // WIDTH) * WIDTH


# These loops run over whole arrays from 0: an offset in the index keeps them from being vectorised,
# for numba then looks for negative indices, and they cost four times as much.


@njit(cache=True, nogil=True)
def _locate(a_u, b_u, a_v, b_v, rho, width, height, cell, fx, fy):
    """Upper left cell and fractions of rays in plane `rho`; returns how many lie inside."""
    u_end, v_end = np.float32(width - 1), np.float32(height - 1)
    columns, dump = np.int32(width), np.int32(width * height)
    inside = np.int32(0)
    for k in range(len(a_u)):
        u = a_u[k] + rho * b_u[k]
        v = a_v[k] + rho * b_v[k]
        ok = (u >= _ZERO) & (v >= _ZERO) & (u < u_end) & (v < v_end)
        u = u if ok else _ZERO  # also keeps NaN and infinity away from the integer cast
        v = v if ok else _ZERO
        column, row = np.int32(u), np.int32(v)
        cell[k] = row * columns + column if ok else dump + (np.int32(2 * k) & _SPREAD)
        fx[k] = u - np.float32(column)
        fy[k] = v - np.float32(row)
        inside += np.int32(ok)
    return inside


@njit(cache=True, nogil=True)
def _locate_nearest(a_u, b_u, a_v, b_v, rho, width, height, cell):
    """Nearest cell of rays in plane `rho`; inside is what it is for `_locate`."""
    u_end, v_end = np.float32(width - 1), np.float32(height - 1)
    columns, dump = np.int32(width), np.int32(width * height)
    inside = np.int32(0)
    for k in range(len(a_u)):
        u = a_u[k] + rho * b_u[k]
        v = a_v[k] + rho * b_v[k]
        ok = (u >= _ZERO) & (v >= _ZERO) & (u < u_end) & (v < v_end)
        u = u if ok else _ZERO
        v = v if ok else _ZERO
        column, row = np.int32(u + _HALF), np.int32(v + _HALF)
        cell[k] = row * columns + column if ok else dump + (np.int32(2 * k) & _SPREAD)
        inside += np.int32(ok)
    return inside


@njit(cache=True, nogil=True)
def _dump_behind(c_z, rho, width, height, cell):
    """Redirects rays whose point lies behind their camera; returns (hidden, all) of them."""
    dump = np.int32(width * height)
    hidden = behind = np.int32(0)
    for k in range(len(c_z)):
        is_behind = _ONE - c_z[k] * rho <= _ZERO
        behind += np.int32(is_behind)
        hidden += np.int32(is_behind & (cell[k] < dump))
        cell[k] = max(cell[k], dump) if is_behind else cell[k]
    return hidden, behind


@njit(cache=True, nogil=True)
def _scatter(cell, fx, fy, n, width, grid):
    for k in range(n):
        upper = np.int64(cell[k])
        right, down = fx[k], fy[k]
        left, up = _ONE - right, _ONE - down
        add_pair(grid, upper, left * up, right * up)
        add_pair(grid, upper + width, left * down, right * down)


@njit(cache=True, nogil=True)
def _scatter_nearest(cell, n, grid):
    for k in range(n):
        grid[cell[k]] += _ONE


@njit(cache=True, nogil=True)
def _prefetch_rays(a_u, b_u, a_v, b_v, lo):
    for k in range(lo, min(lo + CHUNK, len(a_u)), 16):
        prefetch(a_u, k)
        prefetch(b_u, k)
        prefetch(a_v, k)
        prefetch(b_v, k)


@njit(cache=True, nogil=True)
def vote(
    start, stop, a_u, b_u, a_v, b_v, c_z, c_z_max, rho, size, per_pass, nearest, cell, fx, fy,
    grids, inside, behind,
):  # fmt: skip
    """Votes of one camera's rays in planes `rho`; a thread owns `per_pass` planes.

    Several planes per pass over the rays: the stream of rays (16 B each) costs as much as the
    votes where a plane fits in the cache. The next chunk is fetched while this one votes, because
    the scattered stores keep the hardware from seeing the stream.

    Arrays:
        start, stop: the passes to cast here, of all.
        a_u, b_u, a_v, b_v, c_z: (N,) float32, the rays.
        c_z_max: (ceil(N / CHUNK),) float32, the largest `c_z` of each chunk.
        rho: (P,) float32 planes, 1/m.
        size: (width, height) px.
        per_pass: planes per thread and pass.
        nearest: whether a ray votes in one cell, and not bilinearly in four.
        cell, fx, fy: (passes, CHUNK) scratch: int32, float32, float32.
        grids: (P, grid_cells) float32, filled: the votes, then the dump.
        inside, behind: (P,) int64, filled: votes counted, votes behind their camera.
    """
    width, height = size
    for task in range(start, stop):
        first = task * per_pass
        last = min(first + per_pass, len(rho))
        grids[first:last] = _ZERO
        inside[first:last] = 0
        behind[first:last] = 0
        for chunk in range(len(c_z_max)):
            lo, hi = chunk * CHUNK, min((chunk + 1) * CHUNK, len(a_u))
            au, bu, av, bv, cz = a_u[lo:hi], b_u[lo:hi], a_v[lo:hi], b_v[lo:hi], c_z[lo:hi]
            for p in range(first, last):
                if nearest:
                    inside[p] += _locate_nearest(au, bu, av, bv, rho[p], width, height, cell[task])
                else:
                    inside[p] += _locate(
                        au, bu, av, bv, rho[p], width, height, cell[task], fx[task], fy[task]
                    )
                if _ONE - c_z_max[chunk] * rho[p] <= _ZERO:
                    hidden, all_behind = _dump_behind(cz, rho[p], width, height, cell[task])
                    inside[p] -= hidden
                    behind[p] += all_behind
                if p == first:
                    _prefetch_rays(a_u, b_u, a_v, b_v, lo + CHUNK)
                if nearest:
                    _scatter_nearest(cell[task], hi - lo, grids[p])
                else:
                    _scatter(cell[task], fx[task], fy[task], hi - lo, width, grids[p])


@intrinsic
def add_pair(_typing: Any, grid: Any, cell: Any, first: Any, second: Any) -> Any:
    """Adds `first, second` to `grid[cell], grid[cell + 1]` by one 64-bit load, add and store.

    `grid` is a contiguous 1-D float32 array; nothing is checked. Each lane rounds as the scalar
    addition does, so results equal two scalar additions bit for bit.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid_, cell_, first_, second_ = args
        pointer = address(context, builder, signature.args[0], grid_, cell_, _PAIR)
        pair = ir.Constant(_PAIR, ir.Undefined)
        pair = builder.insert_element(pair, first_, _INT32(0))
        pair = builder.insert_element(pair, second_, _INT32(1))
        # 4 bytes: a vote begins at any cell
        old = builder.load(pointer, align=4)
        builder.store(builder.fadd(old, pair), pointer, align=4)
        return context.get_dummy_value()

    return types.void(grid, cell, first, second), codegen


@intrinsic
def prefetch(_typing: Any, array: Any, index: Any) -> Any:
    """Asks the cache for the line of `array[index]`, which need not exist."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = address(context, builder, signature.args[0], *args, _INT8)
        kind = ir.FunctionType(ir.VoidType(), [_INT8.as_pointer(), _INT32, _INT32, _INT32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        read, keep, data = _INT32(0), _INT32(3), _INT32(1)
        builder.call(function, [pointer, read, keep, data])
        return context.get_dummy_value()

    return types.void(array, index), codegen
