"""Consistent systems of units in which meshes are written."""

import dataclasses
from collections.abc import Mapping


@dataclasses.dataclass(frozen=True, slots=True)
class UnitSystem:
    """A system of units of which time is in seconds.

    Parameters
    ----------
    length_m
        Its unit of length [m].
    force_n
        Its unit of force [N].
    """

    length_m: float
    force_n: float

    @property
    def mass_kg(self) -> float:
        """Its unit of mass, force times square second over length [kg]."""
        return self.force_n / self.length_m

    @property
    def pressure_pa(self) -> float:
        """Its unit of stress [Pa]."""
        return self.force_n / self.length_m**2

    @property
    def density_kg_m3(self) -> float:
        """Its unit of density [kg/m^3]."""
        return self.mass_kg / self.length_m**3

    @property
    def stiffness_n_per_m(self) -> float:
        """Its unit of translational stiffness [N/m]."""
        return self.force_n / self.length_m

    @property
    def moment_nm(self) -> float:
        """Its unit of moment, and of stiffness by angle [N m]."""
        return self.force_n * self.length_m

    @property
    def inertia_kg_m2(self) -> float:
        """Its unit of moment of inertia [kg m^2]."""
        return self.mass_kg * self.length_m**2


UNIT_SYSTEMS: Mapping[str, UnitSystem] = {
    "m": UnitSystem(length_m=1.0, force_n=1.0),
    "mm": UnitSystem(length_m=1e-3, force_n=1.0),
    "in": UnitSystem(length_m=0.0254, force_n=4.4482216152605),
}
"""Metre, newton, kilogram; millimetre, newton, tonne; inch, pound-force, and lbf s^2/in. The
inch and the pound are exact by the international agreement of 1959."""
