r"""Assembled coefficients of the compiled time stepping.

State :math:`x = (q, \dot q, z, x_s, \dot x_s, J)`: internal states of laws, then displacements
and velocities of supports and integrals of measured forces (`boundary`), which are not free;
:math:`\dot x = A x + B_u u + B_y y` with one column of :math:`B_u` for each input and of
:math:`B_y` for each force of a law and each rate of an internal state.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from slowtime.dynamics.channels import IMPOSED_KINDS
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Friction, Kind, Law
from slowtime.dynamics.effects.compilation import ROUND, law_address
from slowtime.dynamics.elements import ROTATION

from .boundary import boundary_rows, law_shares, prescribed_friction
from .kernel import RADAU, padded_count
from .matrices import Triple, along, rows_of
from .parameter_names import Name
from .step_levels import levels_of, product

Stack = Float[np.ndarray, "slope _ _"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """What of a plant does not depend on parameter values: laws, inputs and states.

    Parameters
    ----------
    table
        Effects with laws as in `kernel.System`.
    acting
        Their numbers among all effects.
    channels
        Number of forces of laws and rates of internal states.
    law_names
        Names of the parameters of laws, in the order of `p`.
    seeing
        H: observations that laws take from the state [observation, state].
    directions
        By effect with a law, the row of coordinates it works along, with the sign with which
        its force works there.
    forced
        By input, the row of coordinates that a force acts on; None for a motion.
    supports
        By input, the number of the support or driven node that it moves; None for others.
    still
        Numbers of the supports that stand still in space.
    shares
        Of the laws' channels in measured forces.
    free
        How many states are free at the first sample; the others follow from inputs.
    inertial
        Internal states that follow a speed in space, which a motion of the base is part of.
    """

    table: Int[np.ndarray, "effect 6"]
    acting: tuple[int, ...]
    channels: int
    law_names: tuple[Name, ...]
    seeing: Float[np.ndarray, "seen state"]
    directions: tuple[Float[np.ndarray, " coordinate"], ...]
    forced: tuple[Float[np.ndarray, " coordinate"] | None, ...]
    supports: tuple[int | None, ...]
    shares: Float[np.ndarray, "gauge channel"]
    free: int
    inertial: tuple[int, ...] = ()
    still: tuple[int, ...] = ()

    @property
    def apart(self) -> tuple[int, ...]:
        """Numbers of the supports that do not go with the base."""
        return (*(number for number in self.supports if number is not None), *self.still)

    @property
    def states(self) -> int:
        """How many states there are."""
        return int(self.seeing.shape[1])

    @property
    def support_states(self) -> int:
        """How many of them are displacements and velocities of supports."""
        return self.states - self.free - len(self.shares)


def layout_of(
    description: Description,
    effects: Sequence[Effect],
    kinds: Sequence[Kind],
    names: Sequence[str],
) -> Layout:
    """Place the laws of effects among the states."""
    free, moved = len(names), len(description.moved)
    place = rows_of(description, free)
    apart = prescribed_friction(description, effects, kinds)
    acting = [
        i
        for i, kind in enumerate(kinds)
        if isinstance(kind.action, Law | Friction) and i not in apart
    ]
    inside = 2 * free + sum(_internal(kinds[i]) for i in acting)
    measured = sum(sensor.quantity == "force" for sensor in description.sensors)
    states = inside + 2 * moved + measured
    table, directions = [], []
    channels = 0
    law_names: list[Name] = []
    inertial: list[int] = []
    seeing: list[Float[np.ndarray, " state"]] = []
    next_state = 2 * free
    for i in acting:
        action, inner = kinds[i].action, _internal(kinds[i])
        row = along(description, effects[i], place, free + 1 + moved)
        row, outer = row[:free], row[free + 1 :]
        table.append(
            [
                isinstance(action, Friction),
                channels,
                len(seeing),
                inner,
                len(law_names),
                len(kinds[i].names),
            ]
        )
        channels += 1 + inner
        law_names += [("effect", i, name) for name in kinds[i].names]
        for first, behind in ((0, inside), (free, inside + moved)):
            seen = np.zeros(states)
            seen[first : first + free], seen[behind : behind + moved] = row, outer
            seeing.append(seen)
        if isinstance(action, Law) and action.along is not None:
            inertial += range(next_state, next_state + inner)
        for _ in range(inner):
            seeing.append(np.eye(states)[next_state])
            next_state += 1
        directions.append(-row if effects[i].place.kind == "element" else row)
    forced = tuple(
        _force_row(entry.node, place, free) if entry.kind == "force" and entry.node else None
        for entry in description.inputs
    )
    forces = [(i, int(row[1])) for i, row in zip(acting, table, strict=True)]
    return Layout(
        table=np.array(table, dtype=np.int64).reshape(-1, 6),
        acting=tuple(acting),
        channels=channels,
        law_names=tuple(law_names),
        seeing=np.array(seeing).reshape(-1, states),
        directions=tuple(directions),
        forced=forced,
        supports=tuple(
            description.moved.index(entry.node) if entry.kind in IMPOSED_KINDS else None
            for entry in description.inputs
        ),
        shares=law_shares(description, effects, forces, channels),
        free=inside,
        inertial=tuple(inertial),
        still=tuple(
            description.moved.index(one.id) for one in description.supports if one.still
        ),
    )


def addresses_of(layout: Layout, kinds: Sequence[Kind]) -> Int[np.ndarray, " channel"]:
    """Load the machine code of all laws into this process."""
    # An address holds in one process only, so that it is no part of a layout.
    found: list[int] = []
    for i in layout.acting:
        action = kinds[i].action
        if isinstance(action, Friction):
            found.append(law_address(action.limit))
        elif isinstance(action, Law):
            found += [law_address(law) for law in (action.force, *action.rates)]
    return np.array(found, dtype=np.int64)


def state_matrices(
    layout: Layout, names: Sequence[str], triples: Sequence[Triple], *, unmeasured: bool
) -> tuple[Stack, Stack, Stack]:
    """Compute A, B of inputs and B of forces, each followed by its slopes.

    Triples are mass, damping and stiffness, then their slopes. With `unmeasured`, one more
    input stands for a motion of the base.
    """
    free = len(names)
    whole = np.array(triples)
    mass, damping, stiffness = (whole[:, k, :free, :free] for k in range(3))
    inverse = np.linalg.inv(mass[:1])
    inverted = np.concatenate([inverse, -inverse @ mass[1:] @ inverse])
    carried = np.array([not name.endswith(ROTATION) for name in names], dtype=float)
    base = -(mass @ carried + whole[:, 0, :free, free])
    moved = layout.support_states // 2
    outer = slice(free + 1, free + 1 + moved)
    carried_along = [free + 1 + k for k in range(moved) if k not in layout.apart]
    # Those that no input moves go with the base; the others' acceleration is against it.
    base -= whole[:, 0, :free, carried_along].sum(0)
    fixed = np.zeros((len(whole), free))
    columns = []
    more = (None,) if unmeasured else ()
    supports = (*layout.supports, *more)
    for row, support in zip((*layout.forced, *more), supports, strict=True):
        fixed[0] = 0.0 if row is None else row
        if support is not None:
            columns.append(-whole[:, 0, :free, free + 1 + support])
        else:
            columns.append(base if row is None else fixed.copy())
    pushed = product(inverted, np.stack(columns, axis=2)) if columns else whole[:, 0, :free, :0]
    states = layout.states
    a, b_u = (
        np.zeros((len(whole), states, states)),
        np.zeros((len(whole), states, len(columns))),
    )
    a[0, :free, free : 2 * free] = np.eye(free)
    a[:, free : 2 * free, :free] = -product(inverted, stiffness)
    a[:, free : 2 * free, free : 2 * free] = -product(inverted, damping)
    at = layout.free
    for k, first in ((2, at), (1, at + moved)):
        a[:, free : 2 * free, first : first + moved] = -product(
            inverted, whole[:, k, :free, outer]
        )
    b_u[:, free : 2 * free] = pushed
    b_y = np.zeros((len(whole), states, layout.channels))
    for row, direction in zip(layout.table, layout.directions, strict=True):
        b_y[:, free : 2 * free, row[1]] = inverted @ direction
        for k in range(row[3]):
            b_y[0, :, row[1] + 1 + k] = layout.seeing[row[2] + 2 + k]
    shaken = [
        row is None and support is None
        for row, support in zip((*layout.forced, *more), supports, strict=True)
    ]
    # Such a state lags behind the speed in space by as much as behind that against the base.
    for state in layout.inertial:
        b_u[0, state, shaken] = -1.0
    if states > at:
        against = np.zeros((moved, len(supports)))
        against[np.ix_(list(layout.apart), shaken)] = -1.0
        for column, support in enumerate(supports):
            if support is not None:
                against[support, column] = 1.0
        boundary_rows(a, b_u, b_y, whole, names, against, shaken, layout.shares)
    return a, b_u, b_y


def big_matrices(
    layout: Layout, a: Stack, b_u: Stack, b_y: Stack, interval: float, powers: int
) -> tuple[Float[np.ndarray, "level row column"], Float[np.ndarray, "level column spread"]]:
    """Lay out the steps of every level as in `kernel.System`.

    Gives matrices of the steps, and their slopes to linear parameters.
    """
    deep = layout.channels > 0
    inputs, channels = b_u.shape[2], b_y.shape[2]
    steps = levels_of(
        a,
        np.concatenate([b_u, b_y], axis=2),
        interval,
        max(powers, 3 if deep else 1),
        deep=deep,
    )
    states, seen = a.shape[1], layout.seeing
    count, points = steps.pushed.shape[:2]
    fractions = np.array(RADAU)[:, None] ** np.arange(steps.pushed.shape[4])
    scaled = steps.pushed * fractions[:, None, None, :, None]
    parabolas = np.linalg.inv(np.array(RADAU)[:, None] ** np.arange(3))
    shape = (count, points, len(a), states)
    own = np.concatenate(
        [
            steps.kept,
            scaled[..., :powers, :inputs].swapaxes(4, 5).reshape(*shape, inputs * powers),
            scaled[..., :3, inputs:].reshape(*shape, 3 * channels)
            @ np.kron(parabolas, np.eye(channels)),
        ],
        axis=4,
    )
    ahead = np.moveaxis(seen @ own, 1, 2).reshape(count, len(a), -1, own.shape[4])
    big = np.concatenate([own[:, 2], ahead], axis=2)
    return np.ascontiguousarray(big[:, 0]), slopes_by_column(big[:, 1:])


def turned(
    matrices: Float[np.ndarray, "*level row column"],
) -> Float[np.ndarray, "*level column longer"]:
    """Transpose matrices, and pad their rows so that a round may begin at any of them."""
    *levels, rows, columns = matrices.shape
    found = np.zeros((*levels, columns, padded_count(rows) + ROUND))
    found[..., :rows] = np.swapaxes(matrices, -1, -2)
    return found


def slopes_by_column(
    slopes: Float[np.ndarray, "*level linear row column"],
) -> Float[np.ndarray, "*level column spread"]:
    """Lay out the slopes of matrices by column, as in `kernel.System`.

    There is one row for each column of the matrices, padded with zeros.
    """
    *levels, linear, rows, columns = slopes.shape
    found = np.zeros((*levels, columns, rows, padded_count(linear)))
    found[..., :linear] = np.moveaxis(slopes, (-3, -1), (-1, -3))
    return found.reshape(*levels, columns, -1)


def _internal(kind: Kind) -> int:
    return len(kind.action.rates) if isinstance(kind.action, Law) else 0


def _force_row(
    node: str, place: Mapping[str, int | None], free: int
) -> Float[np.ndarray, " coordinate"]:
    found, row = np.zeros(free), place[node]
    # A node that is held takes a force without moving.
    if row is not None and row < free:
        found[row] = 1.0
    return found
