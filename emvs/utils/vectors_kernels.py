"""A processor's vectors in compiled loops: as many float32 as a register holds.

The compiler makes vectors of plain loops, but one that keeps a dozen sums in registers while it
walks over many inputs it does not find. These are such a loop's words. Each number is rounded as a
scalar would be, so results do not depend on `WIDTH`.
"""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg, var-annotated"

import operator

import numba
import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)

_TOLD: str | None = numba.config.CPU_FEATURES  # type: ignore[attr-defined]
_FEATURES = get_host_cpu_features().flatten() if _TOLD is None else _TOLD
WIDTH = 16 if "+avx512f" in _FEATURES.split(",") else 8
"""Numbers in a vector. A longer one than the registers would take several, and there are few."""
_VECTOR = ir.VectorType(ir.FloatType(), WIDTH)


class Vector(types.Type):
    """Numba's type of a vector."""

    def __init__(self) -> None:
        super().__init__(name=f"float32 x {WIDTH}")


vector = Vector()


@register_model(Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, _VECTOR)


def address(context, builder, array_type, array, index, kind):
    """Where number `index` of a contiguous array lies, as a pointer to an LLVM type; unchecked."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), kind.as_pointer())


def everywhere(builder, number, kind):
    """An LLVM vector of one number in every place."""
    nothing, whole = ir.Constant(kind, ir.Undefined), ir.VectorType(ir.IntType(32), kind.count)
    one = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, nothing, ir.Constant(whole, None))


@intrinsic
def load(_typing, array, _index):
    """The vector that begins at that number of a contiguous 1-D float32 array; unchecked."""

    def codegen(context, builder, signature, args):
        place = address(context, builder, signature.args[0], *args, _VECTOR)
        return builder.load(place, align=4)

    return vector(array, types.intp), codegen


@intrinsic
def store(_typing, array, _index, value):
    """Writes a vector into such an array from a number on, likewise unchecked."""

    def codegen(context, builder, signature, args):
        place = address(context, builder, signature.args[0], *args[:2], _VECTOR)
        builder.store(args[2], place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), codegen


@intrinsic
def splat(_typing, _number):
    """A vector of one float32, in every place."""

    def codegen(_context, builder, _signature, args):
        return everywhere(builder, args[0], _VECTOR)

    return vector(types.float32), codegen


@intrinsic
def plus(_typing, total, one, other):
    """Total + one * other, rounded once, number by number."""

    def codegen(_context, builder, _signature, args):
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        fused = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{WIDTH}f32")
        return builder.call(fused, [args[1], args[2], args[0]])

    return vector(total, one, other), codegen


@intrinsic
def larger(_typing, one, other):
    """The larger one of two vectors' numbers, in every place."""

    def codegen(_context, builder, _signature, args):
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return vector(one, other), codegen


@njit(cache=True, nogil=True)
def aligned(count):
    """(count,) float32 zeros that begin where a vector may: one across two lines loads slowly."""
    whole = np.zeros(count + WIDTH, np.float32)
    past = (whole.ctypes.data // 4) % WIDTH
    return whole[WIDTH - past : WIDTH - past + count]


def _number_by_number(instruction):
    """A function of two vectors that is one instruction."""

    @intrinsic
    def each(_typing, one, other):
        def codegen(_context, builder, _signature, args):
            return getattr(builder, instruction)(*args)

        return vector(one, other), codegen

    def of_vectors(one, other):
        if one == vector and other == vector:
            return lambda one, other: each(one, other)
        return None  # for numba: these are none of ours

    return of_vectors


overload(operator.add)(_number_by_number("fadd"))
overload(operator.sub)(_number_by_number("fsub"))
overload(operator.mul)(_number_by_number("fmul"))
overload(operator.truediv)(_number_by_number("fdiv"))
