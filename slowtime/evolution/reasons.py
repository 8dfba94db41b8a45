"""Reasons why an estimate is not valid, as bit flags with a sentence each."""

import enum
import functools


class Reason(enum.IntFlag):
    """What stands against an estimate; none of them set means valid."""

    NOT_FINITE = 1
    NOT_POSITIVE = 2
    NEGATIVE_SD = 4
    BEYOND_RECOMMENDED = 8
    TOO_UNCERTAIN = 16
    NO_SUCH_MASS = 32
    OUTSIDE_BOUNDS = 64
    DAMPING_UNKNOWN = 128
    DAMPING_UNCERTAIN = 256
    NOT_SEPARABLE = 512


RECOMMENDED_DISTANCE = 0.3
"""Shift of frequency over the nominal one at which the nominal model loses its meaning."""

UNCERTAIN_RATIO = 0.2
"""Relative standard deviation of a frequency above which corrections break down."""

UNCERTAIN_DAMPING = 0.25
"""Relative standard deviation of damping above which it cannot stand for the mass."""

FAR_OUTSIDE = 4.0
"""Standard deviations beyond a bound at which the bound contradicts the reading."""

_SENTENCES = {
    Reason.NOT_FINITE: (
        "The frequency or its standard deviation is NaN or infinite. Nothing is estimated from "
        "it; look at the sensor and at the identification of that epoch."
    ),
    Reason.NOT_POSITIVE: (
        "The frequency is zero or negative, which no structure that vibrates has. Nothing is "
        "estimated from it; look at the band in which the mode is sought."
    ),
    Reason.NEGATIVE_SD: (
        "A standard deviation is negative. Nothing is estimated from it; give zero for exact "
        "data, and a positive number otherwise."
    ),
    Reason.BEYOND_RECOMMENDED: (
        f"The frequency has moved by {RECOMMENDED_DISTANCE:g} of the nominal one or more, "
        "outside the recommended range of the nominal model. Find out what has changed and "
        "give a new nominal model; or check that the mode is still the same one."
    ),
    Reason.TOO_UNCERTAIN: (
        f"The frequency is known to no better than {UNCERTAIN_RATIO:.0%}, too little for its "
        "square or its inverse square to be estimated well. Record for longer, or average more "
        "epochs before asking."
    ),
    Reason.NO_SUCH_MASS: (
        "No mass gives so high a damped frequency with the nominal stiffness and damping: the "
        "ratio cannot exceed 1/(2 damping_ratio_0). The stiffness has changed, or "
        "damping_ratio_0 is wrong."
    ),
    Reason.OUTSIDE_BOUNDS: (
        f"The reading lies more than {FAR_OUTSIDE:g} standard deviations outside the physical "
        "bounds, which therefore decide the answer. Widen the bounds, or check the nominal "
        "frequency and the standard deviations."
    ),
    Reason.DAMPING_UNKNOWN: (
        "No positive damping ratio with a standard deviation was measured, so frequency alone "
        "speaks, and it knows only stiffness over mass. Identify the damping too, from a free "
        "decay or a longer ambient record."
    ),
    Reason.DAMPING_UNCERTAIN: (
        f"The damping is known to no better than {UNCERTAIN_DAMPING:.0%}, and its relative "
        "error passes one to one into mass and stiffness. Record for longer (the error falls "
        "with the root of the number of cycles), or excite the structure and fit free decays."
    ),
    Reason.NOT_SEPARABLE: (
        "Mass and stiffness are not separately identifiable from these readings: the answer "
        "repeats what was assumed about them. A known added mass, a measured force, a log of "
        "the mass (fuel, load), a static test of stiffness or a steadier, better known damping "
        "would tell them apart. Stiffness over mass is known all the same."
    ),
}


@functools.lru_cache(maxsize=1024)
def explain(reasons: int) -> tuple[str, ...]:
    """Sentences for the flags of an estimate, each with a remedy.

    Parameters
    ----------
    reasons
        Bit flags.

    Returns
    -------
    One sentence per flag.

    Examples
    --------
    >>> explain(0)
    ()
    >>> explain(int(Reason.NEGATIVE_SD))[0][:33]
    'A standard deviation is negative.'
    """
    known = functools.reduce(int.__or__, (int(flag) for flag in Reason))
    if reasons < 0 or reasons & ~known:
        raise ValueError(
            f"{reasons=} holds bits that mean nothing. Give a combination of Reason, "
            f"an integer from 0 to {known}."
        )
    return tuple(_SENTENCES[flag] for flag in Reason if flag & reasons)
