"""Simulates the current structure of a twin under a load, with bands."""

import dataclasses
import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.special import ndtri

from slowtime.dynamics import loads
from slowtime.dynamics.description import BASE, Description, Input, Sensor, assemble
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.elements import ROTATION, Beam, Element, Matrix
from slowtime.evolution.predicted_response.scenario import (
    Bands,
    ParameterBelief,
    bands,
    response_runs,
)
from slowtime_services.models import description_of, run_model
from slowtime_services.plugins.effect_kinds import kinds_for
from twin_server.estimate.checkpoint import Checkpoint
from twin_server.orders import MOST_SAMPLES, SimulationOrder
from twin_server.registration.structure import MASS
from twin_server.registration.twin import Registration

from .current_structure import ALONE, CurrentStructure

MOST_KEPT = 8_000_000
"""Samples of all outputs in all draws of one simulation."""

MOST_MOVED = 50_000_000
"""Samples of all degrees of freedom in all draws."""

MOST_TOLD = 60_000
"""Samples of all outputs that are answered with."""

MOST_OF_EFFECTS = 400_000
"""Samples in all draws of a structure that is not linear, each of which takes longer."""

DRAWS, FEWEST_DRAWS = 400, 20
"""Structures that are drawn by default, and the fewest that give quantiles."""

_NEAR = 0.5
"""Part of its nominal frequency that a twin is taken to have kept, before it is looked at."""

FINE = 20
"""Samples a period, below which a load that is straight between them is not a cosine."""


class OrderError(ValueError):
    """A simulation that this twin cannot run; the text says what to do."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """Simulated response of a twin.

    Parameters
    ----------
    times, load
        Instants [s] and the load at them.
    outputs
        Nodes whose motion it is.
    bands
        Of that motion, one column an output.
    frequencies, dampings
        Of each mode: value, sd, lo and hi over the draws, [Hz] and [1].
    """

    times: Float[np.ndarray, " time"]
    rate_hz: float
    draws: int
    load: Float[np.ndarray, " time"]
    outputs: tuple[str, ...]
    bands: Bands
    frequencies: Float[np.ndarray, "mode 4"]
    dampings: Float[np.ndarray, "mode 4"]
    reasons: tuple[str, ...]


def simulate(today: CurrentStructure, order: SimulationOrder) -> Simulated:
    """Run today's twin under a load.

    The same order of the same twin gives the same answer, to the last bit.

    Raises
    ------
    OrderError
        Where a node is none of the twin's, a force has no meaning, or it would be too much.
    """
    believed = today.believed
    nodes = believed.structure.dof_names
    on = _place(nodes, today.has_mass, order.on)
    outputs = _outputs(nodes, order)
    lowest, highest = _range(believed)
    rate_hz, times = _instants(order, lowest, highest)
    draws = _draws(today, order, len(times), len(outputs))
    rng, of_load = (np.random.default_rng([order.seed, part]) for part in (0, 1))
    load = _load(order, times, rate_hz, of_load)
    reasons = list(today.reasons)
    if order.load.kind == "harmonic" and rate_hz < FINE * order.load.frequency_hz:
        reasons.append(
            f"The load has {rate_hz / order.load.frequency_hz:.3g} samples a period, straight "
            f"between them. Give a rate_hz of {FINE * order.load.frequency_hz:.6g} or more."
        )
    if rate_hz < 2.0 * highest:
        reasons.append(
            f"At {rate_hz:g} Hz the highest mode, of {highest:.4g} Hz, is not seen as it is. "
            "Give a higher rate_hz."
        )
    if today.description is None:
        runs = response_runs(
            believed, load, rate_hz, on=on, outputs=outputs, quantity=order.quantity,
            draws=draws, rng=rng,
        )  # fmt: skip
    else:
        runs = _with_effects(today, order, load, rate_hz, on, outputs, draws, rng)
    if not np.isfinite(runs).all():
        raise OrderError(
            "The motion grew beyond all bounds. Give a smaller load, or look at the model's "
            "effects."
        )
    again = np.random.default_rng([order.seed, 0])
    frequencies, dampings = _modes(believed, draws, order.level, again)
    return Simulated(
        times, rate_hz, draws, load, outputs, bands(runs, order.level), frequencies, dampings,
        tuple(reasons),
    )  # fmt: skip


def check(registration: Registration, checkpoint: Checkpoint, order: SimulationOrder) -> None:
    """Refuse a simulation that no twin with this registration can run, before computing.

    Raises
    ------
    OrderError
        As `simulate` does, as far as it can be told without knowing the twin of today.
    """
    if registration.model is None:
        nodes: tuple[str, ...] = (ALONE,)
        nominal = registration.nominal
        has_mass = nominal is not None and nominal.mass_kg is not None
    else:
        nodes, has_mass = assemble(description_of(registration.model)).names, True
    _place(nodes, has_mass, order.on)
    outputs, known = _outputs(nodes, order), checkpoint.known
    slowest = 0.0 if known is None else _NEAR * known.frequency_hz
    if order.load.kind == "harmonic":
        slowest = max(slowest, order.load.frequency_hz)
    samples = 0.0
    if order.load.kind == "recorded":
        samples = float(len(order.load.samples))
    elif order.duration_s is not None:
        samples = order.duration_s * (order.rate_hz or FINE * slowest)
        if samples > MOST_SAMPLES + 0.5:
            raise _too_long(order.duration_s, order.rate_hz or FINE * slowest)
    effects = registration.model is not None and bool(registration.model.effects)
    if samples >= 1.0:
        _check_amount(order, math.ceil(samples), len(outputs), len(nodes), effects=effects)


def _outputs(nodes: Sequence[str], order: SimulationOrder) -> tuple[str, ...]:
    """Return the nodes whose motion was requested."""
    moving = tuple(name for name in nodes if not _is_generalized(name))
    outputs = order.outputs or moving or tuple(nodes)
    strange = [name for name in outputs if name not in nodes]
    if strange:
        raise OrderError(
            f"outputs has {', '.join(strange):.200}. Allowed: {', '.join(nodes)}, each of "
            "which moves."
        )
    if len(set(outputs)) < len(outputs):
        raise OrderError(f"outputs names one twice: {', '.join(outputs)}. Name each once.")
    return outputs


def _place(nodes: Sequence[str], has_mass: bool, on: str) -> str | None:
    """Return the node on which the load acts; None for the base."""
    if on == BASE:
        return None
    if on not in nodes:
        raise OrderError(
            f"on={on!r:.80} is not a valid place. Allowed: {BASE}, {', '.join(nodes)}."
        )
    if not has_mass:
        raise OrderError(
            f"A force on {ALONE!r} needs a mass, which this twin has not been told. Register "
            "it with nominal.mass_kg, damping_n_s_per_m and stiffness_n_per_m, or with a "
            f"model; or give on={BASE!r} and an acceleration."
        )
    return on


def _range(believed: ParameterBelief) -> tuple[float, float]:
    """Lowest natural frequency, and the highest that stands for one of the structure [Hz].

    A reduced model has generalized coordinates besides motions of nodes; of its modes the upper
    ones, above as many as it has generalized coordinates, only make up static responses.
    """
    frequencies = believed.structure.frequencies_hz(believed.theta)
    generalized = sum(map(_is_generalized, believed.structure.dof_names))
    last = min(max(generalized, 1), len(frequencies)) if generalized else len(frequencies)
    return float(frequencies[0]), float(frequencies[last - 1])


def _is_generalized(name: str) -> bool:
    """Whether a degree of freedom is a coordinate of a reduced model, no motion of a node."""
    return _GENERALIZED.fullmatch(name) is not None


_GENERALIZED = re.compile(r"q\d+" + re.escape(ROTATION))
"""Names that `describe_reduced` gives to generalized coordinates."""


def _instants(
    order: SimulationOrder, lowest: float, highest: float
) -> tuple[float, Float[np.ndarray, " time"]]:
    load = order.load
    if load.kind == "recorded":
        assert order.rate_hz is not None
        return order.rate_hz, np.arange(len(load.samples)) / order.rate_hz
    fastest = max(highest, load.frequency_hz if load.kind == "harmonic" else 0.0)
    duration_s = order.duration_s or 20.0 / lowest
    rate_hz = order.rate_hz or FINE * fastest
    if order.duration_s is None and order.rate_hz is None:
        rate_hz = min(rate_hz, MOST_SAMPLES / duration_s)
    if duration_s * rate_hz > MOST_SAMPLES + 0.5:
        raise _too_long(duration_s, rate_hz)
    if duration_s * rate_hz < 2.0:
        raise OrderError(
            f"{duration_s:g} s at {rate_hz:g} Hz are fewer than 2 samples. Give a longer "
            "duration_s or a higher rate_hz."
        )
    return rate_hz, loads.instants(duration_s, rate_hz)


def _too_long(duration_s: float, rate_hz: float) -> OrderError:
    return OrderError(
        f"{duration_s:g} s at {rate_hz:g} Hz are {duration_s * rate_hz:,.0f} samples. "
        f"Allowed: {MOST_SAMPLES:,}. Give a shorter duration_s or a lower rate_hz."
    )


def _draws(today: CurrentStructure, order: SimulationOrder, samples: int, outputs: int) -> int:
    """Return the number of structures to simulate, within the limits of memory and time."""
    size, effects = today.believed.structure.size, today.description is not None
    return _check_amount(order, samples, outputs, size, effects=effects)


def _check_amount(
    order: SimulationOrder, samples: int, outputs: int, size: int, *, effects: bool
) -> int:
    """Return the number of draws; refuse more than the limit."""
    most = [
        (MOST_KEPT // (samples * outputs), "outputs"),
        (MOST_MOVED // (samples * size), "degrees of freedom"),
    ]
    if effects:
        most.append((MOST_OF_EFFECTS // samples, "a model with effects"))
    allowed, why = min(most)
    draws = min(DRAWS, allowed) if order.draws is None else order.draws
    if samples * outputs > MOST_TOLD or max(draws, FEWEST_DRAWS) > allowed:
        raise OrderError(
            f"{samples:,} samples of {outputs} outputs in {draws} draws were asked for. "
            f"Allowed: {MOST_TOLD:,} samples of all outputs, and because of {why} {allowed:,} "
            f"draws of so many, of which {FEWEST_DRAWS} are needed. Give a shorter duration_s, "
            "a lower rate_hz, fewer outputs or fewer draws."
        )
    return draws


def _load(
    order: SimulationOrder,
    times: Float[np.ndarray, " time"],
    rate_hz: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, " time"]:
    load = order.load
    if load.kind == "harmonic":
        return loads.harmonic(times, load.amplitude, load.frequency_hz, load.phase_deg)
    if load.kind == "step":
        return loads.step(times, load.amplitude, load.at_s)
    if load.kind == "white":
        return loads.white(times, load.psd, rate_hz, rng)
    return np.array(load.samples)


def _modes(
    believed: ParameterBelief, draws: int, level: float, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "mode 4"], Float[np.ndarray, "mode 4"]]:
    """Frequencies and damping of the structures that were drawn."""
    thetas = believed.thetas(draws, rng)
    frequencies = np.array([believed.structure.frequencies_hz(theta) for theta in thetas])
    tail = believed.log_damping[-frequencies.shape[1] :]
    tail_sd = believed.log_damping_sd[-frequencies.shape[1] :]
    half = 0.5 * (1.0 - level)
    lo, hi = np.quantile(frequencies, [half, 1.0 - half], axis=0)
    of_frequency = np.column_stack((frequencies.mean(axis=0), frequencies.std(axis=0), lo, hi))
    quantile = _quantile(level)
    value = np.exp(tail)
    of_damping = np.column_stack(
        (value, value * tail_sd, np.exp(tail - quantile * tail_sd),
         np.exp(tail + quantile * tail_sd))
    )  # fmt: skip
    return of_frequency, of_damping


def _quantile(level: float) -> float:
    return float(ndtri(0.5 + 0.5 * level))


def _with_effects(
    today: CurrentStructure,
    order: SimulationOrder,
    load: Float[np.ndarray, " time"],
    rate_hz: float,
    on: str | None,
    outputs: tuple[str, ...],
    draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "draw time output"]:
    """Run a model with its effects; damping of its elements is scaled as that of its modes."""
    assert today.description is not None
    angle = today.description.unit_of_coordinate == "rad"
    unit = "rad" if angle else "m"
    units = dict(
        zip(("displacement", "velocity", "acceleration"), ("", "/s", "/s^2"), strict=True)
    )
    acts = (
        Input(channel="load", kind="base_acceleration", unit=f"{unit}/s^2")
        if on is None
        else Input(channel="load", kind="force", node=on, unit="N m" if angle else "N")
    )
    frame = "absolute" if order.quantity == "acceleration" else "relative_to_base"
    hears = tuple(
        Sensor(
            channel=f"out {i}", quantity=order.quantity, node=name,
            unit=unit + units[order.quantity], frame=frame,  # type: ignore[arg-type]
        )
        for i, name in enumerate(outputs)
    )  # fmt: skip
    kinds = _kinds(today)
    runs = np.empty((draws, len(load), len(outputs)))
    drawn = _descriptions(today, draws, rng)
    for number, description in enumerate(drawn):
        ready = dataclasses.replace(description, inputs=(acts,), sensors=hears)
        found = run_model(ready, {"load": load}, rate_hz, hold="first", kinds=kinds)
        runs[number] = np.column_stack([found[f"out {i}"] for i in range(len(outputs))])
    return runs


def _kinds(today: CurrentStructure) -> Mapping[str, Kind]:
    """Kinds of the model's effects, those of installed parts among them."""
    assert today.description is not None
    used = frozenset(str(entry["effect"]) for entry in today.description.effects)
    try:
        kinds = kinds_for(used, today.parts)
    except ValueError as error:
        raise OrderError(str(error)) from error
    if missing := ", ".join(sorted(used - kinds.keys())):
        raise OrderError(
            f"The model has {missing}, which is no effect of slowtime's. An operator names the "
            "installed part that holds it in diagnose.effects of the server's settings."
        )
    return kinds


def _descriptions(
    today: CurrentStructure, count: int, rng: np.random.Generator
) -> Iterator[Description]:
    built, believed = today.description, today.believed
    assert built is not None
    names = believed.structure.names
    thetas, damping = believed.thetas(count, rng), rng.standard_normal(count)
    spread = float(np.median(believed.log_damping_sd))
    own = _own_damping(built, believed)
    for theta, away in zip(thetas, damping.tolist(), strict=True):
        factor = dict(zip(names, np.exp(theta).tolist(), strict=True))
        whole, heavier = factor.get("stiffness_change", 1.0), factor.get("mass_change", 1.0)
        damped = own * math.exp(spread * away)
        elements = []
        for element in built.elements:
            stiffer = today.scale.get(element.id, 1.0) * factor.get(element.id, whole)
            weighs = today.scale.get(element.id + MASS, 1.0)
            weighs *= factor.get(element.id + MASS, heavier)
            elements.append(_scaled(element, stiffer, damped, weighs))
        nodes = [
            dataclasses.replace(
                node,
                mass_kg=node.mass_kg
                * today.scale.get(node.id + MASS, 1.0)
                * factor.get(node.id + MASS, heavier),
            )
            for node in built.nodes
        ]
        yield dataclasses.replace(built, nodes=tuple(nodes), elements=tuple(elements))


def _scaled(element: Element, stiffer: float, damped: float, heavier: float) -> Element:
    """Element with its stiffness, damping and mass multiplied; of a beam not the mass."""
    if isinstance(element, Matrix):
        return dataclasses.replace(
            element,
            stiffness_factor=stiffer * element.stiffness_factor,
            damping_factor=damped * element.damping_factor,
            mass_factor=heavier * element.mass_factor,
        )
    if isinstance(element, Beam):
        return dataclasses.replace(
            element,
            bending_stiffness_n_m2=stiffer * element.bending_stiffness_n_m2,
            damping_s=damped * element.damping_s,
        )
    return dataclasses.replace(
        element,
        stiffness_n_per_m=stiffer * element.stiffness_n_per_m,
        damping_n_s_per_m=damped * element.damping_n_s_per_m,
    )


def _own_damping(built: Description, believed: ParameterBelief) -> float:
    """Return the common factor from the elements' damping to the measured one."""
    matrices = assemble(built)
    mass, stiffness = believed.structure.matrices(believed.theta)
    squares, shapes = eigh(stiffness, mass)
    twice = np.einsum("ij,ik,kj->j", shapes, matrices.damping, shapes)
    model = 0.5 * twice / np.sqrt(np.maximum(squares, 1e-300))
    usable = (model > 1e-6) & (squares > 0.0)
    if not usable.any():
        return 1.0
    return float(np.exp(np.mean(believed.log_damping[usable] - np.log(model[usable]))))
