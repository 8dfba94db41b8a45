r"""Mode shapes, participation and modal masses from residues.

The residues of a mode form a matrix of rank one, of outputs by inputs, :math:`R = \psi L^T`. If
an output is measured where an input acts, in its direction (driving point d), reciprocity
gives the scale: with :math:`R_{dd} = \phi_d^2 / (2 j \omega_d)` for a lightly damped mode
whose modal mass is 1,

.. math:: m = \frac{1}{2 j \, \omega_d \, R_{dd}}

is the modal mass of the shape whose driving point deflects by 1.

References
----------
.. [1] W. Heylen, S. Lammens, P. Sas, "Modal Analysis Theory and Testing", KU Leuven (1997),
   section A.1.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.scaling import normalise_with_errors
from slowtime.identification.modes import Mode

from .basis import pole_quantities
from .maximum_likelihood import PoleFit


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalConstants:
    """What a measured input tells of a mode beyond its pole and shape.

    Parameters
    ----------
    participation
        Of each input: how strongly it excites the mode, relative to the strongest [1].
    modal_mass
        Of the shape whose driving point deflects by 1 [kg, for forces in N and motion in m];
        None without a driving point.
    """

    residues: Complex[np.ndarray, "output input"]
    participation: Complex[np.ndarray, " input"]
    modal_mass: Measured | None
    driving_point: tuple[int, int] | None


def modes_of_fit(
    fit: PoleFit,
    residues: Complex[np.ndarray, "output input mode"],
    residue_sd: Float[np.ndarray, "output input mode"],
    *,
    quality: Sequence[float],
    flags: tuple[str, ...] = (),
) -> tuple[Mode, ...]:
    """Modes with shapes and errors."""
    frequency, damping, derivative = pole_quantities(fit.poles)
    modes = []
    count = len(fit.poles)
    for k in range(count):
        covariance = fit.covariance[np.ix_([k, count + k], [k, count + k])]
        both = derivative[k] @ covariance @ derivative[k].T
        sd = np.sqrt(np.diag(both))
        shape, shape_sd = _shape(residues[:, :, k], residue_sd[:, :, k])
        modes.append(
            Mode(
                frequency_hz=Measured(float(frequency[k]), float(sd[0])),
                damping_ratio=Measured(float(damping[k]), float(sd[1])),
                correlation=float(np.clip(both[0, 1] / (sd[0] * sd[1]), -1, 1)),
                shape=shape,
                shape_sd=shape_sd,
                quality=float(quality[k]),
                flags=flags,
            )
        )
    return tuple(modes)


def modal_constants(
    fit: PoleFit,
    residues: Complex[np.ndarray, "output input mode"],
    residue_sd: Float[np.ndarray, "output input mode"],
    driving_points: Sequence[tuple[int, int]] = (),
) -> tuple[ModalConstants, ...]:
    """Residues, participation and modal mass of each mode.

    Driving points are pairs of output and input that are one place and direction, of one sign;
    that counts which the mode moves most, against its error.
    """
    found = []
    for k in range(len(fit.poles)):
        own, sd = residues[:, :, k], residue_sd[:, :, k]
        _, _, vh = np.linalg.svd(own, full_matrices=False)
        line = vh[0] / vh[0][np.argmax(np.abs(vh[0]))]
        best, mass = None, None
        if driving_points:
            clear = [
                abs(own[point]) / max(float(sd[point]), 1e-300) for point in driving_points
            ]
            best = driving_points[int(np.argmax(clear))]
            mass = _modal_mass(fit, k, best, residues, float(sd[best]))
        found.append(
            ModalConstants(
                residues=own, participation=line, modal_mass=mass, driving_point=best
            )
        )
    return tuple(found)


def _modal_mass(
    fit: PoleFit,
    k: int,
    point: tuple[int, int],
    residues: Complex[np.ndarray, "output input mode"],
    sd: float,
) -> Measured:
    """Modal mass at a driving point, the error of the poles in it to first order."""
    omega, residue = fit.poles[k].imag, residues[(*point, k)]
    value = 1.0 / (2j * omega * residue)
    modes = len(fit.poles)
    slope = fit.residue_slope.reshape(*residues.shape, 2 * modes)[(*point, k)]
    relative = slope / residue
    relative[modes + k] += 1.0 / omega
    of_poles = float(relative.real @ fit.covariance @ relative.real)
    return Measured(
        float(value.real),
        float(abs(value) * np.sqrt(0.5 * (sd / abs(residue)) ** 2 + of_poles)),
    )


def _shape(residues: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit-norm shape of a residue matrix of rank one, and its errors."""
    u, size, vh = np.linalg.svd(residues, full_matrices=False)
    variance = (np.abs(vh[0]) ** 2 @ sd.T**2) / size[0] ** 2
    if len(u) == 1:
        return np.ones(1, dtype=complex), np.zeros(1)
    return normalise_with_errors(u[:, 0], np.diag(variance).astype(complex))
