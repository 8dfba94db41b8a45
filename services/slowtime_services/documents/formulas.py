"""Formulas in text → syntax trees, of numbers that a floating-point number can hold."""

import ast
import math
import warnings

MOST_CHARACTERS = 4000
"""Characters of a formula at most [1]."""

MOST_LEVELS = 60
"""Operations within each other at most [1]; trees are walked by recursion."""

MOST_TERMS = 1000
"""Terms of a sum at most [1], as many as `min` and `max` take."""


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

    A sum of many terms is no deep formula; its terms are added in pairs.

    >>> total = formula_tree(" + ".join(f"x{k}" for k in range(200)))
    >>> len([node for node in ast.walk(total) if isinstance(node, ast.Name)])
    200
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
    if _is_deep(tree):
        tree = _in_pairs(tree)
        if _is_deep(tree):
            raise FormulaError(f"A formula is nested deeper than {MOST_LEVELS}.")
    return tree


def _in_pairs(tree: ast.expr) -> ast.expr:
    """Add the terms of a sum in pairs, those with a minus apart: as deep as their logarithm."""
    added: list[ast.expr] = []
    taken: list[ast.expr] = []
    while isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub):
        (added if isinstance(tree.op, ast.Add) else taken).append(tree.right)
        tree = tree.left
    terms = 1 + len(added) + len(taken)
    if terms > MOST_TERMS:
        raise FormulaError(
            f"A formula adds {terms:,} terms, which are too many. Allowed: {MOST_TERMS:,}."
        )
    total = _total([tree, *reversed(added)])
    return ast.BinOp(total, ast.Sub(), _total(taken[::-1])) if taken else total


def _total(terms: list[ast.expr]) -> ast.expr:
    while len(terms) > 1:
        pairs = zip(terms[::2], terms[1::2], strict=False)
        odd = terms[-1:] if len(terms) % 2 else []
        terms = [ast.BinOp(left, ast.Add(), right) for left, right in pairs] + odd
    return terms[0]


def _is_deep(tree: ast.expr) -> bool:
    """Whether operations are nested too deep; a number beyond all floats is refused."""
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
            return False
    return True


def _refuse_infinite(value: float) -> None:
    try:
        finite = math.isfinite(float(value))
    except OverflowError:  # an integer of more than 308 digits
        finite = False
    if not finite:
        raise FormulaError("A number in a formula is larger than 1.8e308, the largest number.")
