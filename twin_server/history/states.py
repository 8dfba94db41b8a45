"""States of a twin after each features message, as rows of a structured array.

The array is what estimation fills, persistence keeps byte by byte and REST answers from; its
layout is therefore part of the database's format (see `LAYOUT`).
"""

from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int, Shaped

from slowtime.evolution import explain

LAYOUT = 1
"""Number of the layout of `STATE`; another one needs a new database or a migration."""

ESTIMATES = ("frequency_hz", "damping_ratio", "stiffness_change", "mass_change")
"""Quantities a state holds, each as value, sd, lo and hi."""

STATE = np.dtype(
    [
        ("sequence", "<i8"),
        ("t_ns", "<i8"),
        ("slow_time", "<f8"),
        *((name, "<f8", (4,)) for name in ESTIMATES),
        ("correlation", "<f8"),
        ("truth", "<f8", (4,)),
        ("missing_before", "<i8"),
        ("reasons", "<u4"),
        ("notes", "<u4"),
    ]
)
"""One state; NaN where there is nothing to say. `truth` is in the order of `ESTIMATES`."""

States: TypeAlias = Shaped[np.ndarray, " time"]
"""An array of `STATE`."""

ASSUMES_STIFFNESS = 1
ASSUMES_MASS = 2
USED_SMOOTHED = 4
"""Bits of `notes`."""

_COVERED_SHIFT, _COVERED_LEVELS = 8, 255
"""Eight further bits of `notes`: the covered share of a window, in steps of 1/255."""

NO_MODE = 1 << 16
LEARNING = 1 << 17
NO_DAMPING = 1 << 18
NOT_REPRESENTABLE = 1 << 19
NO_MODEL_MODE = 1 << 20
MODEL_MISFIT = 1 << 21
TRAINING = 1 << 22
NO_COVARIATE = 1 << 23
BEYOND_COVARIATES = 1 << 24
MEASURED_BEFORE = 1 << 25
SET_ASIDE = 1 << 26
"""Bits of `reasons` beside those of `slowtime.evolution.Reason`."""

BEGINNING = LEARNING | TRAINING
"""While one of these is set, what there is to compare with is not known yet."""

_OURS = {
    NO_MODE: (
        "No mode was identified in this epoch, so that nothing is estimated from it. Look at "
        "the excitation, the sensor, and the band in which the mode is sought."
    ),
    LEARNING: (
        "The nominal model is still being learnt from the first epochs. Wait, or give the "
        "nominal frequency and damping ratio in the twin's registration."
    ),
    NO_DAMPING: (
        "No damping ratio was found while learning the nominal model, so that mass and "
        "stiffness cannot be told apart. Give the nominal damping ratio in the registration."
    ),
    NOT_REPRESENTABLE: (
        "A change came out infinite or undefined and is left out. Look at the frequency and "
        "its standard deviation."
    ),
    NO_MODEL_MODE: (
        "None of the modes of this epoch is one that the structure had while its model was "
        "learnt, so that nothing is estimated from it. Look at the sensors; or register the "
        "twin again, with a model of the current structure."
    ),
    MODEL_MISFIT: (
        "The modes have moved in a way that no change of the free parameters explains. Look at "
        "the sensors and at the temperature, or let more elements and masses be free in the "
        "registration."
    ),
    TRAINING: (
        "What temperature and load do to the frequencies is still being learnt, and it is "
        "assumed that nothing else changes meanwhile. Wait, or shorten the training under "
        "`covariates` in the registration."
    ),
    NO_COVARIATE: (
        "A covariate of the registration is missing in this epoch, so that what it does cannot "
        "be taken out. Look at its sensor and its name at the edge, or leave it out of "
        "`covariates.names`."
    ),
    BEYOND_COVARIATES: (
        "A covariate is beyond all that was seen in training, so that what it does is a guess. "
        "Register the twin again with a longer `covariates.train_span`."
    ),
    MEASURED_BEFORE: (
        "Earlier windows have measured the time of this one already, so that it is no further "
        "evidence: nothing is learnt from it, and no forecast uses it."
    ),
    SET_ASIDE: (
        "The estimation of this epoch exceeded its budget of work or failed, and its message "
        "was set aside. Look at it with `slowtime twin quarantine`, and release or drop it."
    ),
}

_LEVELS: dict[int, tuple[str, ...]] = {}


def sentences(reasons: int) -> tuple[str, ...]:
    """Return sentences on why a state is not valid.

    Examples
    --------
    >>> sentences(0)
    ()
    >>> sentences(NO_MODE)[0][:23]
    'No mode was identified '
    """
    if reasons not in _LEVELS:
        ours = tuple(text for bit, text in _OURS.items() if reasons & bit)
        _LEVELS[reasons] = ours + explain(reasons & (NO_MODE - 1))
    return _LEVELS[reasons]


def assumed(notes: int) -> tuple[str, ...]:
    """Name the quantities that were assumed, not estimated."""
    return tuple(
        name
        for bit, name in (
            (ASSUMES_STIFFNESS, "stiffness_change"),
            (ASSUMES_MASS, "mass_change"),
        )
        if notes & bit
    )


def note_coverage(states: States, covered: Sequence[float]) -> None:
    """Note in `states` the share of each window that earlier windows have measured [1]."""
    levels = _levels(np.array(covered))
    states["notes"] |= levels << _COVERED_SHIFT
    wholly = levels == _COVERED_LEVELS
    states["reasons"] |= np.where(wholly, MEASURED_BEFORE, 0).astype(np.uint32)


def is_measured_before(covered: float) -> bool:
    """Whether earlier windows have measured all of a window, given the covered share [1]."""
    return bool(_levels(np.array([covered]))[0] == _COVERED_LEVELS)


def covered_share(states: States) -> Float[np.ndarray, " time"]:
    """Share of each state's window that earlier windows had measured [1]."""
    return np.asarray(
        (states["notes"] >> _COVERED_SHIFT & _COVERED_LEVELS) / float(_COVERED_LEVELS)
    )


def sd_factor(covered: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    r"""Factor of the standard deviation of each reading where many are averaged [1].

    Windows of length L at intervals h share samples: the variance of the mean of n of them
    is L/h times that of n independent ones, for :math:`\sum_k \rho_k = L/h` with the
    triangular autocorrelation :math:`\rho_k = \max(1 - |k| h/L, 0)` of overlapping means. The
    covered share is 1 - h/L, so that the factor is :math:`(1 - c)^{-1/2}`; infinite where
    nothing is new.

    References
    ----------
    .. [1] P. D. Welch, "The use of fast Fourier transform for the estimation of power
       spectra", IEEE Trans. Audio Electroacoust. 15 (1967) 70-73: variance of averages of
       overlapping segments.

    Examples
    --------
    >>> sd_factor(np.array([0.0, 0.75, 1.0])).round(2).tolist()
    [1.0, 2.0, inf]
    """
    new = 1.0 - _levels(covered) / float(_COVERED_LEVELS)
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.sqrt(new))


def _levels(covered: Float[np.ndarray, " time"]) -> Int[np.ndarray, " time"]:
    steps = np.rint(_COVERED_LEVELS * np.clip(covered, 0.0, 1.0))
    return np.asarray(steps, dtype=np.uint32)


def blank(count: int) -> States:
    """Return `count` empty states."""
    states: States = np.zeros(count, STATE)
    for name in (*ESTIMATES, "truth"):
        states[name] = np.nan
    return states


def from_bytes(rows: Iterable[bytes]) -> States:
    """States out of the bytes they were kept as, a row or many at a time."""
    return np.frombuffer(b"".join(rows), STATE)


def shown(states: States) -> Sequence[str]:
    """Name the quantities that vary in `states`: those that a plot shows."""
    return [name for name in ESTIMATES if np.ptp(np.nan_to_num(states[name][:, 0])) > 0]
