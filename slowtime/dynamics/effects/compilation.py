"""Compilation of scalar laws to machine code, cached on disk.

Nothing is compiled when a module is imported. Where no folder can be written, neither that of
the package nor the user's own (NUMBA_CACHE_DIR names another), code is compiled anew each time.
"""

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ParamSpec, TypeVar, cast

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

P = ParamSpec("P")
R = TypeVar("R")

Scalar = Callable[[float, float, float, Any, Any], float]
"""A law: elongation e, its rate v, time t, internal states z[i], parameters p[i] in; one
number out."""

_REAL = types.float64
_OPTIONS: Mapping[str, Any] = {"error_model": "numpy", "_nrt": False}
ROUND = 8
"""Numbers that `sum_rows` takes at a time."""
BLOCK = 4
"""Rows that `sum_block` takes at a time: their sums and one column fit the vector registers."""
_POINTER = types.CPointer(types.float64)
_SIGNATURE = _REAL(_REAL, _REAL, _REAL, _POINTER, _POINTER)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function, which makes no arrays, when it is first called."""
    # Without the bookkeeping that arrays of its own would take, it compiles twice as fast.
    # Checkers of array shapes wrap functions in Python, which machine code cannot call.
    return cast(Callable[P, R], _cached(inspect.unwrap(function), _OPTIONS))


def _cached(plain: Callable[..., Any], options: Mapping[str, Any]) -> Any:
    try:
        return numba.njit(cache=True, **options)(plain)
    except RuntimeError:  # no folder to keep the code in
        return numba.njit(**options)(plain)


class Routines:
    """Compiled functions that call each other by address, each compiled once by itself.

    Numba copies a function into every one that calls it, and optimizes and translates each copy
    again. Of functions that call each other over several levels, that is most of the time that
    compiling takes.

    Parameters
    ----------
    first_row
        Row of the table of memory that holds the address of the first of them; the others
        follow in the order in which they are defined. The table is the first argument of each
        routine, and the address is the first entry of the row.
    """

    def __init__(self, first_row: int) -> None:
        self._first_row = first_row
        self._found: list[tuple[Any, Any, bool]] = []

    def define(
        self, signature: Any, *, rare: bool = False
    ) -> Callable[[Callable[P, R]], Callable[P, R]]:
        """Make a routine of a function; only compiled code can call it.

        `signature` holds the types of what it returns and takes. With `rare`, it is not
        compiled where a run has no use for rare ones.
        """

        def decorate(function: Callable[P, R]) -> Callable[P, R]:
            row = self._first_row + len(self._found)
            options = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
            plain = inspect.unwrap(function)
            self._found.append((_cached(plain, options), signature, rare))
            return cast(Callable[P, R], _call_by_row(plain, row, signature))

        return decorate

    def __len__(self) -> int:
        """Count the routines."""
        return len(self._found)

    def compile(self, number: int) -> bool:
        """Compile one of them; tell whether its code was on disk already."""
        function, signature, _ = self._found[number]
        function.compile(signature.args)
        return bool(function.stats.cache_hits)

    @functools.cache  # noqa: B019  # there is one such object for each module
    def addresses(self, *, rare: bool) -> Sequence[int]:
        """Compile the routines, and tell where their machine code stands in memory.

        Those that are rare have the address 0 where they are not needed.
        """
        return tuple(
            0 if is_rare and not rare else _native_address(function, signature)
            for function, signature, is_rare in self._found
        )


def _native_address(function: Any, signature: Any) -> int:
    function.compile(signature.args)
    made = function.overloads[signature.args]
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


def _call_by_row(function: Callable[..., Any], row: int, signature: Any) -> Any:
    """Make what compiled code calls in place of a function: the code at an address in a row."""

    def call(typing_context: Any, store: Any, *others: Any) -> Any:
        def generate(context: Any, builder: Any, used: Any, arguments: Any) -> Any:
            table = context.make_array(used.args[0])(context, builder, arguments[0])
            at = builder.mul(builder.extract_value(table.shape, 1), _constant(row))
            address = builder.load(builder.gep(table.data, [at]))
            convention = context.call_conv
            shape = convention.get_function_type(signature.return_type, signature.args)
            code = builder.inttoptr(address, shape.as_pointer())
            status, found = convention.call_function(
                builder, code, signature.return_type, signature.args, arguments
            )
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return found

        return signature, generate

    names = list(inspect.signature(function).parameters.values())
    context = inspect.Parameter("typing_context", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    plain = [name.replace(annotation=inspect.Parameter.empty) for name in names]
    call.__signature__ = inspect.Signature([context, *plain])  # type: ignore[attr-defined]
    call.__name__ = function.__name__
    return intrinsic(call)


@functools.cache
def law_address(law: Scalar) -> int:
    """Where the machine code of a law stands in memory, for `call_law`.

    Raises `ValueError` if it cannot be compiled: a law may use numbers, `math` and other
    compiled functions.
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


def view_of(kind: Any, axes: int) -> Any:
    """Make the compiled function (table, row) to the array that stands in memory there."""

    # A row of the table is (address, lengths of the axes); the array is contiguous.
    def view(typing_context: Any, table: Any, row: Any) -> Any:
        array = types.Array(kind, axes, "C")

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            rows = context.make_array(signature.args[0])(context, builder, arguments[0])
            width = builder.extract_value(rows.shape, 1)
            first = builder.mul(context.cast(builder, arguments[1], row, types.int64), width)
            found = [
                builder.load(builder.gep(rows.data, [builder.add(first, _constant(k))]))
                for k in range(1 + axes)
            ]
            size = context.get_abi_sizeof(context.get_value_type(kind))
            strides = [_constant(size)]
            for length in found[:1:-1]:
                strides.insert(0, builder.mul(strides[0], length))
            made = context.make_array(array)(context, builder)
            data = builder.inttoptr(found[0], made.data.type)
            populate_array(made, data, found[1:], strides, _constant(size), None)
            return made._getvalue()

        return array(table, row), generate

    return intrinsic(view)


def _sum_rows(
    typing_context: Any,
    found: Any,
    start: Any,
    shares: Any,
    count: Any,
    rows: Any,
    width: Any,
) -> Any:
    whole, real = types.int64, ir.DoubleType()
    several = ir.VectorType(real, ROUND)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found, start, shares, count, rows, width = arguments

        def place(address: Any, kind: Any) -> Any:
            return builder.inttoptr(address, ir.PointerType(kind))

        total = cgutils.alloca_once(builder, several)
        builder.store(builder.load(place(start, several), align=8), total)
        step = builder.mul(width, _constant(8))
        with cgutils.for_range(builder, count) as loop:
            at = builder.add(shares, builder.mul(loop.index, _constant(8)))
            share = builder.load(place(at, real), align=8)
            first = builder.insert_element(ir.Constant(several, ir.Undefined), share, _lane(0))
            every = ir.Constant(ir.VectorType(ir.IntType(32), ROUND), [0] * ROUND)
            alike = builder.shuffle_vector(first, ir.Constant(several, ir.Undefined), every)
            at = builder.add(rows, builder.mul(loop.index, step))
            more = builder.fmul(alike, builder.load(place(at, several), align=8))
            builder.store(builder.fadd(builder.load(total), more), total)
        builder.store(builder.load(total), place(found, several), align=8)
        return context.get_dummy_value()

    return types.none(whole, whole, whole, whole, whole, whole), generate


sum_rows: Any = intrinsic(inspect.unwrap(_sum_rows))
"""In compiled code, sum a round of columns: (found, start, shares, count, rows, width).

Found are `ROUND` numbers: those at `start`, and `count` rows, each times its share. All but
`count` and `width`, by how many numbers rows are apart, are addresses. Written out by vectors,
since the compiler makes none of a loop that may be as short as this.
"""


def _sum_block(
    typing_context: Any,
    found: Any,
    found_step: Any,
    start: Any,
    start_step: Any,
    shares: Any,
    shares_step: Any,
    count: Any,
    rows: Any,
    width: Any,
) -> Any:
    whole, real = types.int64, ir.DoubleType()
    several = ir.VectorType(real, ROUND)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found, found_step, start, start_step, shares, shares_step, count, rows, width = (
            arguments
        )

        def place(address: Any, kind: Any) -> Any:
            return builder.inttoptr(address, ir.PointerType(kind))

        def row(address: Any, step: Any, number: int) -> Any:
            return builder.add(address, builder.mul(step, _constant(8 * number)))

        totals = [cgutils.alloca_once(builder, several) for _ in range(BLOCK)]
        for k, total in enumerate(totals):
            begin = place(row(start, start_step, k), several)
            builder.store(builder.load(begin, align=8), total)
        step = builder.mul(width, _constant(8))
        none = ir.Constant(several, ir.Undefined)
        every = ir.Constant(ir.VectorType(ir.IntType(32), ROUND), [0] * ROUND)
        with cgutils.for_range(builder, count) as loop:
            at = builder.add(rows, builder.mul(loop.index, step))
            column = builder.load(place(at, several), align=8)
            offset = builder.mul(loop.index, _constant(8))
            for k, total in enumerate(totals):
                at = builder.add(row(shares, shares_step, k), offset)
                share = builder.load(place(at, real), align=8)
                first = builder.insert_element(none, share, _lane(0))
                more = builder.fmul(builder.shuffle_vector(first, none, every), column)
                builder.store(builder.fadd(builder.load(total), more), total)
        for k, total in enumerate(totals):
            end = place(row(found, found_step, k), several)
            builder.store(builder.load(total), end, align=8)
        return context.get_dummy_value()

    return types.none(*[whole] * 9), generate


sum_block: Any = intrinsic(inspect.unwrap(_sum_block))
"""In compiled code, sum a round of columns for `BLOCK` rows of shares at once.

Arguments are (found, found_step, start, start_step, shares, shares_step, count, rows, width).
Each row is what `sum_rows` finds, to the last bit; the steps say by how many numbers rows are
apart. Each number of `rows` is loaded once for all, and sums do not wait for each other.
"""


def _lane(number: int) -> Any:
    return ir.Constant(ir.IntType(32), number)


def _constant(number: int) -> Any:
    return ir.Constant(ir.IntType(64), number)
