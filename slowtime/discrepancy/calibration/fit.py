"""Fit of a plant to records: growing horizons, noise estimate, and goodness of fit."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ParamSpec, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.fft import prev_fast_len

from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.noise import (
    Noise,
    estimate_noise,
    response_limit_hz,
    rigid_body_drift,
    with_drift,
)
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.discrepancy.time_limit import leave_out
from slowtime.dynamics.effects import Motion, Place
from slowtime.dynamics.plant import Name, Plant

from .levenberg_marquardt import (
    CONVERGENCE,
    DEFAULT_CONTROL,
    FitAbandoned,
    FitControl,
    Iterate,
    LeastSquaresProblem,
    NormalEquations,
    minimise,
    normal_equations,
    simulate_trial,
    with_cost,
)
from .measured_friction import MeasuredFrictionPlant, needs_measured_friction
from .prior import Prior, prior_of
from .spectral_weights import spectral_weights

Given = ParamSpec("Given")
Result = TypeVar("Result")

BREAKDOWNS = (np.linalg.LinAlgError, FloatingPointError)
"""What a fit raises whose numbers break down."""
HORIZON_SHARES = (0.15, 0.4, 1.0)
"""[share of each record] Fitted one after the other, as the misfit of a whole record has more
minima. Source: fewer steps ended in more minima; half and double change no answer of
docs/what_decides.md."""

HOPELESS_RATIO = 10.0
"""[1] Times its share of the cost to beat that a model may leave of the first part of the
records. Source: docs/decisions/0029; 1 lost one right law of nine, 10 none."""
MIN_COMPARED_SHARE = 0.1
"""[share of each record] From which on a model is compared with the cost to beat. Source:
docs/decisions/0029."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit:
    r"""Result of a fit.

    Parameters
    ----------
    values
        Of all constants of the plant, in its order and units.
    covariance
        Of the free constants, if the model is right and the noise as given.
    outputs, residual
        Of each trial (time, sensor), in the sensors' units; the residual is zero where a sample
        is not used.
    cost
        :math:`\chi^2` of residuals and priors together.
    chi2_per_datum, chi2_sd
        Mean square of the whitened residual over the degrees of freedom, and its standard
        deviation if nothing is missing: 1 ± `chi2_sd` is expected.
    chi2_in_band, in_band_sd
        The same for the lines up to `silent_above_hz`, where the structure answers.
    silent_above_hz
        Frequency [Hz] above which the structure hardly answers.
    """

    plant: Plant
    values: Float[np.ndarray, " parameter"]
    prior: Prior
    covariance: Float[np.ndarray, "free free"]
    states: tuple[Float[np.ndarray, " state"], ...]
    outputs: tuple[Float[np.ndarray, "_ sensor"], ...]
    residual: tuple[Float[np.ndarray, "_ sensor"], ...]
    noise: Noise
    cost: float
    data: int
    chi2_per_datum: float
    chi2_sd: float
    chi2_in_band: float
    in_band_sd: float
    silent_above_hz: float

    @property
    def free(self) -> Float[np.ndarray, " free"]:
        """Values of the free constants."""
        return self.values[list(self.prior.index)]

    @property
    def sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviations of the free constants."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def inflated_sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviations, inflated where the model leaves more than noise."""
        sd, wide = self.sd, max(self.chi2_in_band, 1.0)
        if not (np.isfinite(sd).all() and (sd > 0).all()):
            return np.asarray(np.sqrt(wide) * sd)
        claimed = np.diag((sd / self.prior.sd) ** 2)
        both = np.linalg.pinv(self.covariance / np.outer(sd, sd), hermitian=True)
        # The information of the records is divided by `chi2_in_band`; that of the prior is not.
        told = np.linalg.pinv((both - claimed) / wide + claimed, hermitian=True)
        return np.asarray(sd * np.sqrt(np.clip(np.diag(told), 1.0, wide)))

    @property
    def pulls(self) -> dict[Name, float]:
        """Deviation of each free constant from its prior mean, in prior standard deviations."""
        moved = (self.free - self.prior.mean) / self.prior.sd
        return dict(zip(self.prior.names, moved.tolist(), strict=True))

    @property
    def constant_pulls(self) -> dict[Name, float]:
        """The same for constants of the structure; parameters of effects have no tolerance."""
        return {name: pull for name, pull in self.pulls.items() if name[0] != "effect"}

    def motions(self, trials: Sequence[Trial]) -> Iterator[dict[Place, Motion]]:
        """Run the model through its records, one after the other; motion by place."""
        for trial, state in zip(trials, self.states, strict=True):
            yield self.plant.states(
                self.values, trial.inputs, trial.rate_hz, state0=state, start_s=trial.start_s
            )


def refit(
    plant: Plant,
    trials: Sequence[Trial],
    *,
    free: Sequence[Name] | None = None,
    noise: Noise | None = None,
    values: Float[np.ndarray, " parameter"] | None = None,
    states: Sequence[Float[np.ndarray, " state"]] | None = None,
    horizons: Sequence[float] = HORIZON_SHARES,
    control: FitControl = DEFAULT_CONTROL,
) -> Fit:
    """Fit constants and initial states to the error of the free run (output error).

    Parameters
    ----------
    plant
        Linear or not; its own values and tolerances are the prior.
    trials
        Records to fit; outputs (time, sensor) in the units of the description.
    free
        Names of constants that may move; see `prior_of`.
    noise
        Of the sensors. Where not given, it is estimated from what the start leaves, and again
        from what the fit leaves, in doubt where the structure answers.
    values, states
        To start from: values of all constants, and one initial state for each trial; the
        plant's own, at rest, where not given.
    horizons
        Growing shares of each record, the last of them 1.
    control
        When the fit ends, and how far constants may move.

    Returns
    -------
    The best point found; by chi squared and priors over the whole records, never worse than
    the start.

    Raises
    ------
    FitAbandoned
        Once it is late, or where the cost to beat is out of reach.
    FloatingPointError
        Where the free run from the start grows beyond bounds.

    References
    ----------
    .. [1] L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall
       (1999), ch. 7 (prediction and output error methods).
    """
    records = tuple(trials)
    prior = prior_of(plant, free, control.max_tolerances)
    silent = response_limit_hz(plant.description, records)
    rest = tuple(np.zeros(0) for _ in records)
    start = Iterate(
        values=(plant.values if values is None else values).copy(),
        states=rest if states is None else tuple(states),
    )
    heard = noise or _estimate_noise(plant, records, start, silent)
    point = _over_growing_horizons(plant, prior, records, heard, start, horizons, control)
    if noise is None:
        problem = _problem(plant, prior, records, heard)
        still = dataclasses.replace(
            control, cost_to_beat=None, compared=None, to_convergence=False
        )
        point = minimise(problem, point, still)[0]
        heard = _estimate_noise(plant, records, point, silent)
    problem = _problem(plant, prior, records, heard)
    best, normal, spread = minimise(problem, point, control)
    # Growing horizons may have led astray; from the start itself there is only down.
    moved = point is not start
    if moved and with_cost(problem, _with_full_states(start, normal), spread).cost < best.cost:
        best, normal, spread = minimise(problem, start, control)
    if needs_measured_friction(plant, heard) and not leave_out(CONVERGENCE):
        guided = (
            MeasuredFrictionPlant(plant=plant, trial=trial, noise=heard, number=i)
            for i, trial in enumerate(records)
        )
        problem = dataclasses.replace(problem, friction_plants=tuple(guided))
        best, normal, _ = minimise(problem, best, control)
    return _make_fit(problem, records, best, normal, heard, silent)


def initial_state_sds(fit: Fit, trials: Sequence[Trial]) -> list[Float[np.ndarray, " state"]]:
    """Compute standard deviations of initial states by record, if the model is right."""
    problem = _problem(fit.plant, fit.prior, tuple(trials), fit.noise)
    normal, _ = normal_equations(problem, Iterate(values=fit.values, states=fit.states))
    sds = np.sqrt(np.diag(normal.covariance))[len(fit.prior.names) :]
    return list(sds.reshape(len(fit.states), normal.states))


def _problem(
    plant: Plant,
    prior: Prior,
    records: tuple[Trial, ...],
    noise: Noise,
    counts: Sequence[int] | None = None,
) -> LeastSquaresProblem:
    """Weigh the first samples of each record, or all of them, by the noise."""
    samples = tuple(len(trial.outputs) for trial in records) if counts is None else counts
    weights = tuple(
        spectral_weights(trial, noise, i, samples=count)
        for i, (trial, count) in enumerate(zip(records, samples, strict=True))
    )
    return LeastSquaresProblem(
        plant=plant, prior=prior, trials=records, weights=weights, samples=tuple(samples)
    )


def _over_growing_horizons(
    plant: Plant,
    prior: Prior,
    records: tuple[Trial, ...],
    noise: Noise,
    start: Iterate,
    horizons: Sequence[float],
    control: FitControl,
) -> Iterate:
    """Fit growing first parts of the records, the whole of them left out."""
    point = start
    whole = [len(trial.outputs) for trial in records]
    for horizon in horizons[:-1]:
        if leave_out(CONVERGENCE):
            break
        counts = [prev_fast_len(max(int(horizon * n), min(MIN_SAMPLES, n))) for n in whole]
        problem = _problem(plant, prior, records, noise, counts)
        part = dataclasses.replace(
            control, data=(sum(counts), sum(whole)), to_convergence=False
        )
        if horizon < MIN_COMPARED_SHARE:
            part = dataclasses.replace(part, cost_to_beat=None, compared=None)
        point = minimise(problem, point, part)[0]
        if part.is_beaten(point.cost, HOPELESS_RATIO):
            raise FitAbandoned
    return point


def _with_full_states(point: Iterate, normal: NormalEquations) -> Iterate:
    states = tuple(s if s.size else np.zeros(normal.states) for s in point.states)
    return dataclasses.replace(point, states=states)


def _estimate_noise(
    plant: Plant, trials: tuple[Trial, ...], point: Iterate, silent: float
) -> Noise:
    """Estimate the noise from the residual at a point; from outputs where a run diverges."""
    residuals = []
    for trial, state in zip(trials, point.states, strict=True):
        outputs = plant.simulate(
            point.values,
            trial.inputs,
            trial.rate_hz,
            state0=state if state.size else None,
            start_s=trial.start_s,
        )
        left = np.where(trial.used, trial.measured - outputs, 0.0)
        residuals.append(left if np.isfinite(left).all() else trial.measured)
    laws = [one for one in plant.description.effects if "element" in one]
    noise = estimate_noise(trials, tuple(residuals), silent_above_hz=silent, lacking=not laws)
    values = dict(zip(plant.parameters, point.values.tolist(), strict=True))
    now = with_values(plant.description, values)
    drift = rigid_body_drift(now, trials)
    return noise if drift is None else with_drift(noise, drift, trials[0].rate_hz)


def _make_fit(
    problem: LeastSquaresProblem,
    records: tuple[Trial, ...],
    best: Iterate,
    normal: NormalEquations,
    noise: Noise,
    silent: float,
) -> Fit:
    """Collect residuals, covariance and goodness of fit of the best point."""
    outputs = tuple(simulate_trial(problem, i, best) for i in range(len(records)))
    residual = tuple(
        np.where(trial.used, trial.measured - told, 0.0)
        for trial, told in zip(records, outputs, strict=True)
    )
    lines = [w.chi2_by_line(r) for w, r in zip(problem.weights, residual, strict=True)]
    inside = [w.frequency_hz <= silent for w in problem.weights]
    shares = [np.mean(w.use**2, axis=0) for w in problem.weights]
    free = len(problem.prior.names)
    data = sum(weights.data for weights in problem.weights)
    fitted = _effective_unknowns(problem, normal)
    whole = float(sum(line.sum() for line in lines))
    band = float(sum(line[i].sum() for line, i in zip(lines, inside, strict=True)))
    members = sum(float(2 * i.sum() * s.sum()) for i, s in zip(inside, shares, strict=True))
    floor = _noise_floor_sd(problem, noise)
    return Fit(
        plant=problem.plant,
        values=best.values,
        prior=problem.prior,
        covariance=normal.covariance[:free, :free],
        states=best.states,
        outputs=outputs,
        residual=residual,
        noise=noise,
        cost=best.cost,
        data=data,
        chi2_per_datum=whole / max(data - fitted, 1.0),
        chi2_sd=float(np.hypot(np.sqrt(2 / data), floor)),
        chi2_in_band=band / max(members - fitted, 1.0),
        in_band_sd=float(np.hypot(np.sqrt(2 / max(members, 1.0)), floor)),
        silent_above_hz=silent,
    )


def _effective_unknowns(problem: LeastSquaresProblem, normal: NormalEquations) -> float:
    """Effective number of unknowns that the data, not the priors, determine."""
    total = len(normal.gradient)
    free = len(problem.prior.names)
    with np.errstate(invalid="ignore"):
        held = np.diag(normal.covariance)[:free] / problem.prior.sd**2
    # Infinite over infinite, where neither the data nor a prior determine an unknown.
    return float(total - np.clip(np.nan_to_num(held, nan=1.0), 0, 1).sum())


def _noise_floor_sd(problem: LeastSquaresProblem, noise: Noise) -> float:
    """Give the standard deviation of chi squared that is due to the estimated noise."""
    counts = np.array([weights.use.sum(axis=0) for weights in problem.weights])
    weighted = counts / counts.sum() * np.array(noise.relative_sd)
    return float(np.sqrt(np.sum(weighted**2)))


def referred_to(fit: Fit, trials: Sequence[Trial]) -> tuple[object, ...]:
    """List what fits to the same records refer to, and need not be copied."""
    plant = fit.plant
    return (fit, fit.noise, plant, plant.kinds, *plant.kinds.values(), *trials)


def attempt(
    step: Callable[Given, Result], *given: Given.args, **how: Given.kwargs
) -> Result | None:
    """Take a step of a search; None where its fits break down or are abandoned."""
    # A wrong law breaks down: its runs grow without bound, or its equations have no solution.
    try:
        return step(*given, **how)
    except (*BREAKDOWNS, FitAbandoned):
        return None


def try_refit(plant: Plant, trials: Sequence[Trial], **how: Any) -> Fit | None:
    """Refit as `refit` does; None where the fit breaks down or is abandoned."""
    found = attempt(refit, plant, trials, **how)
    return found if found is not None and np.isfinite(found.cost) else None
