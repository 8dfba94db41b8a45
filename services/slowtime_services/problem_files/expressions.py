"""Formulas in text → functions of arrays, without executing any code of their author.

A formula is parsed to a syntax tree, of which names, numbers, the usual operators, comparisons
within `where`, and the functions of `FUNCTIONS` are allowed.
"""

import ast
import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from slowtime_services.documents.formulas import FormulaError, formula_tree

Value: TypeAlias = "float | np.ndarray"
CONSTANTS = {"pi": float(np.pi), "e": float(np.e)}


def _least(*values: Value) -> Value:
    return functools.reduce(np.minimum, values)


def _largest(*values: Value) -> Value:
    return functools.reduce(np.maximum, values)


FUNCTIONS: dict[str, tuple[Callable[..., Any], int, int]] = {
    **{
        name: (getattr(np, name), 1, 1)
        for name in (
            "sqrt", "exp", "log", "log10", "sin", "cos", "tan", "arcsin", "arccos", "arctan",
            "sinh", "cosh", "tanh", "abs", "sign",
        )
    },
    "min": (_least, 2, 1000),
    "max": (_largest, 2, 1000),
    "hypot": (np.hypot, 2, 2),
    "where": (np.where, 3, 3),
}  # fmt: skip
"""Name → function, fewest and most arguments."""

_OPERATIONS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
ALLOWED = (
    "Allowed: names of inputs, numbers, + - * / **, brackets, pi, e, and "
    f"{', '.join(FUNCTIONS)}; comparisons only as in where(a < b, c, d)."
)


class ExpressionError(ValueError):
    """A formula that is none, or more than is allowed of one."""


class Expression:
    """A formula of named inputs, called with points [sample input].

    Raises
    ------
    ExpressionError
        Saying what is wrong and what is allowed.

    Examples
    --------
    >>> Expression("r - 2 * sqrt(s)", ("r", "s"))(np.array([[5.0, 4.0]]))
    array([1.])
    """

    def __init__(self, text: str, names: Sequence[str]) -> None:
        try:
            self._tree = formula_tree(text)
        except FormulaError as error:
            raise ExpressionError(f"{error} {ALLOWED} Else give a Python file.") from None
        self.text, self.names = text, tuple(names)
        self._check(self._tree)
        self._refuse_infinite()

    @property
    def used(self) -> frozenset[str]:
        """Names of inputs that the formula uses."""
        spoken = {node.id for node in ast.walk(self._tree) if isinstance(node, ast.Name)}
        return frozenset(spoken & {*self.names})

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Value at each point [sample]."""
        columns = dict(zip(self.names, x.T, strict=True))
        with np.errstate(all="ignore"):
            value = np.asarray(_value(self._tree, columns), dtype=float)
        return np.broadcast_to(value, (len(x),)).copy()

    def _check(self, node: ast.AST, *, condition: bool = False) -> None:
        match node:
            case ast.Constant(value=bool() | complex()):
                pass
            case ast.Constant(value=int() | float()):
                return
            case ast.Name(id=name):
                if name in self.names or name in CONSTANTS:
                    return
                raise ExpressionError(
                    f"{name!r} is not an input. Inputs: {', '.join(self.names)}. {ALLOWED}"
                )
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATIONS:
                return self._check(operand)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
                self._check(left)
                return self._check(right)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if (
                condition and type(op) in _OPERATIONS
            ):
                self._check(left)
                return self._check(right)
            case ast.Call(func=ast.Name(id=name), args=given, keywords=[]):
                return self._check_call(name, given)
        raise ExpressionError(f"{ast.unparse(node)[:80]!r} is not allowed. {ALLOWED}")

    def _refuse_infinite(self) -> None:
        """Refuse operations on numbers alone whose value is none, such as 9**9**9."""
        for node in ast.walk(self._tree):
            alone = isinstance(node, ast.BinOp) and not any(
                isinstance(part, ast.Name) and part.id in self.names for part in ast.walk(node)
            )
            with np.errstate(all="ignore"):
                if alone and not np.isfinite(_value(node, {})):
                    raise ExpressionError(
                        f"{ast.unparse(node)[:80]!r} is not a finite number. {ALLOWED}"
                    )

    def _check_call(self, name: str, given: list[ast.expr]) -> None:
        if name not in FUNCTIONS:
            raise ExpressionError(f"{name!r} is not a valid function. {ALLOWED}")
        _, fewest, most = FUNCTIONS[name]
        if not fewest <= len(given) <= most:
            wanted = str(fewest) if fewest == most else f"{fewest} to {most}"
            raise ExpressionError(f"{name} takes {wanted} arguments, not {len(given)}.")
        for place, argument in enumerate(given):
            self._check(argument, condition=name == "where" and place == 0)


def _value(node: ast.AST, columns: dict[str, np.ndarray]) -> Any:
    match node:
        case ast.Constant(value=value):
            return float(value)  # type: ignore[arg-type]  # `_check` let numbers through alone
        case ast.Name(id=name):
            return columns[name] if name in columns else CONSTANTS[name]
        case ast.UnaryOp(op=op, operand=operand):
            return _OPERATIONS[type(op)](_value(operand, columns))
        case ast.BinOp(left=left, op=op, right=right):
            return _OPERATIONS[type(op)](_value(left, columns), _value(right, columns))
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return _OPERATIONS[type(op)](_value(left, columns), _value(right, columns))
        case ast.Call(func=ast.Name(id=name), args=given):
            return FUNCTIONS[name][0](*(_value(argument, columns) for argument in given))
    raise ExpressionError(f"{ast.unparse(node)[:80]!r} is not allowed. {ALLOWED}")
