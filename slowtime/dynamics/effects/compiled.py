"""Scalar laws in, machine code out: compiled at first use, and kept on disk.

Nothing is compiled when a module is imported. Where no folder can be written, neither that of
the package nor the user's own (NUMBA_CACHE_DIR names another), code is compiled anew each time.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

P = ParamSpec("P")
R = TypeVar("R")

Scalar = Callable[[float, float, float, Any, Any], float]
"""A law: elongation e, its rate v, time t, internal states z[i], parameters p[i] in; one
number out."""

_REAL = types.float64
_POINTER = types.CPointer(types.float64)
_SIGNATURE = _REAL(_REAL, _REAL, _REAL, _POINTER, _POINTER)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function when it is first called."""
    # Checkers of array shapes wrap functions in Python, which machine code cannot call.
    plain = inspect.unwrap(function)
    try:
        return cast(Callable[P, R], numba.njit(cache=True, error_model="numpy")(plain))
    except RuntimeError:  # no folder to keep the code in
        return cast(Callable[P, R], numba.njit(error_model="numpy")(plain))


@functools.cache
def law_address(law: Scalar) -> int:
    """Where the machine code of a law stands in memory, for `call_law`.

    Raises
    ------
    ValueError
        If it cannot be compiled: a law may use numbers, `math` and other compiled functions.
    """
    return int(_code(inspect.unwrap(law)).address)


@functools.cache
def _code(law: Scalar) -> Any:
    try:
        return numba.cfunc(_SIGNATURE, cache=True, error_model="numpy")(law)
    except RuntimeError:
        return numba.cfunc(_SIGNATURE, error_model="numpy")(law)
    except numba.core.errors.NumbaError as error:
        last = str(error).strip().splitlines()[-1]
        raise ValueError(
            f"The law {law.__name__!r} cannot be compiled: {last} Write it with numbers, "
            "`math` and `if`; z[0], p[0] are the first internal state and parameter."
        ) from None


def _call_law(
    typing_context: Any, address: Any, e: Any, v: Any, t: Any, states: Any, parameters: Any
) -> Any:
    whole = types.int64

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        real, pointer = ir.DoubleType(), ir.PointerType(ir.DoubleType())
        shape = ir.FunctionType(real, [real, real, real, pointer, pointer])
        law = builder.inttoptr(arguments[0], ir.PointerType(shape))
        z, p = (builder.inttoptr(arguments[i], pointer) for i in (4, 5))
        return builder.call(law, [*arguments[1:4], z, p])

    return _REAL(whole, _REAL, _REAL, _REAL, whole, whole), generate


call_law: Any = intrinsic(inspect.unwrap(_call_law))
"""In compiled code, call the law at an address: (address, e, v, t, z, p), z and p addresses."""
