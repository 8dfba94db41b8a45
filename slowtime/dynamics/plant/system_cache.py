"""Cache of assembled systems, shared by runs with equal settings.

A fit runs every record, and every piece of one, at the same values; what the compiled steps
need costs about as much to make as a short record to run.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int

from slowtime.dynamics.effects import Kind, Law

from .kernel import System
from .matrices import Matrices, Triple
from .parameter_names import Name
from .system import Layout, big_matrices, slopes_by_column, state_matrices, turned

KEPT = 4
"""Systems that are kept: with and without slopes, at two sampling rates."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What a system hangs on.

    Parameters
    ----------
    layout, matrices, kinds
        Of one plant; told apart by the first two.
    values
        Of all parameters, by the order of the plant.
    linear, laws
        Parameters to which slopes are asked: those of the matrices, and of laws.
    driven
        Parameters that change an input, and the column of that input.
    interval
        Between samples [s].
    powers
        Of the polynomials that inputs are between samples.
    unmeasured
        Whether one more input stands for a motion of the base.
    """

    layout: Layout
    matrices: Matrices
    kinds: tuple[Kind, ...] = dataclasses.field(compare=False)
    values: tuple[tuple[Name, float], ...]
    linear: tuple[Name, ...]
    laws: tuple[Name, ...]
    driven: tuple[tuple[Name, int], ...]
    interval: float
    powers: int
    unmeasured: bool

    @property
    def order(self) -> tuple[Name, ...]:
        """Parameters to which slopes are asked, as the compiled code has them."""
        return (*self.linear, *self.laws, *(name for name, _ in self.driven))


def is_linear(name: Name, matrices: Matrices) -> bool:
    """Tell whether a parameter is one of the matrices."""
    return name[0] in ("stiffness", "damping", "mass") or (
        name[0] == "effect" and name[1] in matrices.hidden
    )


@functools.lru_cache(maxsize=KEPT)
def system_of(asked: Asked) -> System:
    """Make a system, or give one that was made: a run leaves all of it as it was.

    While it varies a parameter of a law to differentiate it, no other run goes on: compiled
    code holds the interpreter.
    """
    layout, values, order = asked.layout, dict(asked.values), asked.order
    triples = _triples(asked, values)
    a, b_u, b_y = state_matrices(
        layout, asked.matrices.names, triples, unmeasured=asked.unmeasured
    )
    whole = np.concatenate([a, b_u, b_y], axis=2)
    big, slope_big = big_matrices(layout, a, b_u, b_y, asked.interval, asked.powers)
    jumps = [
        ("effect", i, name)
        for i, kind in enumerate(asked.kinds)
        if isinstance(kind.action, Law)
        for name in kind.action.switches
    ]

    def columns(names: Sequence[Name | None]) -> Int[np.ndarray, " name"]:
        found = [order.index(name) if name in order else -1 for name in names]
        return np.array(found, dtype=np.int64)

    # Differences would step across an instant at which a law jumps.
    smooth = columns([None if name in jumps else name for name in layout.law_names])
    through = [(order.index(name), column) for name, column in asked.driven]
    return System(
        table=layout.table,
        laws=layout.laws,
        p=np.array([values[name] for name in layout.law_names]),
        column=smooth,
        jumps=np.array([values[name] for name in jumps]),
        jump_columns=columns(jumps),
        driven=np.array(through, dtype=np.int64).reshape(-1, 2),
        seeing=layout.seeing,
        matrix=np.ascontiguousarray(whole[0]),
        slope_matrix=slopes_by_column(whole[1:]),
        big=big,
        slope_big=slope_big,
        by_column=turned(big),
        matrix_by_column=turned(whole[0]),
        seeing_by_column=turned(layout.seeing),
    )


def _triples(asked: Asked, values: Mapping[Name, float]) -> list[Triple]:
    """Mass, damping and stiffness, then their slopes."""
    kinds = list(asked.kinds)
    slopes = [asked.matrices.slope(name, values, kinds) for name in asked.linear]
    return [asked.matrices.at(values, kinds), *slopes]
