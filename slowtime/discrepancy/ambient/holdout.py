"""Misfit of the spectra of records that were not fitted."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import prior_of
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, Kind
from slowtime.dynamics.plant import Name, Plant

from .equivalents import element_motion
from .hypotheses import SENSOR_CHANGES
from .spectra import AmbientFit, SpectralProblem, fit_spectra, spectral_problem

LEAST_SD = 1e-6
"""[1] Relative standard deviation of constants at least. Source: far below what spectra can
tell."""
ROUNDS = 3
"""[iterations] Between the level of the motion and the equivalents of a law. Source: levels
change by less than a per cent after."""


def spectral_error(fit: AmbientFit) -> float:
    """Root of the deviance for each degree of freedom beyond that of noise [1]."""
    return float(np.sqrt(max(fit.misfit - 1.0, 0.0)))


def error_of_chance(fit: AmbientFit) -> float:
    """Spectral error that chance makes where nothing is missing, one standard deviation [1]."""
    return float((2.0 / fit.degrees) ** 0.25)


def fit_unseen(
    plant: Plant,
    trials: Sequence[Trial],
    values: Float[np.ndarray, " free"],
    sds: Float[np.ndarray, " free"],
    effect: Effect | None,
    kinds: Mapping[str, Kind],
) -> AmbientFit:
    """Fit forces and noise of other records, with constants and effect as they were found."""
    # Constants may move by the standard deviations with which they were found.
    fits = [_fit_one(plant, trial, (values, sds), effect, kinds) for trial in trials]
    if len(fits) == 1:
        return fits[0]
    return dataclasses.replace(
        fits[0],
        deviance=sum(one.deviance for one in fits),
        degrees=sum(one.degrees for one in fits),
        bands=tuple(band for one in fits for band in one.bands),
    )


def _fit_one(
    plant: Plant,
    trial: Trial,
    found: tuple[Float[np.ndarray, " free"], Float[np.ndarray, " free"]],
    effect: Effect | None,
    kinds: Mapping[str, Kind],
) -> AmbientFit:
    prior, (values, sds) = prior_of(plant), found
    constants: dict[Name, float] = dict(zip(prior.names, values.tolist(), strict=True))
    problem, fit = _with_constants(plant, trial, constants, sds)
    span_s = (trial.start_s, trial.duration_s)
    for _ in range(ROUNDS if effect is not None else 0):
        assert effect is not None
        moved = constants | _changed(problem, fit, effect, kinds, constants, span_s)
        problem, fit = _with_constants(plant, trial, moved, sds)
    return fit


def _with_constants(
    plant: Plant,
    trial: Trial,
    constants: Mapping[Name, float],
    sds: Float[np.ndarray, " free"],
) -> tuple[SpectralProblem, AmbientFit]:
    """Fit forces and noise of one record, with constants held within their errors."""
    description = with_values(plant.description, constants)
    problem = spectral_problem(dataclasses.replace(plant, description=description), (trial,))
    sensed = {name: value for name, value in constants.items() if name[0] in ("gain", "delay")}
    problem = dataclasses.replace(problem, sensed=sensed)
    mean = np.array([constants[name] for name in problem.prior.names])
    held = dataclasses.replace(
        problem.prior, mean=mean, sd=np.maximum(sds, LEAST_SD * np.abs(mean))
    )
    problem = dataclasses.replace(problem, prior=held)
    return problem, fit_spectra(problem)


def _changed(
    problem: SpectralProblem,
    fit: AmbientFit,
    effect: Effect,
    kinds: Mapping[str, Kind],
    constants: Mapping[Name, float],
    span_s: tuple[float, float],
) -> dict[Name, float]:
    """Return the constants at the place of an effect, at level and times of the record."""
    place, entries = effect.place, problem.plant.entries

    def before(name: Name) -> float:
        if name in constants:
            return constants[name]
        return entries[name].value if name in entries else 0.0

    if place.kind == "sensor":
        what = SENSOR_CHANGES[effect.kind]
        (value,) = effect.parameters.values()
        return {(what, place.id): value}
    motion = element_motion(problem, fit, 0, place).during(*span_s)
    added = motion.equivalents(kinds[effect.kind], effect.parameters)
    known = ("mass",) if place.kind == "node" else ("stiffness", "damping")
    names: list[Name] = [(one, place.id) for one in known]
    return {name: before(name) + more for name, more in zip(names, added, strict=True)}
