"""Two machine operations that numba has no words for: a 64-bit vote and a prefetch."""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_INT8, _INT32 = ir.IntType(8), ir.IntType(32)
_PAIR = ir.VectorType(ir.FloatType(), 2)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [index])


@intrinsic
def add_pair(_typing: Any, grid: Any, cell: Any, first: Any, second: Any) -> Any:
    """Adds `first, second` to `grid[cell], grid[cell + 1]` by one 64-bit load, add and store.

    `grid` is a contiguous 1-D float32 array; nothing is checked. Each lane rounds as the scalar
    addition does, so results equal two scalar additions bit for bit.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid_, cell_, first_, second_ = args
        address = _address(context, builder, signature.args[0], grid_, cell_)
        pointer = builder.bitcast(address, _PAIR.as_pointer())
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
        address = _address(context, builder, signature.args[0], *args)
        pointer = builder.bitcast(address, _INT8.as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [_INT8.as_pointer(), _INT32, _INT32, _INT32])
        function = cgutils.get_or_insert_function(  # type: ignore[no-untyped-call]
            builder.module, kind, "llvm.prefetch.p0"
        )
        read, keep, data = _INT32(0), _INT32(3), _INT32(1)
        builder.call(function, [pointer, read, keep, data])
        return context.get_dummy_value()

    return types.void(array, index), codegen
