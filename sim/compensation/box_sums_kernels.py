"""Sums over the samples of a pixel-sized box, a vector of columns at a time: compiled.

Which samples show a layer cannot be foreseen: a branch for each costs more than all sums. These are
taken in one order on every processor: down the columns, then halves of them onto each other.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)
from eventsweep.sim.compensation.edge_reach_kernels import Seen
from eventsweep.sim.compensation.path_kernels import FAST, NO_ARRAYS

_LANES = 16  # columns at a time
_FLOAT, _INDEX, _PLACE = ir.FloatType(), ir.IntType(64), ir.IntType(32)
_FLOATS, _INDICES = ir.VectorType(_FLOAT, _LANES), ir.VectorType(_INDEX, _LANES)


def _everywhere(builder: Any, number: Any, kind: Any) -> Any:
    """A vector of one number in every lane."""
    none, first = ir.Constant(kind, ir.Undefined), ir.Constant(_PLACE, 0)
    all_first = ir.Constant(ir.VectorType(_PLACE, _LANES), None)
    return builder.shuffle_vector(builder.insert_element(none, number, first), none, all_first)


def _total(builder: Any, lanes: Any) -> Any:
    """The sum of a vector: its upper half onto its lower one until one number is left."""
    width = _LANES // 2
    while width:
        kind = ir.VectorType(_PLACE, width)
        halves = ([*range(width)], [*range(width, 2 * width)])
        low, high = (
            builder.shuffle_vector(lanes, lanes, ir.Constant(kind, half)) for half in halves
        )
        lanes, width = builder.fadd(low, high), width // 2
    return builder.extract_element(lanes, ir.Constant(_PLACE, 0))


def _weights(builder: Any, first: Any, last: Any, share: Any, one: Any) -> Any:
    """By lane, how much of a column is in the box that ends in those two columns."""
    lane = ir.Constant(_INDICES, [*range(_LANES)])
    first, last = (_everywhere(builder, end, _INDICES) for end in (first, last))
    after = builder.icmp_signed(">=", lane, first)
    inside = builder.and_(after, builder.icmp_signed("<=", lane, last))
    weights = builder.select(inside, _everywhere(builder, one, _FLOATS), ir.Constant(_FLOATS, None))
    for end, weight in ((first, builder.fsub(one, share)), (last, share)):
        at_end = builder.icmp_signed("==", lane, end)
        weights = builder.select(at_end, _everywhere(builder, weight, _FLOATS), weights)
    return weights


def _strip(
    _typing: Any, depths: Any, lights: Any, _i: Any, _j: Any, _n: Any, _first: Any, _fu: Any,
    _fv: Any, _least: Any, _most: Any,
) -> Any:  # fmt: skip
    """Sums over some rows and `_LANES` columns of both images; the rest as in `box_sums`.

    `_i` and `_j` are that place; the box begins `_first` columns from the first lane.
    """
    found = types.UniTuple(types.float32, 4)  # type: ignore[no-untyped-call]
    place, share = types.intp, types.float32

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        images = [
            context.make_array(kind)(context, builder, image)
            for kind, image in zip(signature.args[:2], args[:2], strict=True)
        ]
        i, j, n, first, fu, fv, least, most = args[2:]
        zero, one = ir.Constant(_FLOATS, None), ir.Constant(_FLOAT, 1.0)
        weights = _weights(builder, first, builder.add(first, n), fu, one)
        least, most = (_everywhere(builder, bound, _FLOATS) for bound in (least, most))
        kind = ir.FunctionType(_FLOATS, [_FLOATS] * 3)
        fused = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{_LANES}f32")  # type: ignore[no-untyped-call]
        sums = [cgutils.alloca_once_value(builder, zero) for _ in range(4)]  # type: ignore[no-untyped-call]
        columns = builder.extract_value(images[0].shape, 1)
        with cgutils.for_range(builder, builder.add(n, n.type(1))) as loop:
            at = builder.add(builder.mul(builder.add(i, loop.index), columns), j)
            depth, light = (
                builder.load(
                    builder.bitcast(builder.gep(image.data, [at]), _FLOATS.as_pointer()), align=4
                )
                for image in images
            )
            last = builder.icmp_signed("==", loop.index, n)
            across = builder.select(last, fv, one)
            top = builder.icmp_signed("==", loop.index, n.type(0))
            across = builder.select(top, builder.fsub(one, fv), across)
            weight = builder.fmul(weights, _everywhere(builder, across, _FLOATS))
            behind = builder.fcmp_ordered("<=", depth, least)
            beyond = builder.select(behind, weight, zero)
            on = builder.select(builder.fcmp_ordered("<=", depth, most), weight, zero)
            on = builder.select(behind, zero, on)
            for total, term in zip(sums, (on, beyond, light, depth), strict=True):
                so_far = builder.load(total)
                if term in (light, depth):
                    builder.store(builder.call(fused, [on, term, so_far]), total)
                else:
                    builder.store(builder.fadd(so_far, term), total)
        totals = [_total(builder, builder.load(total)) for total in sums]
        return context.make_tuple(builder, signature.return_type, totals)

    arguments = depths, lights, place, place, place, place, share, share, share, share
    return found(*arguments), codegen


_strip_sums: Any = intrinsic(_strip)


@numba.njit(cache=True, nogil=True, fastmath=FAST, forceinline=True, **NO_ARRAYS)
def box_sums(
    frame: Seen, n: int, u: float, v: float, over: float, under: float
) -> tuple[float, float, float, float]:
    """What the samples of a box say of a layer: `sim.compensation.layer_kernels.proof`.

    Args:
        frame: its samples.
        n: samples per pixel and axis.
        u: the box's left edge, samples from the border's.
        v: its upper edge.
        over: samples nearer than this inverse depth hide the layer.
        under: samples no nearer than this lie beyond it.
    """
    j, i = int(u), int(v)
    fu, fv = np.float32(u - j), np.float32(v - i)
    least, most = np.float32(under), np.float32(over)
    rows, columns = frame.rho.shape
    # Lanes reach beyond the box, where nothing weighs, but not beyond the last sample of all.
    strips = n // _LANES + 1
    begin = j + min((rows - i - n) * columns - j - strips * _LANES, 0)
    on, beyond, total, depth = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for strip in range(strips):
        left = begin + strip * _LANES
        some = _strip_sums(frame.rho, frame.light, i, left, n, j - left, fu, fv, least, most)
        on, beyond = on + some[0], beyond + some[1]
        total, depth = total + some[2], depth + some[3]
    share = np.float32(1) / np.float32(n * n)
    return float(on * share), float(beyond * share), float(total * share), float(depth * share)
