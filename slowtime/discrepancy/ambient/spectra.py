r"""Fit of a model to the spectra of ambient records, under unmeasured random forces.

The forces are taken to be independent on every mass, with densities that differ from record to
record, and one smooth shape over frequency in each record. The spectral matrix of the sensors
in record :math:`r` is then

.. math:: \Sigma_r(\omega) = \phi_r(\omega) \sum_j S_{rj} \, g_j(\omega) g_j(\omega)^H
          + \mathrm{diag}(N) ,

and the lines of the record are complex normal with it. Constants, densities and shapes of
forces, and noise are found by Fisher scoring. Changes of a stiffness, damping or mass, in one
record or in all, may be fitted beside them: an effect that depends on amplitude changes the
equivalent stiffness and damping of its element from record to record.

References
----------
.. [1] P. Whittle, "Gaussian estimation in stationary time series", Bull. Int. Stat. Inst. 39
   (1962).
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg
import scipy.special
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration import Prior, prior_of
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.localization import LinearModel
from slowtime.discrepancy.noise import response_limit_hz
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description
from slowtime.dynamics.plant import Name, Plant
from slowtime.signals.spectra import detrended, transform

from .record_lines import (
    SHAPE_KNOTS,
    Lines,
    RecordLines,
    driven_lines,
    sensors_of_different_nodes,
)

MAX_STEPS = 30
"""[steps] Of Fisher scoring at most. Source: docs/what_decides.md: half and double change no
answer."""
MIN_GAIN = 0.05
"""[nats] Gain of log likelihood below which a step is not worth taking. Source: a tenth of
what one standard deviation is worth (1/2)."""

MAX_STEP = 0.5
"""[1] Largest relative change of a constant, or change of a log density, in one step. Source:
docs/what_decides.md: half and double change no answer."""

BAND_MARGIN = 1.5
"""[1] Times the frequency above which the structure is silent up to which lines are used.
Source: docs/what_decides.md: half and double change no answer."""

MOST_AT_ONCE = 8
"""[places] Whose score test is computed at once. Source: a bound on memory."""

DIFFERENCE_STEP = 1e-4
"""[1] Relative step of central differences. Source: near the cube root of double precision,
with margin."""

SHAPE_SD = 1.5
"""[nats] Prior standard deviation of the log shape at a knot. Source: the density of wind falls
by some 4 nats in a decade."""

DENSITY_SD = 5.0
"""[nats] Prior standard deviation of a log density about the mean of all forces. Source: a
decision: forces on two masses rarely differ by more than a factor of 150; it keeps densities
that the sensors do not see from running away."""

Matrices = Complex[np.ndarray, "frequency sensor sensor"]
Responses = Complex[np.ndarray, "frequency sensor force"]
Unknowns = Float[np.ndarray, " unknown"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ConstantChange:
    """A change of one constant of the model, to be estimated.

    Parameters
    ----------
    constant
        Name of the constant, such as ``("stiffness", "j0")``; of a sensor ``("gain", "a1")``
        and ``("delay", "a1")`` [s].
    record
        Number of the record in which it differs; None for a change in all.
    scale
        Prior standard deviation, in the unit of the constant.
    """

    constant: Name
    record: int | None
    scale: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SpectralBand:
    """A band [Hz] of one record, and the p-value of its covariance test."""

    low_hz: float
    high_hz: float
    p_value: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AmbientFit:
    """Result of a fit to the spectra of ambient records.

    Parameters
    ----------
    values, covariance
        Of the constants that were free, in the order of `prior`.
    change_values, change_covariance
        Of the changes, each in the unit of its constant.
    force_density
        Of the force on each translation in each record, one-sided [N²/Hz].
    force_shape
        Logarithm of the shape of the forces of each record, at its knots.
    noise_density
        Of each sensor in each record, harmonics of a nonlinear response included [unit²/Hz].
    log_likelihood
        Of all lines, plus the log prior density of the constants that were free [nats].
    bands
        Over which the covariance of the lines was tested, for all records.
    deviance, degrees
        Sum of the test statistic over all bands, and its degrees of freedom; the ratio is 1
        where the model lacks nothing.
    """

    prior: Prior
    values: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]
    changes: tuple[ConstantChange, ...]
    change_values: Float[np.ndarray, " change"]
    change_covariance: Float[np.ndarray, "change change"]
    force_density: Float[np.ndarray, "record dof"]
    force_shape: Float[np.ndarray, "record knot"]
    noise_density: Float[np.ndarray, "record sensor"]
    log_likelihood: float
    bands: tuple[SpectralBand, ...]
    deviance: float
    degrees: int

    @property
    def p_value(self) -> float:
        """Probability of a worse fit over all bands if nothing is missing."""
        return float(scipy.special.chdtrc(self.degrees, max(self.deviance, 0.0)))

    @property
    def misfit(self) -> float:
        """Deviance per degree of freedom; 1 where only noise is left [1]."""
        return self.deviance / self.degrees

    @property
    def sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviations of the constants."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def pulls(self) -> dict[Name, float]:
        """Deviation of each constant from its prior mean, in prior standard deviations."""
        moved = (self.values - self.prior.mean) / self.prior.sd
        return dict(zip(self.prior.names, moved.tolist(), strict=True))

    def failed_bands(self, chance: float = 1e-3) -> tuple[tuple[float, float], ...]:
        """Bands [Hz] in which the test fails, at a level with Bonferroni's correction."""
        # Neighbours that fail are one band; bands of several records that overlap, too.
        level = chance / len(self.bands)
        runs = itertools.groupby(self.bands, lambda one: one.p_value < level)
        failed = [list(run) for fails, run in runs if fails]
        merged: list[tuple[float, float]] = []
        for low, high in sorted((run[0].low_hz, run[-1].high_hz) for run in failed):
            if merged and low <= merged[-1][1]:
                merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
            else:
                merged.append((low, high))
        return tuple(merged)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SpectralProblem:
    """Records, model and changes of one fit.

    The unknowns are, in this order: relative changes of the constants of `prior`; `changes`, in
    units of their scale; of each record, log densities of forces and of their shape at its
    knots, and of noise.
    """

    plant: Plant
    prior: Prior
    records: tuple[RecordLines, ...]
    forces: tuple[int, ...]
    changes: tuple[ConstantChange, ...] = ()
    sensed: Mapping[Name, float] = dataclasses.field(default_factory=dict)
    """Gains [1] and delays [s] of sensors known to be off, by name as in `ConstantChange`."""

    @property
    def free(self) -> int:
        """Number of constants of the prior."""
        return len(self.prior.names)

    @property
    def linear(self) -> int:
        """Number of unknowns that the linear model depends on."""
        return self.free + len(self.changes)

    @property
    def sensors(self) -> int:
        """Number of sensors."""
        return int(self.records[0].lines.shape[1])

    def densities(self, record: int) -> slice:
        """Places of the log densities of forces of one record."""
        size = len(self.forces) + SHAPE_KNOTS + self.sensors
        first = self.linear + record * size
        return slice(first, first + len(self.forces))

    def shape(self, record: int) -> slice:
        """Places of the log shape of the forces of one record."""
        first = self.densities(record).stop
        return slice(first, first + SHAPE_KNOTS)

    def noise(self, record: int) -> slice:
        """Places of the log densities of noise of one record."""
        first = self.shape(record).stop
        return slice(first, first + self.sensors)

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return int(self.noise(len(self.records) - 1).stop)

    def described(self, at: Unknowns, record: int) -> Description:
        """Describe the linear model of one record."""
        return with_values(self.plant.description, self.constants(at, record))

    def constants(self, at: Unknowns, record: int) -> dict[Name, float]:
        """Give the constants of one record that are not those of the description."""
        values = dict(self.sensed) | dict(
            zip(
                self.prior.names,
                (self.prior.mean * (1 + at[: self.free])).tolist(),
                strict=True,
            )
        )
        for change, size in zip(self.changes, at[self.free : self.linear], strict=True):
            if change.record in (None, record):
                before = values.get(change.constant, self._nominal(change.constant))
                values[change.constant] = before + change.scale * float(size)
        return values

    def _nominal(self, constant: Name) -> float:
        entry = self.plant.entries.get(constant)
        return float(constant[0] == "gain") if entry is None else entry.value

    def responses(self, at: Unknowns, record: int) -> Responses:
        """Return readings of the sensors for each unit of force, at the lines of a record."""
        linear = LinearModel.of(self.described(at, record))
        frequency = self.records[record].frequency_hz
        seen = linear.sensor_response(frequency, linear.compliance(frequency))
        told = np.asarray(seen[:, :, list(self.forces)])
        values = self.constants(at, record)
        for i, sensor in enumerate(self.plant.description.sensors):
            gain = values.get(("gain", sensor.channel), 1.0)
            delay_s = values.get(("delay", sensor.channel), 0.0)
            if (gain, delay_s) != (1.0, 0.0):
                told[:, i] *= gain * np.exp(-2j * np.pi * frequency * delay_s)[:, None]
        return told

    def with_changes(self, *changes: ConstantChange) -> "SpectralProblem":
        """Copy the problem with other changes."""
        return dataclasses.replace(self, changes=changes)


def spectral_problem(plant: Plant, trials: Sequence[Trial]) -> SpectralProblem:
    """Take the spectral lines of ambient records.

    Parameters
    ----------
    plant
        Without inputs and effects; its tolerances are the prior.
    trials
        Records; gaps are taken for zeros, so cut them at long ones.

    Raises
    ------
    ValueError
        Where the model has inputs or effects, or nothing drives the structure in a record.
    """
    description = plant.description
    if description.inputs or plant.effects:
        raise ValueError(
            "This model has inputs or effects, which spectra alone cannot be compared with. "
            "Use refit and locate where the input was measured."
        )
    top = BAND_MARGIN * response_limit_hz(description, trials)
    chosen = sensors_of_different_nodes(description)
    plant = dataclasses.replace(
        plant,
        description=dataclasses.replace(
            description, sensors=tuple(description.sensors[i] for i in chosen)
        ),
    )
    records = []
    for trial in trials:
        # Every second line: neighbouring lines of a tapered record are correlated.
        frequency, spectrum = transform(
            detrended(trial.measured[:, chosen]), trial.rate_hz, taper="hann"
        )
        kept = slice(2, int(np.searchsorted(frequency[:-1], top, side="right")), 2)
        records.append((frequency[kept], spectrum[kept]))
    linear = LinearModel.of(plant.description)
    structure = linear.structure
    forces = (
        range(structure.dofs)
        if structure.influence is None
        else np.flatnonzero(structure.influence).tolist()
    )
    driven = tuple(driven_lines(linear, *one) for one in records)
    if not all(len(one.frequency_hz) for one in driven):
        raise ValueError(
            "No part of the spectrum of a record is driven by a random force: it is a tone, or "
            "a decay that is hidden by noise. Give a longer record, one of a free decay from "
            "its release, or one with its measured force."
        )
    return SpectralProblem(plant, prior_of(plant), driven, tuple(forces))


def fit_spectra(
    problem: SpectralProblem, start: AmbientFit | None = None, begin: float = 0.0
) -> AmbientFit:
    """Fit the unknowns of a problem by Fisher scoring.

    Parameters
    ----------
    start
        A fit of the same records without changes, to start from.
    begin
        Size of the changes to start from, in units of their scale.
    """
    at = initial_unknowns(problem) if start is None else _unknowns_of(problem, start)
    at[problem.free : problem.linear] = begin
    cost, score, information = score_and_information(problem, at)
    damping = 1e-3
    for _ in range(MAX_STEPS):
        step = _inverse(information, damping) @ score
        tried = at + np.clip(step, -MAX_STEP, MAX_STEP)
        lower = _cost(problem, tried)
        if not lower < cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        gain, at, damping = cost - lower, tried, damping / 10
        cost, score, information = score_and_information(problem, at)
        if gain < MIN_GAIN:
            break
    return _result(problem, at, _inverse(information))


def expected_gains(
    problem: SpectralProblem, start: AmbientFit, places: Sequence[Sequence[ConstantChange]]
) -> list[float]:
    """Gain of log likelihood [nats] that changes of each place promise, by the score test.

    Source: C. R. Rao, "Large sample tests of statistical hypotheses", Proc. Camb. Phil. Soc. 44
    (1948).
    """
    if len(places) > MOST_AT_ONCE:
        rest = expected_gains(problem, start, places[MOST_AT_ONCE:])
        return expected_gains(problem, start, places[:MOST_AT_ONCE]) + rest
    whole = problem.with_changes(*itertools.chain.from_iterable(places))
    _, score, information = score_and_information(whole, _unknowns_of(whole, start))
    common = [*range(problem.free), *range(whole.linear, whole.unknowns)]
    gains, first = [], problem.free
    for changes in places:
        own = [*common, *range(first, first + len(changes))]
        first += len(changes)
        gain = score[own] @ _inverse(information[np.ix_(own, own)]) @ score[own]
        gains.append(float(gain) / 2)
    return gains


def best_begin(
    problem: SpectralProblem, start: AmbientFit, sizes: Float[np.ndarray, " size"]
) -> tuple[float, float]:
    """Size of the one change of a problem that fits best [scales], and its gain [nats]."""
    at = _unknowns_of(problem, start)
    costs = []
    for size in (0.0, *sizes.tolist()):
        at[problem.free] = size
        costs.append(_cost(problem, at))
    best = int(np.argmin(costs))
    return float((0.0, *sizes.tolist())[best]), costs[0] - costs[best]


def _inverse(
    information: Float[np.ndarray, "unknown unknown"], damping: float = 0.0
) -> Float[np.ndarray, "unknown unknown"]:
    """Invert an information matrix whose unknowns differ in how well they are known."""
    scale = 1 / np.sqrt(np.diag(information))
    scaled = information * np.outer(scale, scale) + damping * np.eye(len(scale))
    return np.asarray(np.outer(scale, scale) * np.linalg.pinv(scaled, hermitian=True))


def initial_unknowns(problem: SpectralProblem) -> Unknowns:
    """Start with nominal constants, forces of the measured power, and noise well below."""
    at = np.zeros(problem.unknowns)
    for number, record in enumerate(problem.records):
        power = np.abs(record.lines) ** 2
        unit = np.sum(np.abs(problem.responses(at, number)) ** 2, axis=2)
        at[problem.densities(number)] = np.log(
            np.median(power.mean(axis=0) / unit.mean(axis=0))
        )
        at[problem.noise(number)] = np.log(np.percentile(power, 20, axis=0) / 2)
    return at


def _unknowns_of(problem: SpectralProblem, start: AmbientFit) -> Unknowns:
    at = np.zeros(problem.unknowns)
    at[: problem.free] = start.values / problem.prior.mean - 1
    for number in range(len(problem.records)):
        density = start.force_density[number, list(problem.forces)]
        at[problem.densities(number)] = np.log(density)
        at[problem.shape(number)] = start.force_shape[number]
        at[problem.noise(number)] = np.log(start.noise_density[number])
    return at


def _spectral_matrix(problem: SpectralProblem, at: Unknowns, record: int) -> Matrices:
    return _matrix_of(problem, at, record, problem.responses(at, record))


def _matrix_of(
    problem: SpectralProblem, at: Unknowns, record: int, responses: Responses
) -> Matrices:
    scaled = _scaled(problem, at, record, responses)
    noise = np.exp(at[problem.noise(record)]) * np.eye(problem.sensors)
    return np.asarray(scaled @ scaled.conj().swapaxes(1, 2) + noise)


def _scaled(
    problem: SpectralProblem, at: Unknowns, record: int, responses: Responses
) -> Responses:
    """Responses times the roots of the densities of the forces."""
    one = problem.records[record]
    root = np.exp(one.shapes @ at[problem.shape(record)] / 2)
    return np.asarray(
        responses * np.exp(at[problem.densities(record)] / 2) * root[:, None, None]
    )


def _log_likelihood(sigma: Matrices, lines: Lines) -> float:
    factor = np.linalg.cholesky(sigma)
    white = np.linalg.solve(factor, lines[:, :, None])[:, :, 0]
    logdet = 2 * np.sum(np.log(np.einsum("fss->fs", factor).real))
    return -float(logdet + np.sum(np.abs(white) ** 2))


def _cost(problem: SpectralProblem, at: Unknowns) -> float:
    """Minus the log likelihood, plus half the squared deviations from the prior."""
    try:
        total = sum(
            _log_likelihood(_spectral_matrix(problem, at, number), record.lines)
            for number, record in enumerate(problem.records)
        )
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.sum(_deviations(problem, at) ** 2)) / 2 - total


def _weights(problem: SpectralProblem) -> Unknowns:
    """Inverse prior standard deviations of the unknowns."""
    weights = np.zeros(problem.unknowns)
    weights[: problem.free] = problem.prior.mean / problem.prior.sd
    weights[problem.free : problem.linear] = 1.0
    for number in range(len(problem.records)):
        weights[problem.densities(number)] = 1 / DENSITY_SD
        weights[problem.shape(number)] = 1 / SHAPE_SD
    return weights


def _deviations(problem: SpectralProblem, at: Unknowns) -> Unknowns:
    """Deviations from the prior, in its standard deviations."""
    deviations = at.copy()
    for number in range(len(problem.records)):
        # Densities deviate from the mean of their record, which itself is free.
        own = problem.densities(number)
        deviations[own] -= deviations[own].mean()
    return np.asarray(deviations * _weights(problem))


def score_and_information(
    problem: SpectralProblem, at: Unknowns
) -> tuple[float, Unknowns, Float[np.ndarray, "unknown unknown"]]:
    """Cost [nats], its negative gradient and Fisher information."""
    size = len(at)
    score, information = np.zeros(size), np.zeros((size, size))
    for number, record in enumerate(problem.records):
        places, slopes = _slopes(problem, at, number)
        inverse = np.linalg.inv(_spectral_matrix(problem, at, number))
        weighted = inverse @ record.lines[:, :, None]
        turned = [inverse @ slope for slope in slopes]
        for place, slope, one in zip(places, slopes, turned, strict=True):
            fit = (weighted.conj().swapaxes(1, 2) @ slope @ weighted)[:, 0, 0].real
            score[place] += float(fit.sum() - np.einsum("fss->", one).real)
        flat = np.array([one.ravel() for one in turned])
        back = np.array([one.swapaxes(1, 2).ravel() for one in turned])
        information[np.ix_(places, places)] += (flat @ back.T).real
    weights, deviations = _weights(problem), _deviations(problem, at)
    # Noise far below the response has no information of its own, and must not make it singular.
    information[np.arange(size), np.arange(size)] += np.maximum(weights**2, 1e-6)
    return _cost(problem, at), score - deviations * weights, information


def _slopes(
    problem: SpectralProblem, at: Unknowns, record: int
) -> tuple[list[int], list[Matrices]]:
    """Return derivatives of the spectral matrix of a record, and their unknowns."""
    places, slopes = [], []
    for i in range(problem.linear):
        own = problem.changes[i - problem.free].record if i >= problem.free else None
        if own not in (None, record):
            continue
        step = DIFFERENCE_STEP * np.eye(len(at))[i]
        ahead, behind = (_spectral_matrix(problem, at + s, record) for s in (step, -step))
        places.append(i)
        slopes.append((ahead - behind) / (2 * DIFFERENCE_STEP))
    scaled = _scaled(problem, at, record, problem.responses(at, record))
    densities = problem.densities(record)
    for column, place in enumerate(range(densities.start, densities.stop)):
        one = scaled[:, :, column]
        places.append(place)
        slopes.append(one[:, :, None] * one[:, None, :].conj())
    whole = scaled @ scaled.conj().swapaxes(1, 2)
    shapes = problem.shape(record)
    for column, place in enumerate(range(shapes.start, shapes.stop)):
        places.append(place)
        slopes.append(problem.records[record].shapes[:, column, None, None] * whole)
    shape = slopes[-1].shape
    noise = problem.noise(record)
    for column, place in enumerate(range(noise.start, noise.stop)):
        slope = np.zeros(shape, dtype=complex)
        slope[:, column, column] = np.exp(at[place])
        places.append(place)
        slopes.append(slope)
    return places, slopes


def _result(
    problem: SpectralProblem,
    at: Unknowns,
    covariance: Float[np.ndarray, "unknown unknown"],
) -> AmbientFit:
    free, linear = problem.free, problem.linear
    mean = problem.prior.mean
    scale = np.array([change.scale for change in problem.changes])
    tests = [_covariance_tests(problem, at, number) for number in range(len(problem.records))]
    density = np.zeros(
        (len(problem.records), LinearModel.of(problem.plant.description).structure.dofs)
    )
    shape = np.zeros((len(problem.records), SHAPE_KNOTS))
    for number, record in enumerate(problem.records):
        # Densities are means over the lines; the shape has the mean 1.
        log_shape = at[problem.shape(number)]
        mean_shape = float(np.mean(np.exp(record.shapes @ log_shape)))
        density[number, list(problem.forces)] = (
            np.exp(at[problem.densities(number)]) * mean_shape
        )
        shape[number] = log_shape - np.log(mean_shape)
    likelihood = sum(
        _log_likelihood(_spectral_matrix(problem, at, number), record.lines)
        for number, record in enumerate(problem.records)
    )
    pulls = _deviations(problem, at)[:free]
    return AmbientFit(
        prior=problem.prior,
        values=mean * (1 + at[:free]),
        covariance=covariance[:free, :free] * np.outer(mean, mean),
        changes=problem.changes,
        change_values=at[free:linear] * scale,
        change_covariance=covariance[free:linear, free:linear] * np.outer(scale, scale),
        force_density=density,
        force_shape=shape,
        noise_density=np.exp(
            [at[problem.noise(number)] for number in range(len(problem.records))]
        ),
        log_likelihood=likelihood - float(pulls @ pulls) / 2,
        bands=tuple(itertools.chain.from_iterable(bands for bands, _, _ in tests)),
        deviance=sum(deviance for _, deviance, _ in tests),
        degrees=sum(degrees for _, _, degrees in tests),
    )


def _covariance_tests(
    problem: SpectralProblem, at: Unknowns, record: int
) -> tuple[tuple[SpectralBand, ...], float, int]:
    r"""Test in bands whether the covariance of the whitened lines is the unit matrix.

    For the mean :math:`A` of :math:`n` products :math:`z z^H` of :math:`s` components,
    :math:`2 n (\mathrm{tr} A - \log \det A - s)` is close to chi squared with :math:`s^2`
    degrees; the factor that makes its mean right is known in closed form.
    """
    one = problem.records[record]
    factor = np.linalg.cholesky(_spectral_matrix(problem, at, record))
    white = np.linalg.solve(factor, one.lines[:, :, None])[:, :, 0]
    sensors = white.shape[1]
    count = max(len(white) // max(6 * sensors, 24), 1)
    bands, total = [], 0.0
    for part in np.array_split(np.arange(len(white)), count):
        own = white[part]
        mean = own.T @ own.conj() / len(own)
        trace = float(np.trace(mean).real)
        lines = len(own) * np.ones(sensors) - np.arange(sensors)
        expected = -float(np.sum(scipy.special.digamma(lines) - np.log(len(own))))
        distance = trace - float(np.linalg.slogdet(mean)[1]) - sensors
        deviance = distance * sensors**2 / expected
        total += deviance
        bands.append(
            SpectralBand(
                low_hz=float(one.frequency_hz[part[0]]),
                high_hz=float(one.frequency_hz[part[-1]]),
                p_value=float(scipy.special.chdtrc(sensors**2, max(deviance, 0.0))),
            )
        )
    return tuple(bands), total, count * sensors**2
