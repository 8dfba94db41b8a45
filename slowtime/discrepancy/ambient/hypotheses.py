"""Hypotheses about ambient records: a law at an element, a mass at a node, a wrong sensor."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import chdtrc

from slowtime.discrepancy.estimation.model_evidence import log_joints
from slowtime.discrepancy.progress import Monitor
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Effect, Kind, Place

from .equivalents import Equivalents, element_changes, equivalents_of
from .law_selection import fit_laws, laws_of_elements
from .spectra import (
    AmbientFit,
    ConstantChange,
    SpectralProblem,
    best_begin,
    expected_gains,
    fit_spectra,
)

SHORTLIST = 4
"""[places] That are fitted, of those which the score test ranks. Source: the true place was
first or second of up to three in simulated rigs."""
CREEP = 1e-9
"""[1] Change in units of its scale below which none was found. Source: rounding."""
SENSOR_CHANGES = {"sensor_gain": "gain", "sensor_delay": "delay"}
"""Kinds of effect that are sought at sensors, and the constants that they change."""
DELAYS = np.linspace(-3.0, 3.0, 25)
"""[rad at the highest line] Phases of a late sensor from which the best is refined. Source:
steps of a quarter radian, far less than the half turn after which a phase repeats itself."""


_Idea = tuple[Place, str]
"""A place, and the kind of what may be missing there; empty for the laws of an element."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SpectralCandidate:
    """An effect that may be missing.

    Parameters
    ----------
    gain
        Log evidence over that of the model without it [nats].
    """

    effect: Effect
    sds: Mapping[str, float]
    gain: float
    fit: AmbientFit


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """Places and effects that were compared.

    Parameters
    ----------
    equivalents
        Of the elements that were fitted, the one that explains most first.
    expected
        Gain of log likelihood that each place promises [nats].
    """

    bare: AmbientFit
    candidates: tuple[SpectralCandidate, ...]
    equivalents: tuple[Equivalents, ...]
    expected: Mapping[Place, float]
    sizes: Mapping[Place, int]


def compare_effects(
    problem: SpectralProblem, bare: AmbientFit, kinds: Mapping[str, Kind], monitor: Monitor
) -> Compared:
    """Fit changes at each place, and laws to those of elements."""
    changes = _changes(problem, kinds)
    begins = {
        idea: best_begin(problem.with_changes(*own), bare, DELAYS)
        for idea, own in changes.items()
        if idea[1] == "sensor_delay"
    }
    gains = expected_gains(problem, bare, list(changes.values()))
    expected = {
        idea: max(gain, begins.get(idea, (0.0, 0.0))[1])
        for idea, gain in zip(changes, gains, strict=True)
    }
    ranked = sorted(
        changes, key=lambda idea: chdtrc(len(changes[idea]), 2 * max(expected[idea], 0.0))
    )[:SHORTLIST]
    candidates: list[SpectralCandidate] = []
    found: list[tuple[float, Equivalents]] = []
    for number, idea in enumerate(ranked):
        place, kind = idea
        monitor(f"fitting spectra with a change at {place}", 0.2 + 0.7 * number / len(ranked))
        changed = problem.with_changes(*changes[idea])
        fit = fit_spectra(changed, bare, begins.get(idea, (0.0, 0.0))[0])
        if kind:
            candidates += _one_number(kinds[kind], place, fit, bare)
            continue
        equivalents = equivalents_of(changed, fit, place)
        found.append((fit.log_likelihood, equivalents))
        candidates += _laws(equivalents, fit, bare, kinds, problem)
    candidates.sort(key=lambda one: -one.gain)
    found.sort(key=lambda one: -one[0])
    at = {place: [idea for idea in changes if idea[0] == place] for place, _ in changes}
    return Compared(
        bare,
        tuple(candidates),
        tuple(one for _, one in found),
        {place: max(expected[idea] for idea in own) for place, own in at.items()},
        {place: len(changes[own[0]]) for place, own in at.items()},
    )


def _changes(
    problem: SpectralProblem, kinds: Mapping[str, Kind]
) -> dict[_Idea, Sequence[ConstantChange]]:
    """List what may be changed: by place, and kind where it is of one."""
    description = problem.plant.description
    changes: dict[_Idea, Sequence[ConstantChange]] = {
        (Place("element", element.id), ""): element_changes(problem, element.id)
        for element in description.elements
        if isinstance(element, Spring)
    }
    if "added_mass" in kinds:
        changes |= {
            (Place("node", node.id), "added_mass"): (
                ConstantChange(constant=("mass", node.id), record=None, scale=node.mass_kg),
            )
            for node in description.nodes
            if node.mass_kg > 0
        }
    radian_s = 1 / (2 * math.pi * max(one.frequency_hz[-1] for one in problem.records))
    if problem.sensors > 1:
        changes |= {
            (Place("sensor", sensor.channel), kind): (
                ConstantChange(
                    constant=(what, sensor.channel),
                    record=None,
                    scale=radian_s if what == "delay" else 1.0,
                ),
            )
            for kind, what in SENSOR_CHANGES.items()
            if kind in kinds
            for sensor in description.sensors
        }
    return changes


def _laws(
    equivalents: Equivalents,
    fit: AmbientFit,
    bare: AmbientFit,
    kinds: Mapping[str, Kind],
    problem: SpectralProblem,
) -> list[SpectralCandidate]:
    """Fit laws to the equivalents of an element; all open joints are as probable as one."""
    place, description = equivalents.place, problem.plant.description
    laws = laws_of_elements(kinds, place, description, len(equivalents.values))
    against = bare.log_likelihood + log_joints(place, description)
    return [
        SpectralCandidate(law.effect, law.sds, law.log_evidence - against, fit)
        for law in fit_laws(equivalents, fit.log_likelihood, laws)
    ]


def _one_number(
    kind: Kind, place: Place, fit: AmbientFit, bare: AmbientFit
) -> list[SpectralCandidate]:
    """Return an effect of one number, where there is more than none of it."""
    change, sd = float(fit.change_values[0]), float(np.sqrt(fit.change_covariance[0, 0]))
    (parameter,) = kind.parameters
    without = 1.0 if kind.name == "sensor_gain" else 0.0
    if not abs(change) > CREEP * fit.changes[0].scale or parameter.refuses(without + change):
        return []
    occam = float(np.log1p((change / sd) ** 2)) / 2
    gain = fit.log_likelihood - bare.log_likelihood - occam
    effect = Effect(kind.name, place, {parameter.name: without + change})
    return [SpectralCandidate(effect, {parameter.name: sd}, gain, fit)]
