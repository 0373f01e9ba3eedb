"""A call of compiled code by its address: kernels that are compiled once step any dynamics compiled later."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

__all__ = ["call"]


@intrinsic
def _call(typing_context: Any, address: Any, lanes: Any, n: Any) -> Any:  # noqa: ARG001
    """Call the C function `void(double *lanes, intp n)` at an address.

    Args:
        typing_context: Numba's own.
        address: Of a `numba.cfunc`, which has to be alive.
        lanes: [LANE_ROWS * LANES] float64, as `lanes` lays them out.
        n: Number of lanes to step.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        where, array, count = arguments
        data = context.make_array(signature.args[1])(context, builder, array).data
        kind = ir.FunctionType(ir.VoidType(), [data.type, count.type])
        builder.call(builder.inttoptr(where, kind.as_pointer()), [data, count])
        return context.get_dummy_value()

    return types.void(types.intp, lanes, types.intp), generate


# What a kernel calls has other arguments than what makes the call.
call: Any = _call
