"""Plant and records in, fitted constants and residuals out."""

from .fit import BREAKDOWNS, Fit, attempt, initial_state_sds, refit, try_refit
from .initial_states import motion_amplitude, multistart_initial_state, state_from_sensors
from .levenberg_marquardt import WRONG_MODEL_CHI2, FitAbandoned, FitControl
from .multiple_shooting import (
    cut_segments,
    first_periods,
    initial_states_of_records,
    lowest_frequency_hz,
    shooting_fit,
    strongest_segments,
)
from .prior import DEFAULT_RELATIVE_SD, Prior, prior_of
from .spectral_weights import SpectralWeights, spectral_weights

__all__ = [
    "BREAKDOWNS",
    "DEFAULT_RELATIVE_SD",
    "WRONG_MODEL_CHI2",
    "Fit",
    "FitAbandoned",
    "FitControl",
    "Prior",
    "SpectralWeights",
    "attempt",
    "cut_segments",
    "first_periods",
    "initial_state_sds",
    "initial_states_of_records",
    "lowest_frequency_hz",
    "motion_amplitude",
    "multistart_initial_state",
    "prior_of",
    "refit",
    "shooting_fit",
    "spectral_weights",
    "state_from_sensors",
    "strongest_segments",
    "try_refit",
]
