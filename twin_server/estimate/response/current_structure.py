"""Estimates the current structure of a twin from its states and the laws of its forecast."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from pydantic_core import from_json
from scipy.linalg import eigh

from slowtime.dynamics.description import Description, assemble
from slowtime.evolution.predicted_response.scenario import ParameterBelief
from slowtime.evolution.structures import ParametricStructure
from slowtime_schemas.messages import Features
from slowtime_services.models import description_of
from twin_server.estimate.checkpoint import Checkpoint
from twin_server.estimate.elements import posterior_of
from twin_server.history.details import Bodies
from twin_server.history.states import States, assumed, sentences
from twin_server.registration.twin import Registration

RECENT = 20
"""Epochs whose damping is averaged."""

FAR = 3.5
"""Standard deviations by which the last reading may be off what those before it say."""

ALONE = "mass"
"""The node of a twin of one mode without a model."""

_LEAST = 1e-4
"""Damping ratio below which none is taken to be claimed or measured [1]."""

_RIGID = 1e-10
"""Square of a frequency over the greatest one below which a motion is rigid [1]; the same as in
`ParametricStructure.modes`."""


class UnknownStructureError(ValueError):
    """Too little is known of a twin to simulate it; the text says what to do."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CurrentStructure:
    """Current structure of a twin, with its uncertainty.

    Parameters
    ----------
    slow_time
        Of the last state.
    believed
        The structure, and how well it is known.
    changes
        Mean and standard deviation of each change that is estimated.
    has_mass
        Whether a force has a meaning.
    description
        The model with its effects, where it has any: it is not linear then.
    scale
        What the stiffness of `description` is multiplied by to be where the twin was learnt,
        by element; masses likewise by node and `.mass`.
    parts
        Installed parts that hold kinds of effect beside the catalogue's.
    reasons, assumed
        What stands against the answer; and what was taken for granted.
    """

    slow_time: float
    believed: ParameterBelief
    changes: Mapping[str, tuple[float, float]]
    has_mass: bool = True
    description: Description | None = None
    scale: Mapping[str, float] = dataclasses.field(default_factory=dict)
    parts: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()


Beliefs = Mapping[str, tuple[float, float]]
"""Of each change, mean and sd now, given all readings (`foresight.now_of`)."""


def current_structure_of(
    registration: Registration,
    checkpoint: Checkpoint,
    states: States,
    bodies: Bodies,
    now: Beliefs,
    last: Features | None,
) -> CurrentStructure:
    """Estimate the current structure of a twin.

    Parameters
    ----------
    states, bodies
        The newest of them, in order.
    last
        The features of the newest state, which tell how the errors of elements hang together.

    Raises
    ------
    UnknownTodayError
        Where the twin is still being learnt, or its damping is not known.
    """
    if not len(states):
        raise UnknownStructureError("There are no features yet. Start the edge agent.")
    if checkpoint.elements is not None:
        return _of_elements(registration, checkpoint, states, bodies, now, last)
    return _of_one_mode(registration, checkpoint, states, now)


def _of_one_mode(
    registration: Registration, checkpoint: Checkpoint, states: States, now: Beliefs
) -> CurrentStructure:
    known = checkpoint.known
    if known is None:
        raise UnknownStructureError(
            "The nominal model is still being learnt from the first epochs. Wait, or give it "
            "in the registration."
        )
    valid = states[states["reasons"] == 0]
    changes, doubts = {}, []
    names = ("stiffness_change", "mass_change")
    free = [name for name in names if name not in assumed(int(states["notes"][-1]))]
    for name in free:
        latest = _latest(valid[name]) if len(valid) else None
        changes[name], doubt = _settled(now.get(name), latest, name)
        doubts += doubt
    correlation = float(valid["correlation"][-1]) if len(valid) and len(free) == 2 else 0.0
    theta, covariance = _in_logs([changes.get(name, (0.0, 0.0)) for name in names], correlation)
    whole, description, has_mass, own = _nominal(registration, known.frequency_hz)
    damping = _average(valid["damping_ratio"][-RECENT:, :2])
    said = []
    if damping is None:
        if not checkpoint.has_damping:
            raise UnknownStructureError(
                "No damping ratio of this twin is known. Give nominal.damping_ratio in its "
                "registration, such as 0.02, or find out why its edge agent sends none."
            )
        damping = known.damping_ratio, known.damping_ratio * known.damping_relative_sd
        said.append("damping as nominal")
    log, log_sd = _logs([damping if one is None else one for one in own])
    believed = ParameterBelief(
        structure=whole[0],
        theta=theta,
        covariance=covariance,
        log_damping=log,
        log_damping_sd=log_sd,
        influence=whole[1],
        base_mass=whole[2],
    )
    said += [f"{name} is none" for name in names if name not in free]
    if registration.model is not None:
        said.append("all elements change alike")
    return CurrentStructure(
        slow_time=float(states["slow_time"][-1]),
        believed=believed,
        changes=changes,
        has_mass=has_mass,
        description=description if description is not None and description.effects else None,
        scale={} if description is None else _alike(description, whole[3]),
        reasons=(*_against(states), *doubts),
        assumed=(*said, *_always(registration)),
    )


_Whole = tuple[
    ParametricStructure,
    Float[np.ndarray, " dof"] | None,
    Float[np.ndarray, " dof"] | None,
    float,
]


def _nominal(
    registration: Registration, frequency_hz: float
) -> tuple[_Whole, Description | None, bool, list[tuple[float, float] | None]]:
    """Matrices that change as a whole, and the damping ratios that a model claims."""
    names = {"element_names": ("stiffness_change",), "node_names": ("mass_change",)}
    if registration.model is None:
        physical = registration.nominal
        given = None if physical is None else physical.mass_kg
        mass = np.array([[1.0 if given is None else given]])
        stiffness = mass * (2.0 * math.pi * frequency_hz) ** 2
        one = ParametricStructure(
            mass=mass, stiffness=stiffness, stiffness_parts=stiffness[None],
            mass_parts=mass[None], dof_names=(ALONE,), **names,
        )  # fmt: skip
        return (one, np.ones(1), None, 1.0), None, given is not None, [None]
    description = description_of(registration.model)
    built = assemble(description)
    squares, ratios, rigid = _modes(built.mass, built.stiffness, built.damping)
    mode = min(registration.mode + rigid, len(squares) - 1)
    factor = float((2.0 * math.pi * frequency_hz) ** 2 / squares[mode])
    stiffness = factor * built.stiffness
    one = ParametricStructure(
        mass=built.mass, stiffness=stiffness, stiffness_parts=stiffness[None],
        mass_parts=built.mass[None], dof_names=built.names, **names,
    )  # fmt: skip
    claimed = registration.model.tolerance
    share = 0.5 if claimed is None else claimed.damping
    own = [(z, share * z) if z > _LEAST else None for z in ratios.tolist()]
    own[mode] = None
    return (one, built.influence, built.base_mass, factor), description, True, own


def _of_elements(
    registration: Registration,
    checkpoint: Checkpoint,
    states: States,
    bodies: Bodies,
    now: Beliefs,
    last: Features | None,
) -> CurrentStructure:
    memory, model = checkpoint.elements, registration.structure()
    assert memory is not None
    assert registration.model is not None
    rows = [row for row in np.flatnonzero(states["reasons"] == 0).tolist() if bodies[row]]
    if not memory.knows or not rows:
        raise UnknownStructureError(
            "The model is still being learnt from the first epochs, or none of the latest "
            "was valid. Wait, or look at the reasons of the states."
        )
    told = [from_json(bodies[row] or b"") for row in rows[-RECENT:]]
    changes, doubts = {}, []
    for name in model.free:
        one = told[-1]["elements"][name]
        changes[name], doubt = _settled(now.get(name), (one["value"], one["sd"]), name)
        doubts += doubt
    theta, covariance = _in_logs(list(changes.values()), 0.0)
    epoch = None
    if last is not None:
        epoch = posterior_of(memory, model, last, registration.covariates)
    if epoch is not None:
        own = np.sqrt(np.diag(epoch))
        sds = np.sqrt(np.diag(covariance))
        covariance = epoch / np.outer(own, own) * np.outer(sds, sds)
    description = description_of(registration.model)
    built = assemble(description)
    structure = model.at(memory.theta)
    _, ratios, rigid = _modes(built.mass, built.stiffness, built.damping)
    of_modes = [None] * rigid + _dampings(told, structure.size - rigid)
    measured = [one for one in of_modes if one is not None]
    claimed = [(z, 0.5 * z) if z > _LEAST else None for z in ratios.tolist()]
    if not measured and None in claimed:
        raise UnknownStructureError(
            "No damping ratio was identified, and the model has none. Give its elements "
            "damping_n_s_per_m."
        )
    common = _average(np.array(measured)) if measured else None
    each = [
        seen or own_claim or common for seen, own_claim in zip(of_modes, claimed, strict=True)
    ]
    log, log_sd = _logs([one for one in each if one is not None])
    factors = np.exp(np.array(memory.theta)).tolist()
    return CurrentStructure(
        slow_time=float(states["slow_time"][-1]),
        believed=ParameterBelief(
            structure=structure,
            theta=theta,
            covariance=covariance,
            log_damping=log,
            log_damping_sd=log_sd,
            influence=built.influence,
            base_mass=built.base_mass,
        ),
        changes=changes,
        description=description if description.effects else None,
        scale=dict(zip(model.whole.names, factors, strict=True)),
        reasons=(*_against(states), *doubts),
        assumed=_always(registration),
    )


def _against(states: States) -> tuple[str, ...]:
    """Return the sentences on why the last state is not valid."""
    return sentences(int(states["reasons"][-1]))


def _always(registration: Registration) -> tuple[str, ...]:
    linear = registration.model is None or not registration.model.effects
    said: tuple[str, ...] = ("the structure is linear",) if linear else ()
    if registration.covariates is not None:
        said += ("covariates are at their reference",)
    return said


def _latest(estimates: Float[np.ndarray, "time 4"]) -> tuple[float, float]:
    return float(estimates[-1, 0]), float(estimates[-1, 1])


def _settled(
    now: tuple[float, float] | None, latest: tuple[float, float] | None, name: str
) -> tuple[tuple[float, float], list[str]]:
    """Average all readings; return the last one if it differs strongly from those before."""
    if latest is None:
        if now is None:
            raise UnknownStructureError(
                f"None of the latest states has a valid {name}. Look at their reasons."
            )
        return now, []
    if now is None:
        return latest, ["There are few readings, so only the last one is used."]
    if abs(latest[0] - now[0]) > FAR * math.hypot(latest[1], now[1]):
        return latest, [
            f"The last reading of {name} differs strongly from those before it, so only the "
            "last one is used and none are averaged. Wait for more readings."
        ]
    return now, []


def _in_logs(
    changes: Sequence[tuple[float, float]], correlation: float
) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, "parameter parameter"]]:
    """Mean and covariance of logarithms of factors, out of those of changes."""
    values, sds = np.array(changes, dtype=float).T
    ratio = np.maximum(1.0 + values, 1e-3)
    own = sds / ratio
    covariance = np.diag(own**2)
    if len(own) == 2 and correlation:
        covariance[0, 1] = covariance[1, 0] = correlation * own[0] * own[1]
    return np.log(ratio), covariance


def _average(readings: Float[np.ndarray, "reading 2"]) -> tuple[float, float] | None:
    """Weighted mean of values with sds; it scatters as much as its readings do."""
    value, sd = readings.T
    known = np.isfinite(value) & (value > 0.0) & np.isfinite(sd) & (sd > 0.0)
    value, sd = value[known], sd[known]
    if not len(value):
        return None
    weight = sd**-2.0
    mean = float(weight @ value / weight.sum())
    spread = float(weight @ (value - mean) ** 2) / max(len(value) - 1, 1)
    return mean, math.sqrt(max(spread, 1.0) / float(weight.sum()))


def _dampings(
    told: Sequence[Mapping[str, object]], size: int
) -> list[tuple[float, float] | None]:
    """Damping ratio of each mode of the model, where it was identified of late."""
    found: list[list[tuple[float, float]]] = [[] for _ in range(size)]
    for body in told:
        for mode in body["modes"]:  # type: ignore[attr-defined]
            number, damping = mode["model_mode"], mode["damping_ratio"]
            if number is not None and damping is not None:
                found[number].append((damping["value"], damping["sd"]))
    return [_average(np.array(one)) if one else None for one in found]


def _logs(
    ratios: Sequence[tuple[float, float]],
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, " mode"]]:
    value, sd = np.array(ratios, dtype=float).T
    value = np.clip(value, _LEAST, 0.9)
    return np.log(value), np.minimum(sd / value, 1.0)


def _modes(
    mass: Float[np.ndarray, "dof dof"],
    stiffness: Float[np.ndarray, "dof dof"],
    damping: Float[np.ndarray, "dof dof"],
) -> tuple[Float[np.ndarray, " mode"], Float[np.ndarray, " mode"], int]:
    """Squares of angular frequencies, damping ratios as a model has them, rigid motions."""
    squares, shapes = eigh(stiffness, mass)
    rigid = int((squares <= _RIGID * squares[-1]).sum())
    twice = np.einsum("ij,ik,kj->j", shapes, damping, shapes)
    omega = np.sqrt(np.maximum(squares, _RIGID * squares[-1]))
    return squares, np.where(np.arange(len(squares)) < rigid, 0.0, 0.5 * twice / omega), rigid


def _alike(description: Description, factor: float) -> dict[str, float]:
    """Scale each element's stiffness by the same factor."""
    return {element.id: factor for element in description.elements}
