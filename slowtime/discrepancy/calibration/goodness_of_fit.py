"""Goodness of fit of a model."""

from scipy.special import ndtr

from .fit import Fit


def chi2_p_value(fit: Fit) -> float:
    """Probability of so large a chi squared in band, if the residual is noise."""
    deviation = (fit.chi2_in_band - 1) / fit.in_band_sd
    return float(ndtr(-deviation))
