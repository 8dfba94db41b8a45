"""Materials and cross-sections of beams and bars."""

import dataclasses
import math
from typing import Literal

Theory = Literal["euler", "timoshenko"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """A linear elastic material."""

    young_pa: float
    poisson: float = 0.3
    density_kg_m3: float = 0.0

    def __post_init__(self) -> None:
        """Refuse values that no material has."""
        if not (
            self.young_pa > 0.0 and -1.0 < self.poisson < 0.5 and self.density_kg_m3 >= 0.0
        ):
            raise ValueError(
                f"young_pa={self.young_pa}, poisson={self.poisson}, "
                f"density_kg_m3={self.density_kg_m3}. Allowed are a positive modulus, a ratio "
                "between -1 and 0.5, and a density that is not negative."
            )

    @property
    def shear_pa(self) -> float:
        """Shear modulus of an isotropic material [Pa]."""
        return self.young_pa / (2.0 * (1.0 + self.poisson))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A cross-section in its principal axes y and z.

    Parameters
    ----------
    inertia_y_m4, inertia_z_m4
        Second moments of area about y (bending in the x-z plane) and z (x-y plane) [m^4].
    shear_y_m2, shear_z_m2
        Shear areas along y and z [m^2]; needed for Timoshenko beams only.
    """

    area_m2: float
    inertia_y_m4: float = 0.0
    inertia_z_m4: float = 0.0
    torsion_m4: float = 0.0
    shear_y_m2: float = math.inf
    shear_z_m2: float = math.inf

    def __post_init__(self) -> None:
        """Refuse negative values."""
        values = (self.inertia_y_m4, self.inertia_z_m4, self.torsion_m4)
        if not (self.area_m2 > 0.0 and min(values) >= 0.0):
            raise ValueError(
                f"A section of area {self.area_m2} m^2 and inertias {values} m^4 was given. "
                "Allowed are a positive area and inertias that are not negative."
            )
        if not min(self.shear_y_m2, self.shear_z_m2) > 0.0:
            raise ValueError(
                f"Shear areas {self.shear_y_m2} and {self.shear_z_m2} m^2 were given. Allowed "
                "are positive values; leave them out for beams without shear deformation."
            )


def rectangle(width_m: float, height_m: float) -> Section:
    """Solid rectangle, its width along y and its height along z.

    References
    ----------
    .. [1] W. C. Young, R. G. Budynas, "Roark's Formulas for Stress and Strain", 7th ed. (2002),
       table 10.1, case 4 (torsion constant).

    Examples
    --------
    >>> round(rectangle(0.1, 0.1).torsion_m4 / 0.1**4, 4)
    0.1408
    """
    area = width_m * height_m
    long, short = max(width_m, height_m), min(width_m, height_m)
    slender = short / long
    torsion = long * short**3 * (1 / 3 - 0.21 * slender * (1 - slender**4 / 12))
    return Section(
        area_m2=area,
        inertia_y_m4=width_m * height_m**3 / 12,
        inertia_z_m4=height_m * width_m**3 / 12,
        torsion_m4=torsion,
        shear_y_m2=area * 5 / 6,
        shear_z_m2=area * 5 / 6,
    )


def tube(diameter_m: float, wall_m: float) -> Section:
    """Circular tube; a wall of half the diameter makes it solid.

    The shear area is half of the area, which holds for thin walls.
    """
    if not 0.0 < wall_m <= diameter_m / 2:
        raise ValueError(
            f"A wall of {wall_m} m for a diameter of {diameter_m} m was given. Allowed is a "
            "positive thickness up to half of the diameter."
        )
    inner = diameter_m - 2 * wall_m
    area = math.pi / 4 * (diameter_m**2 - inner**2)
    inertia = math.pi / 64 * (diameter_m**4 - inner**4)
    return Section(
        area_m2=area,
        inertia_y_m4=inertia,
        inertia_z_m4=inertia,
        torsion_m4=2 * inertia,
        shear_y_m2=area / 2,
        shear_z_m2=area / 2,
    )
