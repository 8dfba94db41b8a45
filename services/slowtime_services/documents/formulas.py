"""Formulas in text → syntax trees, of numbers that a floating-point number can hold."""

import ast
import math
import warnings

MOST_CHARACTERS = 4000
"""Characters of a formula at most [1]."""

MOST_LEVELS = 60
"""Operations within each other at most [1]; trees are walked by recursion."""


class FormulaError(ValueError):
    """A text that is no formula; the text says why, and not what is allowed."""


def formula_tree(text: str) -> ast.expr:
    """Parse a formula without running anything of it.

    Raises
    ------
    FormulaError
        Where it is none, too long or too deep, or has a number that no float holds.

    Examples
    --------
    >>> ast.unparse(formula_tree("a+ 2*b"))
    'a + 2 * b'
    """
    if len(text) > MOST_CHARACTERS:
        raise FormulaError(
            f"A formula of {len(text):,} characters is too long. Allowed: {MOST_CHARACTERS:,}."
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of what is tolerated now, such as `1if`
            tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, SyntaxWarning, ValueError, RecursionError, MemoryError):
        raise FormulaError(f"{text[:80]!r} is not a valid formula.") from None
    _refuse_beyond(tree)
    return tree


def _refuse_beyond(tree: ast.expr) -> None:
    level: list[ast.AST] = [tree]
    for _ in range(MOST_LEVELS + 1):
        for node in level:
            if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
                _refuse_infinite(node.value)
        level = [
            inner
            for node in level
            for inner in ast.iter_child_nodes(node)
            if isinstance(inner, ast.expr)
        ]
        if not level:
            return
    raise FormulaError(f"A formula is nested deeper than {MOST_LEVELS}.")


def _refuse_infinite(value: float) -> None:
    try:
        finite = math.isfinite(float(value))
    except OverflowError:  # an integer of more than 308 digits
        finite = False
    if not finite:
        raise FormulaError("A number in a formula is larger than 1.8e308, the largest number.")
