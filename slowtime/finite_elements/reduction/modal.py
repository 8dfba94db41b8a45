"""Modal reduction over parameters, with static responses to loads."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.finite_elements.eigenvalues import modes_below
from slowtime.finite_elements.factorization import SymmetricFactor
from slowtime.finite_elements.parametric_matrices import ParametricMatrices

from .adaptive_model import AdaptiveModel, FactoredParts
from .candidates import BasisSettings, candidates_of
from .verification import verify

NEGLIGIBLE = 1e-4
"""Eigenvalue of a part over that of the whole stiffness [1] below which it is left out."""

BAND = 1.5
"""Highest frequency of the modes kept over the upper end of the sensor band [1]: modes above
the band still move its spectra; 1.5 to 2 is the usual range."""


def reduce_modal(
    model: ParametricMatrices,
    settings: BasisSettings,
    *,
    loads: Float[np.ndarray, "load dof"] | None = None,
    trials: int = 2,
) -> AdaptiveModel:
    """Reduce a model to its lowest modes and their responses to the parameters.

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
    sets = 3 if model.mass_family.acts else 2
    room = max(0, settings.coordinates // sets - settings.modes)
    settings = dataclasses.replace(settings, guard=min(settings.guard, room))
    reduced = _adaptive(model, settings, exact)
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


def _adaptive(
    model: ParametricMatrices,
    settings: BasisSettings,
    exact: Float[np.ndarray, "own exact"] | None,
) -> AdaptiveModel:
    space = candidates_of(model, settings, exact)
    modes = space.inside(space.nominal.shapes)
    fixed = modes if exact is None else np.concatenate([modes, space.inside(exact)], axis=1)
    # Relative to the norm of the modes in A, which orders them alike.
    scale = np.linalg.norm(modes, axis=0)
    return AdaptiveModel(
        names=model.names,
        candidates=space.vectors,
        stiffness=space.stiffness,
        mass=space.mass,
        stiffness_parts=FactoredParts.of(space.stiffness_parts, NEGLIGIBLE),
        mass_parts=FactoredParts.of(
            space.mass_parts, NEGLIGIBLE * float(np.linalg.norm(space.mass, 2))
        ),
        fixed=fixed / np.linalg.norm(fixed, axis=0),
        responses=space.stiffness_parts @ (modes / scale),
        mass_responses=space.mass_parts @ (modes / scale),
        dofs=model.dofs,
        expansion=model.expansion,
    )


def settings_for_band(
    model: ParametricMatrices, band_hz: float, settings: BasisSettings
) -> BasisSettings:
    """Set the number of modes by the band of the sensors.

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
