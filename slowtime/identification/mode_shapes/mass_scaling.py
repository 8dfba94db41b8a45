r"""Scaling of operational mode shapes by known added masses.

A test without measured forces leaves the scale of a shape open. Repeated with known masses
added, the frequencies fall by what the shape moves at these masses. From the eigenvalue
equations without and with the masses, :math:`K \phi_0 = \omega_0^2 M \phi_0` and
:math:`K \phi_1 = \omega_1^2 (M + \Delta M) \phi_1`, follows for mass-normalised shapes
:math:`\phi = \alpha \psi` that the masses barely change

.. math:: \alpha^2 = \frac{\omega_0^2 - \omega_1^2}
          {\omega_1^2 \; \psi_0^T \Delta M \, \psi_1} .

References
----------
.. [1] E. Parloo, P. Verboven, P. Guillaume, M. Van Overmeire, "Sensitivity-based operational
   mode shape normalisation", MSSP 16 (2002).
.. [2] M. López-Aenlle, R. Brincker, F. Pelayo, A. F. Canteli, "On exact and approximated
   formulations for scaling-mode shapes in operational modal analysis by mass and stiffness
   change", J. Sound and Vibration 331 (2012).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.identification.estimates import Measured
from slowtime.identification.modes import Mode

from .agreement import Agreement, weighted_mean
from .criteria import mac, real_shape

ALIKE = 0.9
"""[1] Least modal assurance criterion of a shape without and with the masses. Below, the masses
change the mode too much for the formula, whose error is of the order of 1 - MAC."""

DISTINCT = 2.0
"""[standard deviations] Least fall of the frequency."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MassScaling:
    """Scale of one mode.

    Parameters
    ----------
    modal_mass
        Of the real shape of unit norm [kg].
    factor
        alpha: the mass-normalised shape is alpha times the real shape of unit norm
        [kg^(-1/2)].
    shape
        Mass-normalised [kg^(-1/2)].
    flags
        `shape_changed`, `masses_disagree`.
    """

    modal_mass: Measured
    factor: Measured
    shape: Float[np.ndarray, " channel"]
    agreement: Agreement
    flags: tuple[str, ...]


def scale_by_masses(
    before: Mode, after: Sequence[Mode], masses_kg: Sequence[Float[np.ndarray, " channel"]]
) -> MassScaling:
    """Scale one mode by its frequencies with added masses.

    Parameters
    ----------
    masses_kg
        Mass added at each channel, in each set [kg]. A mass moves in every direction: where a
        place has several channels, it stands at each of them.

    Raises
    ------
    ValueError
        Where no frequency fell beyond its error, or sizes do not fit.
    """
    if len(after) != len(masses_kg) or not after:
        raise ValueError(
            f"{len(after)} modes with {len(masses_kg)} sets of masses were given. Give one "
            "each."
        )
    shape = real_shape(before.shape)
    found, flags = [], []
    for mode, masses in zip(after, masses_kg, strict=True):
        found.append(_squared_factor(before, mode, shape, np.asarray(masses, dtype=float)))
        if mac(before.shape, mode.shape) < ALIKE:
            flags.append("shape_changed")
    squared, agreement, _ = weighted_mean(found)
    if not agreement.holds:
        flags.append("masses_disagree")
    factor = float(np.sqrt(squared.value))
    sd = squared.sd / (2 * factor)
    return MassScaling(
        modal_mass=Measured(1 / squared.value, squared.sd / squared.value**2),
        factor=Measured(factor, sd),
        shape=factor * shape,
        agreement=agreement,
        flags=tuple(dict.fromkeys(flags)),
    )


def _squared_factor(
    before: Mode, after: Mode, shape: np.ndarray, masses: np.ndarray
) -> Measured:
    if masses.shape != shape.shape or (masses < 0).any() or not masses.any():
        raise ValueError(
            f"Masses {masses.tolist()} kg were given for {len(shape)} channels. Give one for "
            "each channel, 0 where none was added."
        )
    f0, f1 = before.frequency_hz, after.frequency_hz
    fall = f0.value - f1.value
    fall_sd = float(np.hypot(f0.sd, f1.sd))
    if fall <= DISTINCT * fall_sd:
        raise ValueError(
            f"The frequency fell by {fall:.4g} ± {fall_sd:.2g} Hz with the masses, which is "
            f"not beyond {DISTINCT:g} standard deviations. Add more mass where the mode moves, "
            "or record longer."
        )
    other = real_shape(after.shape)
    other = other * np.sign(other @ shape)
    moved = float(shape @ (masses * other))
    value = (f0.value**2 - f1.value**2) / (f1.value**2 * moved)
    # By the frequencies, and by the two shapes at the masses.
    of_frequency = 2 * f0.value**2 / f1.value**2 * np.hypot(f0.sd / f0.value, f1.sd / f1.value)
    of_frequency *= 1 / moved
    at = np.sqrt(0.5) * np.concatenate(
        [masses * other * before.shape_sd, masses * shape * after.shape_sd]
    )
    of_shape = value / moved * float(np.linalg.norm(at))
    return Measured(value, float(np.hypot(of_frequency, of_shape)))
