"""Laws that change with time, told from those that do not by the parts of ambient records."""

from collections.abc import Mapping, Sequence

from slowtime.discrepancy.candidates.library_fit import is_applicable
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, Kind
from slowtime.dynamics.plant import Plant

from .equivalents import changes_of, equivalents_of
from .hypotheses import SpectralCandidate
from .law_selection import fit_laws
from .spectra import fit_spectra, spectral_problem

PARTS = 3
"""[parts] Of each record. Source: two tell a drift from nothing, three from a jump; shorter
parts do not resolve a resonance."""
INNER = 0.5 - 1 / PARTS
"""[share of a record] From its middle up to which jumps are sought: between whole parts."""
TIME_VARYING_FAMILIES = ("time-varying", "time-varying mass")
"""Of laws that change with campaign time."""


def with_time_variation(
    candidates: Sequence[SpectralCandidate],
    plant: Plant,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> tuple[SpectralCandidate, ...]:
    """Add what varies with time at the place of the best candidate; the most probable first."""
    best = candidates[0]
    place, description = best.effect.place, plant.description
    varying = [
        kind
        for kind in kinds.values()
        if kind.family in TIME_VARYING_FAMILIES and is_applicable(kind, place, description)
    ]
    if not varying:
        return tuple(candidates)
    parts = [
        trial.part(k * len(trial.outputs) // PARTS, (k + 1) * len(trial.outputs) // PARTS)
        for trial in trials
        for k in range(PARTS)
    ]
    problem = spectral_problem(plant, parts)
    problem = problem.with_changes(*changes_of(problem, place))
    fit = fit_spectra(problem, fit_spectra(problem.with_changes()))
    spans = [(part.start_s, part.duration_s) for part in parts]
    found = equivalents_of(problem, fit, place, spans=spans)
    known = {one.effect.kind for one in candidates if one.effect.place == place}
    laws = fit_laws(
        found, fit.log_likelihood, [*varying, *(kinds[name] for name in sorted(known))]
    )
    level = max((law.log_evidence for law in laws if law.effect.kind in known), default=None)
    if level is None:
        return tuple(candidates)
    more = [
        SpectralCandidate(law.effect, law.sds, best.gain + law.log_evidence - level, best.fit)
        for law in laws
        if law.effect.kind not in known and _switches_within(law.effect, kinds, trials)
    ]
    return tuple(sorted([*candidates, *more], key=lambda one: -one.gain))


def _switches_within(
    effect: Effect, kinds: Mapping[str, Kind], trials: Sequence[Trial]
) -> bool:
    """Whether a law switches, if it does, where a whole part of a record is on either side."""
    # Near an end a switch is told from nothing by the transient of the start alone.
    action = kinds[effect.kind].action
    instants = [effect.parameters[name] for name in getattr(action, "switches", ())]
    return all(
        any(
            abs(at - one.start_s - one.duration_s / 2) < INNER * one.duration_s
            for one in trials
        )
        for at in instants
    )
