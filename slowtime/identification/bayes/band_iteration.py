"""Iteration of band layout and fit until the bands no longer change."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from slowtime.identification.estimates import Measured

from .band_layout import BandProblem, ModeLayout, band_problem, band_problems, group_modes
from .fit import BandPosterior, fit_coloured_band, rough_fit
from .initial_estimates import InitialEstimate, RecordSpectrum, initial_estimates
from .likelihood import coherence_score, log_posterior
from .model import BandModes, add_guests, parameter_vector

ROUNDS = 3
"""Rounds of band layout and fit, at most."""

SETTLED = 0.2
"""Change of a half-bandwidth (relative) or of a coherence below which no new round is made
[1]."""

FALSE_ALARM = 0.05
"""Significance level of the test for forces with a common part."""


def fit_record(
    record: RecordSpectrum,
    candidates_hz: Float[np.ndarray, " mode"],
    lines: tuple[Measured, ...] = (),
) -> list[BandPosterior]:
    """Fit all bands of a record, in rounds, until their layout no longer changes."""
    found = initial_estimates(record, candidates_hz)
    first = ModeLayout(found, np.eye(len(found), dtype=complex))
    picture = _seen(record, first, lines, coherent=False)
    # Displacements or velocities may have been taken for accelerations, or forces be coloured
    # alike: the tails of modes outside a band are then not what they are taken for. Where a
    # mode hardly exceeds the noise its own band does not tell; all bands together do.
    orders = [dataclasses.replace(record, derivatives=order) for order in range(3)]
    likeliest = max(orders, key=lambda one: _height(one, picture, lines))
    if likeliest.derivatives != record.derivatives:
        record, picture = likeliest, _seen(likeliest, picture, lines, coherent=False)
    coherent = common_forces(record, picture, lines) < FALSE_ALARM
    if coherent:
        picture = _seen(record, first, lines, coherent=True)
    parts = band_problems(record, picture, lines, coherent=coherent)
    return [fit_coloured_band(part.band, part.start) for part in parts]


def _height(record: RecordSpectrum, picture: ModeLayout, lines: tuple[Measured, ...]) -> float:
    """Log-posterior of all bands together, laid out by the picture, under white forces."""
    height = 0.0
    for part in band_problems(record, picture, lines, coherent=False):
        found = parameter_vector(rough_fit(part.band, part.start))
        height += log_posterior(part.band, found, part.start)
    return height


def common_forces(
    record: RecordSpectrum, picture: ModeLayout, lines: tuple[Measured, ...]
) -> float:
    """Probability that modes with independent forces appear as coherent as observed."""
    alone = ModeLayout(picture.guesses, np.eye(len(picture.guesses), dtype=complex))
    together = group_modes(alone.guesses, record.duration_s)
    parts, asked = (
        [band_problem(record, alone, group, lines, coherent=coherent) for group in together]
        for coherent in (False, True)
    )
    statistic, freedom = 0.0, 0
    for part, with_guests in zip(parts, asked, strict=True):
        start = add_guests(with_guests.start, rough_fit(part.band, part.start))
        score, known = coherence_score(with_guests.band, start)
        statistic, freedom = statistic + score, freedom + known
    return float(chdtrc(freedom, statistic)) if freedom else 1.0


def _seen(
    record: RecordSpectrum, picture: ModeLayout, lines: tuple[Measured, ...], *, coherent: bool
) -> ModeLayout:
    """All modes once their bands keep their place."""
    for _ in range(ROUNDS):
        before = picture
        parts = band_problems(record, picture, lines, coherent=coherent)
        picture = _pictured(parts, [rough_fit(part.band, part.start) for part in parts])
        if _settled(before, picture, record.duration_s) or (coherent and len(parts) == 1):
            break
    return picture


def _pictured(parts: list[BandProblem], fits: list[BandModes]) -> ModeLayout:
    """Put what all bands found together; of two bands' coherences their mean is taken."""
    number = sum(len(part.group) for part in parts)
    found: list[InitialEstimate | None] = [None] * number
    coherence = np.zeros((number, number), dtype=complex)
    told = np.zeros((number, number))
    for part, modes in zip(parts, fits, strict=True):
        strength = np.sqrt(np.diag(modes.coherence).real)
        relative = modes.coherence / np.outer(strength, strength)
        order = part.guests + part.group
        for own in range(modes.guests, len(order)):
            found[order[own]] = InitialEstimate(
                float(np.exp(modes.log_frequency[own])),
                float(np.exp(modes.log_damping[own])),
                modes.shapes[:, own] * strength[own],
            )
            for other in range(len(order)):
                if other != own:
                    coherence[order[own], order[other]] += relative[own, other]
                    told[order[own], order[other]] += 1.0
    whole = [guess for guess in found if guess is not None]
    mean = (coherence + coherence.conj().T) / np.maximum(told + told.T, 1.0)
    ascending = np.argsort([guess.frequency_hz for guess in whole])
    mean = _possible(mean + np.eye(number))[np.ix_(ascending, ascending)]
    return ModeLayout(tuple(whole[i] for i in ascending), mean)


def _possible(coherence: np.ndarray) -> np.ndarray:
    """Nearest matrix, about, that a coherence may be: positive, of unit diagonal."""
    values, vectors = np.linalg.eigh(coherence)
    positive = (vectors * np.maximum(values, 0.0)) @ vectors.conj().T
    scale = np.sqrt(np.diag(positive).real)
    return np.asarray(positive / np.outer(scale, scale))


def _settled(before: ModeLayout, after: ModeLayout, duration_s: float) -> bool:
    if group_modes(before.guesses, duration_s) != group_modes(after.guesses, duration_s):
        return False
    old, new = (
        np.log([guess.half_width_hz(duration_s) for guess in each.guesses])
        for each in (before, after)
    )
    change = np.abs(after.coherence - before.coherence).max(initial=0.0)
    return bool(np.all(np.abs(new - old) < SETTLED) and change < SETTLED)
