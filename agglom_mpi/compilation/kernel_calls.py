"""What a kernel calls outside of itself: other kernels by their address, and clocks of the system.

A kernel that calls another one by its name is linked with a copy of it, which is optimised and
emitted once more. By its address it calls the machine code that is there, so that both can be
compiled at once, by two processes.
"""

import hashlib
import time
from collections.abc import Callable
from typing import Any, Final

import numba
import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from agglom_mpi.compilation.kernels import runs_compiled
from agglom_mpi.compilation.stages import inlined

CALLEE: Final = np.dtype([("address", "i8"), ("signature", "i8")])
"""A kernel that another one calls: where its machine code is, and the digest of its types."""

_MISMATCH: Final = "a kernel was given the machine code of another one"


_RESULTS: Final[dict[Any, Any]] = {bool: types.boolean, float: types.float64, None: types.none}


def kernel_call(kernel: Callable[..., Any], returns: type | None) -> Any:
    """Return the function by which kernels call another one, for a tuple of its arguments.

    Its first argument is a record of `CALLEE`, from `callee_of` for arguments of the same types.

    Parameters
    ----------
    kernel
        The kernel that is called.
    returns
        What it returns: `bool`, `float` or None.
    """
    result = _RESULTS[returns]
    if not runs_compiled():
        return lambda callee, arguments: kernel(*arguments)

    def call(typing_context: Any, callee: Any, arguments: Any) -> Any:
        passed: Any = arguments

        def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return _lower_call(context, builder, result, signature.args, values)

        return result(callee, passed), lower

    return intrinsic(call)


def _lower_call(context: Any, builder: Any, result: Any, kinds: Any, values: Any) -> Any:
    """Compare the digest of the types, and call the machine code at the address."""
    from llvmlite import ir

    callee, arguments = kinds
    address, signature = (
        _field(context, builder, callee, values[0], name) for name in ("address", "signature")
    )
    known = ir.Constant(signature.type, _digest(arguments.types))
    with cgutils.if_unlikely(builder, builder.icmp_signed("!=", signature, known)):
        context.call_conv.return_user_exc(builder, RuntimeError, (_MISMATCH,))
    kind = context.call_conv.get_function_type(result, arguments.types)
    passed = cgutils.unpack_tuple(builder, values[1], len(arguments.types))
    status, returned = context.call_conv.call_function(
        builder, builder.inttoptr(address, kind.as_pointer()), result, arguments.types, passed
    )
    with cgutils.if_unlikely(builder, status.is_error):
        context.call_conv.return_status_propagate(builder, status)
    return returned


def _field(context: Any, builder: Any, record: Any, value: Any, name: str) -> Any:
    """Return a field of a record, an integer of 64 bits."""
    address = cgutils.get_record_member(
        builder, value, record.offset(name), context.get_data_type(types.int64)
    )
    return context.unpack_value(builder, types.int64, address)


def callee_of(kernel: Any, arguments: tuple[Any, ...]) -> Any:
    """Return the `CALLEE`, shape (), of a kernel for arguments like these; compile it if needed."""
    callee = np.zeros((), CALLEE)
    if not runs_compiled():
        return callee
    kinds = tuple(numba.typeof(argument) for argument in arguments)
    kernel.compile(kinds)
    found = kernel.overloads[kinds]
    callee["address"] = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
    callee["signature"] = _digest(kinds)
    if not callee["address"]:
        raise RuntimeError(f"the machine code of {kernel.__name__} has no address")
    return callee


def _digest(kinds: Any) -> int:
    """Return a digest of types of arguments, 63 bits."""
    text = " ".join(str(types.unliteral(kind)) for kind in kinds)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little") >> 1


CLOCKS: Final = np.array(
    [time.CLOCK_MONOTONIC, time.CLOCK_THREAD_CPUTIME_ID, time.CLOCK_REALTIME], np.int32
)
"""The system's numbers of `WALL`, `PROCESSOR` and `DATE`."""

WALL: Final = 0
PROCESSOR: Final = 1
DATE: Final = 2
"""Clocks: that of `time.monotonic`, that of `time.thread_time`, that of `time.time`."""

_clock_gettime: Final = types.ExternalFunction(
    "clock_gettime", types.int32(types.int32, types.uintp)
)


@inlined
def _read(clock: Any, timespec: Any) -> Any:
    """Read a clock of the system in s; `timespec` is room for its answer, shape (2,) of int64."""
    _clock_gettime(clock, timespec.ctypes.data)
    return timespec[0] + 1e-9 * timespec[1]


def _read_in_python(clock: Any, timespec: Any) -> float:
    return time.clock_gettime(int(clock))


read_clock: Final[Any] = _read if runs_compiled() else _read_in_python
"""Read one of `CLOCKS` in s; `timespec` is room for the system's answer, shape (2,) of int64."""
