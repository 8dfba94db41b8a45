"""The standard family of degradation laws; an owner's own joins it by name."""

from .curve_posterior import CurveLaw
from .curves import (
    BENT,
    BREATHING,
    CRACK,
    EXPONENTIAL,
    FADE,
    LINEAR,
    LOGISTIC,
    POWER,
    RUNAWAY,
    SEASONAL,
    STEPPED,
)
from .gamma_process import GammaLaw
from .law import DegradationLaw
from .wiener import WienerLaw

STANDARD: tuple[DegradationLaw, ...] = (
    CurveLaw(LINEAR),
    CurveLaw(FADE),
    CurveLaw(POWER),
    CurveLaw(LOGISTIC),
    CurveLaw(CRACK),
    CurveLaw(EXPONENTIAL),
    CurveLaw(RUNAWAY),
    CurveLaw(BREATHING),
    CurveLaw(SEASONAL),
    CurveLaw(BENT),
    CurveLaw(STEPPED),
    WienerLaw(),
    WienerLaw("reverting walk", reverts=True),
    GammaLaw(),
)
"""The laws beside the Gaussian processes."""

PRIOR_WEIGHTS: dict[str, float] = {
    "linear drift": 2.0,
    "exponential fade": 2.0,
    "Paris crack": 2.0,
}
"""Prior weights of the laws, up to a common factor [1]; 1 for a law that is not named here.

Over 600 hidden histories of two generators, with seeds other than those of
docs/remaining_life.md, no weights between a half and four were better than flat ones by more
than 2 % of the Brier score. Those of the book, and the plainest, count double; so does a crack,
which only accelerates late, when its readings can show it.
"""
