r"""Damping matrices: Rayleigh, modal, Caughey, and fitted damping ratios.

Each gives a matrix that the undamped modes :math:`X` make diagonal,

.. math:: X^T C X = \operatorname{diag}(2 \zeta_j \omega_j) ,

so that motion stays a sum of real modes (section 3.4). The book's text of these equations is
lost; the forms here are derived anew, and each is checked against this very property.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float

from .structure import Structure

Square = Float[np.ndarray, "dof dof"]
Series = Float[np.ndarray, " mode"]

COMMUTING = 1e-10
"""Relative difference of Caughey and O'Kelly's products below which it is rounding."""


def non_proportionality(structure: Structure) -> float:
    r"""Relative deviation from the condition of Caughey and O'Kelly.

    Real modes exist exactly where :math:`C M^{-1} K = K M^{-1} C`.

    Parameters
    ----------
    structure
        Mass, damping and stiffness matrices [kg, N s/m, N/m].

    Returns
    -------
    Deviation [1]; 0 for proportional damping.

    Examples
    --------
    >>> pair = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> alike = Structure(mass=np.eye(2), damping=0.1 * pair, stiffness=pair)
    >>> non_proportionality(alike)
    0.0
    """
    product = structure.damping @ scipy.linalg.solve(
        structure.mass, structure.stiffness, assume_a="pos"
    )
    largest = np.abs(product).max()
    return float(np.abs(product - product.T).max() / largest) if largest > 0 else 0.0


def is_proportional(structure: Structure) -> bool:
    """Whether damping leaves the undamped modes uncoupled (Caughey and O'Kelly).

    Parameters
    ----------
    structure
        Mass, damping and stiffness matrices [kg, N s/m, N/m].

    Returns
    -------
    True up to rounding.
    """
    return non_proportionality(structure) < COMMUTING


def rayleigh_coefficients(
    frequencies: tuple[float, float], damping_ratios: tuple[float, float]
) -> tuple[float, float]:
    r"""Coefficients of :math:`C = a_0 M + a_1 K` that give two modes their damping ratios.

    .. math:: \zeta_j = \tfrac12 (a_0 / \omega_j + a_1 \omega_j)

    Parameters
    ----------
    frequencies
        Of the two modes [rad/s].
    damping_ratios
        Of the two modes [1].

    Returns
    -------
    Coefficients :math:`a_0` [1/s] and :math:`a_1` [s].

    Examples
    --------
    >>> rayleigh_coefficients((1.0, 3.0), (0.125, 0.375))
    (0.0, 0.25)
    """
    (w1, w2), (z1, z2) = frequencies, damping_ratios
    if not (w1 > 0 and w2 > 0 and w1 != w2):
        raise ValueError(
            f"{frequencies=} do not fix two coefficients. Give two different "
            "frequencies above 0."
        )
    span = w2**2 - w1**2
    return 2 * w1 * w2 * (z1 * w2 - z2 * w1) / span, 2 * (z2 * w2 - z1 * w1) / span


def rayleigh(mass: Square, stiffness: Square, a0: float, a1: float) -> Square:
    """Compute :math:`a_0 M + a_1 K`.

    Parameters
    ----------
    mass
        Mass matrix [kg].
    stiffness
        Stiffness matrix [N/m].
    a0
        Coefficient of the mass matrix [1/s].
    a1
        Coefficient of the stiffness matrix [s].

    Returns
    -------
    Damping matrix [N s/m].
    """
    return a0 * mass + a1 * stiffness


def modal_damping(mass: Square, stiffness: Square, damping_ratios: Series | float) -> Square:
    r"""Damping matrix that gives each undamped mode its damping ratio.

    .. math:: C = M X \operatorname{diag}(2 \zeta_j \omega_j) X^T M

    Parameters
    ----------
    mass
        Mass matrix [kg].
    stiffness
        Stiffness matrix [N/m].
    damping_ratios
        Damping ratios, lowest mode first [1].

    Returns
    -------
    Damping matrix [N s/m].
    """
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    omega = np.sqrt(np.maximum(squares, 0.0))
    return _from_modes(mass, shapes, 2 * np.broadcast_to(damping_ratios, omega.shape) * omega)


def caughey(
    mass: Square, stiffness: Square, damping_ratios: Series
) -> tuple[Square, Float[np.ndarray, " term"]]:
    r"""Caughey's series :math:`C = M \sum_j c_j (M^{-1} K)^j` through the lowest modes' ratios.

    As many terms as ratios, :math:`\zeta_i = \tfrac12 \sum_{j=0} c_j \omega_i^{2 j - 1}`. It is
    a polynomial, and oscillates between and beyond the given modes.

    Parameters
    ----------
    mass, stiffness
        Matrices of the structure [kg], [N/m].
    damping_ratios
        Of the lowest modes [1].

    Returns
    -------
    The damping matrix [N s/m], and the coefficients :math:`c_j`.

    Raises
    ------
    ValueError
        If the number of ratios is wrong, or the series feeds energy into another mode.
    """
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    terms = len(damping_ratios)
    if not 1 <= terms <= len(squares) or squares[0] <= 0:
        raise ValueError(
            f"{terms} damping ratios for a structure of {len(squares)} modes above 0 Hz. Give "
            "from one to as many, for the lowest modes."
        )
    # Scaled, since powers of omega^2 of a stiff structure would leave the range of numbers.
    scale = squares[terms - 1]
    powers = np.arange(terms)
    rows = (squares[:terms, None] / scale) ** powers
    scaled = np.linalg.solve(rows, 2 * np.sqrt(squares[:terms]) * damping_ratios)
    rate = (squares[:, None] / scale) ** powers @ scaled
    if np.any(rate < -COMMUTING * np.abs(rate).max()):
        worst = int(np.argmin(rate))
        ratio = rate[worst] / (2 * np.sqrt(squares[worst]))
        raise ValueError(
            f"The series of {terms} terms gives mode {worst + 1} a damping ratio of "
            f"{ratio:.4g}. Give ratios for more modes, or use fit_damping_ratio, which stays "
            "positive."
        )
    return _from_modes(mass, shapes, rate), scaled / scale**powers


def generalised_proportional(
    mass: Square,
    stiffness: Square,
    of_stiffness: Callable[[Series], Series],
    of_flexibility: Callable[[Series], Series] | None = None,
) -> Square:
    r"""Damping by any two functions, :math:`C = M f_1(M^{-1} K) + K f_2(K^{-1} M)`.

    .. math:: 2 \zeta_j \omega_j = f_1(\omega_j^2) + \omega_j^2 \, f_2(1 / \omega_j^2)

    Rayleigh's is :math:`f_1 = a_0, f_2 = a_1`. Computed through the undamped modes, which
    needs no function of a matrix.

    Parameters
    ----------
    mass
        Mass matrix [kg].
    stiffness
        Stiffness matrix [N/m].
    of_stiffness
        Function :math:`f_1` of a matrix.
    of_flexibility
        Function :math:`f_2` of a matrix.

    Returns
    -------
    Damping matrix [N s/m].

    References
    ----------
    S. Adhikari, "Damping modelling using generalized proportional damping", J. Sound Vib. 293
    (2006) 156-170.
    """
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    rate = np.broadcast_to(of_stiffness(squares), squares.shape)
    if of_flexibility is not None:
        rate = rate + squares * of_flexibility(1 / squares)
    return _from_modes(mass, shapes, np.asarray(rate))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class DampingRatio:
    r"""Damping ratio as a function of frequency, :math:`\zeta = a / \omega + b + c \, \omega`.

    Parameters
    ----------
    coefficients
        :math:`a` [rad/s], :math:`b` [1], :math:`c` [s/rad], none of them negative.
    reduced_chi2
        Mean squared misfit in units of the standard deviations, per degree of freedom; NaN
        where there is none left.
    """

    coefficients: Float[np.ndarray, "3"]
    reduced_chi2: float

    def __call__(self, omega: Series) -> Series:
        """Damping ratio at angular frequencies [rad/s]."""
        a, b, c = self.coefficients
        return np.asarray(a / omega + b + c * omega)


def fit_damping_ratio(
    omega: Series, damping_ratios: Series, sd: Series | None = None
) -> DampingRatio:
    """Fit a damping ratio that is positive at every frequency to measured ones.

    Non-negative weighted least squares: fit it to the modes that were measured, use it for all
    (`smooth_damping`).

    Parameters
    ----------
    omega
        [rad/s]
    damping_ratios
        Measured damping ratios [1].
    sd
        Of the ratios; equal where not given.

    Returns
    -------
    Damping ratio at any frequency, with the mean squared misfit.
    """
    spread = np.ones_like(omega) if sd is None else sd
    if not (np.all(omega > 0) and np.all(spread > 0)):
        raise ValueError(
            "A frequency or a standard deviation is not above 0. Leave out rigid-body modes, "
            "and give each ratio its standard deviation."
        )
    # Each column at its largest, so that none is negligible only by its unit.
    basis = np.stack([1 / omega, np.ones_like(omega), omega], axis=1) / spread[:, None]
    size = np.linalg.norm(basis, axis=0)
    scaled, misfit = scipy.optimize.nnls(basis / size, damping_ratios / spread)
    free = len(omega) - int(np.count_nonzero(scaled))
    return DampingRatio(scaled / size, misfit**2 / free if free > 0 else float("nan"))


def smooth_damping(
    mass: Square, stiffness: Square, damping_ratio: Callable[[Series], Series]
) -> Square:
    r"""Damping matrix of a smooth :math:`\zeta(\omega)`, :math:`C = 2 M S \zeta(S)`.

    With :math:`S = \sqrt{M^{-1} K}`: generalised proportional damping by its damping factors.

    Parameters
    ----------
    mass
        Mass matrix [kg].
    stiffness
        Stiffness matrix [N/m].
    damping_ratio
        Function of angular frequency [rad/s].

    Returns
    -------
    Damping matrix [N s/m].
    """
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    if squares[0] <= 0:
        raise ValueError(
            "The structure has a rigid-body mode, for which a damping ratio has no meaning. "
            "Tie it to the base."
        )
    omega = np.sqrt(squares)
    return _from_modes(mass, shapes, 2 * np.asarray(damping_ratio(omega)) * omega)


def _from_modes(mass: Square, shapes: Float[np.ndarray, "dof mode"], rate: Series) -> Square:
    moved = mass @ shapes
    return np.asarray((moved * rate) @ moved.T)
