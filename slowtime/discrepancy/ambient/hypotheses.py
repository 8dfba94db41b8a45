"""Hypotheses about ambient records: nothing missing, a law at an element, a mass at a node."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.progress import Monitor
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Effect, Kind, Place

from .equivalents import Equivalents, element_changes, equivalents_of
from .law_selection import fit_laws, laws_of_elements
from .spectra import AmbientFit, Change, SpectralProblem, expected_gain, fit_spectra

SHORTLIST = 4
"""[places] That are fitted, of those which the score test ranks. Source: judgement; the true
place was first or second of up to three in simulated rigs."""
CREEP = 1e-9
"""[1] Relative change of a mass below which none was found. Source: rounding."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """An effect that may be missing.

    Parameters
    ----------
    effect
        With its parameters.
    sds
        Their standard deviations, by name.
    gain
        Log evidence over that of the model without it [nats].
    fit
        Of the spectra, in which the equivalents at its place are free.
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
    bare
        The fit of the model without an effect.
    candidates
        The most probable first.
    equivalents
        Of the elements that were fitted, the one that explains most first.
    expected
        Gain of log likelihood that each place promises [nats].
    sizes
        Number of changes that were tried at each place.
    """

    bare: AmbientFit
    candidates: tuple[Candidate, ...]
    equivalents: tuple[Equivalents, ...]
    expected: Mapping[Place, float]
    sizes: Mapping[Place, int]


def compare_effects(
    problem: SpectralProblem, bare: AmbientFit, kinds: Mapping[str, Kind], monitor: Monitor
) -> Compared:
    """Fit equivalents at each place, and laws to them.

    Parameters
    ----------
    problem
        Records and model.
    bare
        The fit of the model without an effect.
    kinds
        Catalogue of effects by name.
    monitor
        Receives the stage of the work.
    """
    changes = _changes_by_place(problem, kinds)
    expected = {
        place: expected_gain(problem.with_changes(*own), bare) for place, own in changes.items()
    }
    ranked = sorted(expected, key=lambda place: -expected[place])[:SHORTLIST]
    candidates: list[Candidate] = []
    found: list[tuple[float, Equivalents]] = []
    for number, place in enumerate(ranked):
        monitor(f"fitting spectra with a change at {place}", 0.2 + 0.7 * number / len(ranked))
        changed = problem.with_changes(*changes[place])
        fit = fit_spectra(changed, bare)
        if place.kind == "node":
            candidates += _mass(place, fit, bare)
            continue
        equivalents = equivalents_of(changed, fit, place.id)
        found.append((fit.log_likelihood, equivalents))
        laws = laws_of_elements(kinds, len(changes[place]))
        candidates += [
            Candidate(law.effect, law.sds, law.log_evidence - bare.log_likelihood, fit)
            for law in fit_laws(equivalents, fit, laws)
        ]
    candidates.sort(key=lambda one: -one.gain)
    found.sort(key=lambda one: -one[0])
    return Compared(
        bare,
        tuple(candidates),
        tuple(one for _, one in found),
        expected,
        {place: len(own) for place, own in changes.items()},
    )


def _changes_by_place(
    problem: SpectralProblem, kinds: Mapping[str, Kind]
) -> dict[Place, Sequence[Change]]:
    description = problem.plant.description
    changes: dict[Place, Sequence[Change]] = {
        Place("element", element.id): element_changes(problem, element.id)
        for element in description.elements
        if isinstance(element, Spring)
    }
    if "added_mass" in kinds:
        changes |= {
            Place("node", node.id): (
                Change(constant=("mass", node.id), record=None, scale=node.mass_kg),
            )
            for node in description.nodes
            if node.mass_kg > 0
        }
    return changes


def _mass(place: Place, fit: AmbientFit, bare: AmbientFit) -> list[Candidate]:
    """Return the added mass of a node, where there is more than none."""
    added, sd = float(fit.change_values[0]), float(np.sqrt(fit.change_covariance[0, 0]))
    if not added > CREEP * fit.changes[0].scale:
        return []
    gain = fit.log_likelihood - bare.log_likelihood - float(np.log1p((added / sd) ** 2)) / 2
    return [Candidate(Effect("added_mass", place, {"dm_kg": added}), {"dm_kg": sd}, gain, fit)]
