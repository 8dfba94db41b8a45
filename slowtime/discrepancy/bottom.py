"""What was found, in; the same at the very bottom of its misfit, and numbers read there, out.

While laws are compared, a refit ends where little is gained. Of two numbers that the records
tell only together, as a law's damping and the element's own, that little is a standard
deviation of each.
"""

from collections.abc import Mapping

import numpy as np

from slowtime.dynamics.effects import Kind, Unmeasured

from .found import Found
from .pruning import all_told_again
from .refit import WRONG, refit


def at_bottom(found: Found, own: int, kinds: Mapping[str, Kind]) -> None:
    """Fit the last model once more, to the end, and read all numbers off it.

    Parameters
    ----------
    own
        Effects that the model had as it was given.
    """
    last = found.fits[-1]
    whole = len(last.states) == len(found.trials) and not found.ended
    actions = (kinds[effect.kind].action for effect in last.plant.effects)
    moving = not any(isinstance(action, Unmeasured) for action in actions)
    if not (whole and moving) or last.chi2_in_band > WRONG:
        return
    try:
        fit = refit(
            last.plant, found.trials, noise=last.noise, values=last.values,
            states=last.states, horizons=(1.0,), fine=True,
        )  # fmt: skip
    except (np.linalg.LinAlgError, FloatingPointError):
        return
    found.fits[-1] = fit
    if len(last.plant.effects) == own + len(found.answers):
        found.answers = all_told_again(found.answers, fit, kinds)
