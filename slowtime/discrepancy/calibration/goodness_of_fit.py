"""How far what a fit leaves is from the noise of the sensors."""

import scipy.stats

from .fit import Fit


def chi2_p_value(fit: Fit) -> float:
    """Chance of so large a chi squared within the band, were all that is left noise."""
    deviation = (fit.chi2_in_band - 1) / fit.in_band_sd
    return float(scipy.stats.norm.sf(deviation))
