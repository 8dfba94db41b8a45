r"""Models within their tolerance, as a two-level design of few runs.

Stiffness and mass of each part, and damping as a whole, are moved by one standard deviation up
or down, by the columns of a Hadamard matrix. Columns are orthogonal, so that to first order the
spread of any result over the runs is :math:`\sum_i \sigma_i^2 (\partial z / \partial
\theta_i)^2`, the variance that the tolerances cause. Half of the variance of stiffness, and of
mass, is common to all parts: a modulus that is wrong is wrong everywhere.

References
----------
.. [1] R. L. Plackett, J. P. Burman, "The design of optimum multifactorial experiments",
   Biometrika 33 (1946) 305-325.
"""

import dataclasses
import math

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.dynamics.description import Description, Tolerance
from slowtime.dynamics.elements import Element, Matrix, Spring

COMMON = 0.5
"""Share of the variance that all parts have in common [1]."""


def members_of(description: Description, count: int) -> tuple[Description, ...]:
    """Make the models of a design; the description alone where nothing is uncertain.

    Parameters
    ----------
    description
        Structure, with the tolerances of its parameters.
    count
        Runs: a power of 2. Where there are as many parameters or more, columns are shared.
    """
    tolerance = description.tolerance or Tolerance()
    if count == 1 or not (tolerance.stiffness or tolerance.damping or tolerance.mass):
        return (description,)
    elements, nodes = len(description.elements), len(description.nodes)
    signs = _signs(count, elements + nodes + 3)
    out = []
    for row in signs:
        stiffness = _logs(tolerance.stiffness, row[0], row[3 : 3 + elements])
        mass = _logs(tolerance.mass, row[1], row[3 + elements :])
        damping = math.exp(_ln_sd(tolerance.damping) * row[2])
        out.append(_with_constants(description, np.exp(stiffness), np.exp(mass), damping))
    return tuple(out)


def drawn_member(description: Description, rng: np.random.Generator) -> Description:
    """Draw one model from the law that `members_of` covers."""
    tolerance = description.tolerance or Tolerance()
    elements, nodes = len(description.elements), len(description.nodes)
    row = rng.standard_normal(elements + nodes + 3)
    return _with_constants(
        description,
        np.exp(_logs(tolerance.stiffness, row[0], row[3 : 3 + elements])),
        np.exp(_logs(tolerance.mass, row[1], row[3 + elements :])),
        math.exp(_ln_sd(tolerance.damping) * row[2]),
    )


def _ln_sd(relative: float) -> float:
    return math.sqrt(math.log1p(relative**2))


def _logs(
    relative: float, common: float, own: Float[np.ndarray, " part"]
) -> Float[np.ndarray, " part"]:
    sd = _ln_sd(relative)
    return np.asarray(sd * (math.sqrt(COMMON) * common + math.sqrt(1 - COMMON) * own))


def _signs(count: int, parameters: int) -> Float[np.ndarray, "run parameter"]:
    """Orthogonal columns of plus and minus one; repeated, with other signs, where too few."""
    columns = scipy.linalg.hadamard(count).astype(float)[:, 1:]
    turns = -(-parameters // columns.shape[1])
    # A column that serves again is shuffled by a fixed permutation, so that the same
    # parameters are not moved together throughout.
    rng = np.random.default_rng(0)
    more = [columns] + [columns[rng.permutation(count)] for _ in range(turns - 1)]
    return np.concatenate(more, axis=1)[:, :parameters]


def _with_constants(
    description: Description,
    stiffness: Float[np.ndarray, " element"],
    mass: Float[np.ndarray, " node"],
    damping: float,
) -> Description:
    average = float(np.exp(np.log(mass).mean()))
    return dataclasses.replace(
        description,
        nodes=tuple(
            dataclasses.replace(
                node,
                mass_kg=node.mass_kg * factor,
                rotary_inertia_kg_m2=node.rotary_inertia_kg_m2 * factor,
            )
            for node, factor in zip(description.nodes, mass.tolist(), strict=True)
        ),
        elements=tuple(
            _element(element, factor, average, damping)
            for element, factor in zip(description.elements, stiffness.tolist(), strict=True)
        ),
    )


def _element(element: Element, stiffness: float, mass: float, damping: float) -> Element:
    if isinstance(element, Spring):
        return dataclasses.replace(
            element,
            stiffness_n_per_m=element.stiffness_n_per_m * stiffness,
            damping_n_s_per_m=element.damping_n_s_per_m * damping,
        )
    if isinstance(element, Matrix):
        return dataclasses.replace(
            element,
            stiffness_factor=element.stiffness_factor * stiffness,
            mass_factor=element.mass_factor * mass,
            damping_factor=element.damping_factor * damping,
        )
    return dataclasses.replace(
        element,
        bending_stiffness_n_m2=element.bending_stiffness_n_m2 * stiffness,
        mass_kg_per_m=element.mass_kg_per_m * mass,
        damping_s=element.damping_s * damping / stiffness,
    )
