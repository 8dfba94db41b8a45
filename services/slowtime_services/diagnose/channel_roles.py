"""Which column of a record is which channel of a model, where their names differ.

A role is written as ``force = gtau*vir``: a channel of the model, and a sum, difference,
product or quotient of numbers, of columns and of single numbers that the record holds.
"""

import ast
import operator
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime_services.documents.formulas import FormulaError, formula_tree
from slowtime_services.files import Record, RecordError, find_column

Roles = Mapping[str, str]
"""Expression by channel of the model."""
Series = Float[np.ndarray, " time"]

LONGEST = 400
_OPERATIONS: Mapping[type[ast.AST], Callable[..., float | Series]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}


def roles_of(pairs: Sequence[str]) -> Roles:
    """Read roles as a person writes them.

    Examples
    --------
    >>> dict(roles_of(["force = gtau*vir", "x=qm"]))
    {'force': 'gtau*vir', 'x': 'qm'}
    """
    roles: dict[str, str] = {}
    for pair in pairs:
        channel, equals, said = (part.strip() for part in pair.partition("="))
        if not (channel and equals and said):
            raise RecordError(
                f"{pair!r} maps no channel. Write CHANNEL=COLUMN or CHANNEL=EXPRESSION, "
                "such as "
                "force=gtau*vir."
            )
        if channel in roles:
            raise RecordError(f"Channel {channel!r} is mapped twice. Map it once.")
        if len(said) > LONGEST:
            raise RecordError(
                f"The role of {channel!r} has {len(said)} characters. Give at most {LONGEST}."
            )
        roles[channel] = said
    return roles


def evaluate(said: str, record: Record, file: str) -> Series:
    """Compute an expression on the columns and single numbers of a record.

    Raises
    ------
    RecordError
        Where a name is not in the record, or the expression is none.
    """
    if said in record.channels:
        return np.asarray(record.channel(said), dtype=float)
    try:
        tree = formula_tree(said)
    except FormulaError:
        raise _refusal(said) from None
    with np.errstate(all="ignore"):
        value = np.asarray(_value(tree, record, said, file), dtype=float)
    return np.broadcast_to(value, (len(record.samples),)).copy()


def _value(node: ast.AST, record: Record, said: str, file: str) -> float | Series:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]  # the type was just asked for
    if isinstance(node, ast.Name | ast.Attribute):
        return _named(ast.unparse(node), record, file)
    if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATIONS:
        return _OPERATIONS[type(node.op)](_value(node.operand, record, said, file))
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
        left = _value(node.left, record, said, file)
        return _OPERATIONS[type(node.op)](left, _value(node.right, record, said, file))
    raise _refusal(said)


def _named(name: str, record: Record, file: str) -> float | Series:
    if name in record.channels:
        return np.asarray(record.channel(name), dtype=float)
    single = {key: value for key, value in record.aux.items() if np.size(value) == 1}
    if name in single:
        return float(np.ravel(single[name])[0])
    try:
        return np.asarray(record.samples[:, find_column(name, record.channels)], dtype=float)
    except RecordError:
        numbers = f"; single numbers: {', '.join(single)}" if single else ""
        raise RecordError(
            f"{file} holds nothing called {name!r}. It has the columns "
            f"{', '.join(record.channels)}{numbers}."
        ) from None


def _refusal(said: str) -> RecordError:
    return RecordError(
        f"{said!r} is neither a column nor an expression. Allowed: names of columns and "
        "of single "
        "numbers in the record, numbers, + - * / and brackets."
    )
