"""Ready-made descriptions of structures: chains, shear frames, beams."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .description import Description, Sensor
from .elements import BASE, Beam, Element, Matrix, Node, Spring, packed

SUPPORTS = ("cantilever", "simply supported", "clamped", "propped", "free")


def chain(
    masses_kg: Sequence[float],
    stiffnesses_n_per_m: Sequence[float],
    *,
    dampings_n_s_per_m: Sequence[float] | None = None,
    ground_dampings_n_s_per_m: Sequence[float] | None = None,
    rayleigh: tuple[float, float] = (0.0, 0.0),
    name: str = "chain",
    node: str = "m",
    spring: str = "k",
) -> Description:
    r"""Masses in a row, the first tied to the base.

    Parameters
    ----------
    masses_kg
        From the base outwards.
    stiffnesses_n_per_m
        One spring for each mass, towards the base; one more ties the last mass to the base.
    dampings_n_s_per_m
        Beside each spring.
    ground_dampings_n_s_per_m
        From each mass to the base; elements ``c1`` … where not zero.
    rayleigh
        :math:`a_0` [1/s] and :math:`a_1` [s] of :math:`C = a_0 M + a_1 K`, added to the above
        as dampers to the base and beside the springs.

    Examples
    --------
    >>> from .description import assemble
    >>> assemble(chain([1.0, 1.0], [3.0, 2.0])).stiffness
    array([[ 5., -2.],
           [-2.,  2.]])
    """
    count = len(masses_kg)
    if len(stiffnesses_n_per_m) not in (count, count + 1):
        raise ValueError(
            f"{len(stiffnesses_n_per_m)} springs for {count} masses. Give one for each mass, "
            "or one more to tie the last mass to the base."
        )
    beside = _as_many("dampings_n_s_per_m", dampings_n_s_per_m, len(stiffnesses_n_per_m))
    ground = _as_many("ground_dampings_n_s_per_m", ground_dampings_n_s_per_m, count)
    nodes = tuple(Node(id=f"{node}{i + 1}", mass_kg=m) for i, m in enumerate(masses_kg))
    stops = [BASE, *(one.id for one in nodes), BASE]
    elements: list[Element] = [
        Spring(
            id=f"{spring}{i + 1}",
            between=(stops[i], stops[i + 1]),
            stiffness_n_per_m=k,
            damping_n_s_per_m=c + rayleigh[1] * k,
        )
        for i, (k, c) in enumerate(zip(stiffnesses_n_per_m, beside, strict=True))
    ]
    for i, (one, damping) in enumerate(zip(nodes, ground, strict=True)):
        total = damping + rayleigh[0] * one.mass_kg
        if total:
            tie = (BASE, one.id)
            elements.append(Spring(id=f"c{i + 1}", between=tie, damping_n_s_per_m=total))
    return Description(
        name=name,
        nodes=nodes,
        elements=tuple(elements),
        sensors=tuple(accelerometer(one.id) for one in nodes),
    )


def shear_frame(
    floors_kg: Sequence[float],
    storeys_n_per_m: Sequence[float],
    *,
    dampings_n_s_per_m: Sequence[float] | None = None,
    rayleigh: tuple[float, float] = (0.0, 0.0),
    name: str = "shear frame",
) -> Description:
    """Stack rigid floors, from the lowest upwards: ``floor1`` … on ``storey1`` ….

    Stiffness and damping of a storey are those against sway, all its columns together:
    12 E I / h^3 for each that is clamped at both ends.

    Masses are in kg, stiffnesses in N/m, dampings in N s/m; `rayleigh` are the coefficients of
    M [1/s] and K [s].
    """
    if len(floors_kg) != len(storeys_n_per_m):
        raise ValueError(
            f"{len(storeys_n_per_m)} storeys for {len(floors_kg)} floors. Give one storey for "
            "each floor."
        )
    return chain(
        floors_kg,
        storeys_n_per_m,
        dampings_n_s_per_m=dampings_n_s_per_m,
        rayleigh=rayleigh,
        name=name,
        node="floor",
        spring="storey",
    )


def beam(
    length_m: float,
    bending_stiffness_n_m2: float,
    mass_kg_per_m: float,
    *,
    elements: int = 10,
    supports: str = "cantilever",
    damping_s: float = 0.0,
    tip_mass_kg: float = 0.0,
    name: str = "beam",
) -> Description:
    """Cut a uniform Euler–Bernoulli beam into equal elements ``b1`` … with nodes ``n1`` ….

    Parameters
    ----------
    supports
        ``"cantilever"``: clamped at its start; ``"simply supported"``: pinned at both ends;
        ``"clamped"`` at both ends; ``"propped"``: clamped at its start and pinned at its end;
        ``"free"``.
    damping_s
        Kelvin–Voigt, see `parts.Beam`.
    tip_mass_kg
        At the far end.
    """
    if supports not in SUPPORTS:
        raise ValueError(f"{supports=} is not known. Allowed: {', '.join(SUPPORTS)}.")
    if elements < 2:
        raise ValueError(f"{elements=} is too coarse for a beam. Give 2 or more.")
    first = BASE if supports in ("cantilever", "clamped", "propped") else "n0"
    last = BASE if supports == "clamped" else f"n{elements}"
    stops = [first, *(f"n{i}" for i in range(1, elements)), last]
    pinned = {"simply supported": {first, last}, "propped": {last}}.get(supports, set())
    nodes = tuple(
        Node(
            id=stop,
            kind="beam",
            mass_kg=tip_mass_kg if stop == f"n{elements}" else 0.0,
            held=("translation",) if stop in pinned else (),
        )
        for stop in stops
        if stop != BASE
    )
    spans = tuple(
        Beam(
            id=f"b{i + 1}",
            between=(stops[i], stops[i + 1]),
            length_m=length_m / elements,
            bending_stiffness_n_m2=bending_stiffness_n_m2,
            mass_kg_per_m=mass_kg_per_m,
            damping_s=damping_s,
        )
        for i in range(elements)
    )
    free = (one.id for one in nodes if "translation" not in one.held)
    sensors = tuple(accelerometer(one) for one in free)
    return Description(name=name, nodes=nodes, elements=spans, sensors=sensors)


def of_matrices(
    mass: Float[np.ndarray, "dof dof"],
    stiffness: Float[np.ndarray, "dof dof"],
    damping: Float[np.ndarray, "dof dof"] | None = None,
    *,
    coordinates: Sequence[str] | None = None,
    name: str = "matrices",
) -> Description:
    """Describe a structure by its matrices: one element ``matrices`` over all coordinates.

    Parameters
    ----------
    mass, stiffness, damping
        Symmetric matrices [kg], [N/m], [N s/m]; undamped where no damping is given.
    coordinates
        Name of each coordinate, a displacement relative to the base; ``x1``, ``x2`` … where
        not given.

    Raises
    ------
    ValueError
        If a matrix is not symmetric, shapes differ, or the mass is not positive definite.

    Examples
    --------
    >>> from .description import assemble
    >>> assemble(of_matrices(np.eye(2), np.diag([4.0, 9.0]))).stiffness
    array([[4., 0.],
           [0., 9.]])
    """
    damping = np.zeros_like(mass) if damping is None else damping
    count = len(mass)
    for what, matrix in (("mass", mass), ("stiffness", stiffness), ("damping", damping)):
        if matrix.shape != (count, count):
            raise ValueError(
                f"{what} has shape {matrix.shape}. Give square matrices of {count} rows, as of "
                "the mass."
            )
        if not np.allclose(matrix, matrix.T, rtol=0.0, atol=ASYMMETRY * np.abs(matrix).max()):
            raise ValueError(
                f"{what} is not symmetric. Give its symmetric part, (A + A.T) / 2."
            )
    if np.linalg.eigvalsh(mass)[0] <= 0.0:
        raise ValueError("mass is not positive definite. Leave coordinates without mass out.")
    names = [f"x{i + 1}" for i in range(count)] if coordinates is None else list(coordinates)
    if len(names) != count:
        raise ValueError(f"{len(names)} coordinates for {count} rows. Give one name for each.")
    if count == 1:
        spring = Spring(
            id="matrices", between=(BASE, names[0]), stiffness_n_per_m=float(stiffness[0, 0]),
            damping_n_s_per_m=float(damping[0, 0]),
        )  # fmt: skip
        nodes: tuple[Node, ...] = (Node(id=names[0], mass_kg=float(mass[0, 0])),)
        elements: tuple[Element, ...] = (spring,)
    else:
        nodes = tuple(Node(id=one, kind="beam", held=("rotation",)) for one in names)
        whole = Matrix(
            id="matrices", coordinates=tuple(names), stiffness_terms=packed(stiffness),
            mass_terms=packed(mass), damping_terms=packed(damping),
        )  # fmt: skip
        elements = (whole,)
    return Description(
        name=name, nodes=nodes, elements=elements, sensors=tuple(map(accelerometer, names))
    )


ASYMMETRY = 1e-8
"""Relative asymmetry [1] above which a matrix is refused; text files often keep ten digits
only."""


def accelerometer(node: str, *, unit: str = "m/s^2") -> Sensor:
    """Put an absolute accelerometer on a node, its channel called ``a_`` and the node."""
    return Sensor(channel=f"a_{node}", quantity="acceleration", node=node, unit=unit)


def _as_many(what: str, given: Sequence[float] | None, count: int) -> Sequence[float]:
    if given is None:
        return [0.0] * count
    if len(given) != count:
        raise ValueError(f"{len(given)} values of {what} were given. Give {count}, or none.")
    return given
