"""Several effects that leave much, in; the same, fitted to ever longer records again, out.

Each was fitted while others were missing, to whole records, and made up for them. Beside the
others, and over how records begin, it finds back to what it is.
"""

from collections.abc import Mapping

import numpy as np

from slowtime.dynamics.effects import Kind

from .found import Found
from .further import left_by
from .naming import GRADUALLY
from .openings import beginnings, begun
from .pruning import all_told_again
from .refit import WRONG, GivenUp, refit


def regrow(found: Found, kinds: Mapping[str, Kind]) -> None:
    """Fit the last model anew where it leaves more than a right one; keep what leaves less."""
    last, trials = found.fits[-1], found.trials
    if last.chi2_in_band < WRONG or len(last.states) != len(trials) or found.holds is not None:
        return
    try:
        start = begun(last, beginnings(last, trials))
        again = refit(
            last.plant, trials, values=last.values, states=start.states, horizons=GRADUALLY
        )
    except (np.linalg.LinAlgError, FloatingPointError, GivenUp):
        return
    if left_by(again) < left_by(last):
        found.fits[-1] = again
        found.answers = all_told_again(found.answers, again, kinds)
