"""Modal reduction over parameters, with static responses to loads."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.finite_elements.eigenvalues import modes_below
from slowtime.finite_elements.factorization import SymmetricFactor
from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .basis import BasisSettings, parametric_basis
from .reduced_model import ReducedModel, project
from .verification import verify

BAND = 1.5
"""Highest frequency of the modes kept over the upper end of the sensor band [1]: modes above
the band still move its spectra; 1.5 to 2 is the usual range."""


def reduce_modal(
    model: ParametricMatrices,
    settings: BasisSettings,
    *,
    loads: Float[np.ndarray, "load dof"] | None = None,
    trials: int = 2,
) -> ReducedModel:
    """Reduce a model to the span of its lowest modes over all parameters.

    Parameters
    ----------
    model
        The full model.
    settings
        Number of modes, range of the parameters, limits of the effort.
    loads
        Rows of forces over all degrees of freedom whose static response is kept (residual
        vectors), such as those of actuators and joints.
    trials
        Random parameters at which the result is verified by full solutions; 0 for none.

    Returns
    -------
    The reduced model, with its error where it was verified.
    """
    exact = None
    if loads is not None:
        factor = SymmetricFactor(model.stiffness)
        if factor.singular:
            raise ValueError(
                "A structure that is free to move has no static response. Leave out the loads, "
                "or hold the structure."
            )
        exact = factor.solve(model.rows(loads).T)
    reduced = project(model, parametric_basis(model, settings, exact=exact))
    if not trials:
        return reduced
    return verify(
        model,
        reduced,
        modes=settings.modes,
        span=settings.span,
        trials=trials,
        seed=settings.seed + 1,
    )


def settings_for_band(
    model: ParametricMatrices, band_hz: float, settings: BasisSettings
) -> BasisSettings:
    """Settings whose number of modes follows from the band of the sensors.

    Parameters
    ----------
    model
        The full model.
    band_hz
        Upper end of the band [Hz].
    settings
        All other settings.

    Returns
    -------
    Settings with the number of modes below 1.5 times the band.

    Raises
    ------
    ValueError
        Where the band holds no mode, or more modes than coordinates.
    """
    found = modes_below(model, BAND * band_hz)
    if found is None:
        found = modes_below(model, BAND * band_hz * (1 + 1e-3))
    if not found or found > settings.coordinates:
        raise ValueError(
            f"{found} modes lie below {BAND * band_hz:g} Hz, {BAND} times the band of "
            f"{band_hz:g} Hz. Allowed are 1 to {settings.coordinates}, the number of "
            "coordinates; give another band or more coordinates."
        )
    return dataclasses.replace(settings, modes=found)
