"""Cache of assembled systems, shared by runs with equal settings.

A fit simulates every record, and every segment of one, at the same values. Assembling a system
costs about as much as simulating a short record.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int

from slowtime.dynamics.effects import Kind, Law

from .kernel import KernelArrays
from .matrices import MatrixParts, Triple
from .parameter_names import Name
from .system import (
    Layout,
    addresses_of,
    big_matrices,
    slopes_by_column,
    state_matrices,
    turned,
)

KEPT = 4
"""Number of systems in the cache: with and without slopes, at two sampling rates."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings that a system depends on.

    Parameters
    ----------
    layout, matrices, kinds
        Of one plant; the first two distinguish plants.
    linear, laws
        Parameters to which slopes are computed: those of the matrices, and of laws.
    driven
        Parameters that change an input, and the column of that input.
    powers
        Number of coefficients of the polynomials that inputs are between samples.
    unmeasured
        Whether one more input stands for a motion of the base.
    """

    layout: Layout
    matrices: MatrixParts
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
        """Parameters to which slopes are computed, in the order of the compiled code."""
        return (*self.linear, *self.laws, *(name for name, _ in self.driven))


def is_linear(name: Name, matrices: MatrixParts) -> bool:
    """Return whether a parameter is one of the matrices."""
    return name[0] in ("stiffness", "damping", "mass") or (
        name[0] == "effect" and name[1] in matrices.hidden
    )


@functools.lru_cache(maxsize=KEPT)
def system_of(settings: Settings) -> KernelArrays:
    """Assemble a system, or return a cached one: a run leaves it unchanged."""
    # A run varies a parameter of a law while it differentiates it. No other run sees that:
    # compiled code holds the interpreter lock.
    layout, values, order = settings.layout, dict(settings.values), settings.order
    triples = _triples(settings, values)
    a, b_u, b_y = state_matrices(
        layout, settings.matrices.names, triples, unmeasured=settings.unmeasured
    )
    whole = np.concatenate([a, b_u, b_y], axis=2)
    big, slope_big = big_matrices(layout, a, b_u, b_y, settings.interval, settings.powers)
    jumps = [
        ("effect", i, name)
        for i, kind in enumerate(settings.kinds)
        if isinstance(kind.action, Law)
        for name in kind.action.switches
    ]

    def columns(names: Sequence[Name | None]) -> Int[np.ndarray, " name"]:
        found = [order.index(name) if name in order else -1 for name in names]
        return np.array(found, dtype=np.int64)

    # Central differences would step across an instant at which a law jumps.
    smooth = columns([None if name in jumps else name for name in layout.law_names])
    through = [(order.index(name), column) for name, column in settings.driven]
    return KernelArrays(
        effect_table=layout.table,
        laws=addresses_of(layout, settings.kinds),
        p=np.array([values[name] for name in layout.law_names]),
        parameter_slope=smooth,
        jump_times=np.array([values[name] for name in jumps]),
        jump_slopes=columns(jumps),
        driven_inputs=np.array(through, dtype=np.int64).reshape(-1, 2),
        observation=layout.seeing,
        rate_matrix=np.ascontiguousarray(whole[0]),
        rate_matrix_slopes=slopes_by_column(whole[1:]),
        step_matrices=big,
        step_matrix_slopes=slope_big,
        step_columns=turned(big),
        rate_columns=turned(whole[0]),
        observation_columns=turned(layout.seeing),
    )


def _triples(settings: Settings, values: Mapping[Name, float]) -> list[Triple]:
    """Mass, damping and stiffness, then their slopes."""
    kinds = list(settings.kinds)
    slopes = [settings.matrices.slope(name, values, kinds) for name in settings.linear]
    return [settings.matrices.at(values, kinds), *slopes]
