"""Several effects that leave much, in; the same, fitted to ever longer records again, out.

Each was fitted while others were missing, to whole records, and made up for them. Beside the
others, and over how records begin, it finds back to what it is.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.dynamics.effects import Friction, Kind

from .found import Found
from .further import FAR_OFF, left_by
from .gap import UNWHITE, whiteness
from .naming import GRADUALLY, SLOWLY
from .openings import begun
from .refit import WRONG, GivenUp, first_swings, refit
from .verdict import hardly_any


def regrow(found: Found, kinds: Mapping[str, Kind]) -> None:
    """Fit the last model anew where it leaves more than a right one; keep what leaves less."""
    if found.fits[-1].chi2_in_band >= WRONG:
        _regrow(found, kinds, GRADUALLY)


def regrow_friction(found: Found, kinds: Mapping[str, Kind]) -> None:
    """Fit friction that was found alone anew; keep what leaves less.

    It sticks at an instant or does not, and its misfit has a minimum for either.
    """
    last = found.fits[-1]
    one = found.answers[0].effect if len(found.answers) == 1 else None
    if one is None or not isinstance(kinds[one.kind].action, Friction):
        return
    little = last.chi2_in_band < FAR_OFF and not hardly_any(last, found.fits[0])
    if little and whiteness(last) < UNWHITE:
        _regrow(found, kinds, SLOWLY)


def _regrow(found: Found, kinds: Mapping[str, Kind], horizons: Sequence[float]) -> None:
    last, trials = found.fits[-1], found.trials
    if len(last.states) != len(trials) or found.holds is not None or found.ended:
        return
    try:
        start = begun(last, first_swings(last.plant, trials))
        again = refit(
            last.plant, trials, values=last.values, states=start.states, horizons=horizons
        )
    except (np.linalg.LinAlgError, FloatingPointError, GivenUp):
        return
    if left_by(again) < left_by(last):
        found.put_last(again, kinds)
