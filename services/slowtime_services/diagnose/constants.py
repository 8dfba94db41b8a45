"""Constants of a model, and how far a fit has moved them from what was stated."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Literal

from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Beam, Description, Matrix, Tolerance
from slowtime_services.reports import Words

Quantity = Literal["mass", "stiffness", "damping", "factor", "bending"]

ABSURD_TOLERANCES = 10.0
"""Stated tolerances [1] by which a constant has moved at least, for the fitted model to be no
model of the structure. Source: three times what is reported as outside its tolerance."""

LEAST_CHANGE = 1e-3
"""Relative change [1] from which the largest is told. Source: a tenth of a per cent is below
the tolerance of any drawing."""

MOST_CHANGES = 3
"""Changed constants that the first page names [1]; the table has all."""

UNITS = {
    "m": {
        "mass": "kg", "stiffness": "N/m", "damping": "N s/m", "factor": "",
        "bending": "N m²",
    },
    "rad": {
        "mass": "kg m²", "stiffness": "N m/rad", "damping": "N m s/rad", "factor": "",
        "bending": "N m²",
    },
}  # fmt: skip
"""Units of constants by the unit of the coordinates."""

NAMES: dict[Quantity, str] = {
    "mass": "mass of {id}",
    "stiffness": "stiffness of {id}",
    "damping": "damping of {id}",
    "factor": "factor on the stiffness of {id}",
    "bending": "bending stiffness of {id}",
}


@dataclasses.dataclass(frozen=True, slots=True)
class Change:
    """A constant before and after a fit.

    Parameters
    ----------
    tolerance
        Stated relative standard deviation [1]; 0 where none is stated.
    """

    quantity: Quantity
    of: str
    given: float
    fitted: float
    unit: str
    tolerance: float

    @property
    def label(self) -> str:
        """Name and unit, for tables."""
        return NAMES[self.quantity].format(id=self.of) + f" [{self.unit}]" * bool(self.unit)

    @property
    def share(self) -> float:
        """Relative change [1]; not-a-number of a constant that was stated as 0."""
        return self.fitted / self.given - 1.0 if self.given else math.nan

    @property
    def tolerances(self) -> float:
        """Change in stated tolerances [1]; 0 where none is stated.

        A fall counts by the logarithm, as a stiffness of a thousandth of what was stated is as
        far off as one of a thousand times that.
        """
        if not self.tolerance or not self.given or self.fitted == self.given:
            return 0.0
        ratio = self.fitted / self.given
        fall = -math.log(ratio) if ratio > 0.0 else math.inf
        return max(abs(ratio - 1.0), fall) / self.tolerance


def changes_of(given: Description, fitted: Description) -> list[Change]:
    """List all constants of a model beside those of a fit."""
    after = {(quantity, name): value for quantity, name, value in _values(fitted)}
    units = UNITS["rad" if given.unit_of_coordinate == "rad" else "m"]
    tolerance = given.tolerance or Tolerance()
    stated: dict[str, float] = {"mass": tolerance.mass, "damping": tolerance.damping}
    return [
        Change(
            quantity, name, value, after.get((quantity, name), value), units[quantity],
            stated.get(quantity, tolerance.stiffness),
        )
        for quantity, name, value in _values(given)
    ]  # fmt: skip


def absurd_changes(changes: Sequence[Change]) -> list[Change]:
    """Give the constants that no structure like the stated one has, the farthest first."""
    far = [one for one in changes if one.tolerances > ABSURD_TOLERANCES]
    return sorted(far, key=lambda one: -one.tolerances)


def changes_in_words(changes: Sequence[Change], words: Words) -> str:
    """Say which constants left their tolerance, else which moved most; empty for none."""
    moved = [one for one in changes if one.tolerances > LIMITS.moved_tolerances]
    moved.sort(key=lambda one: -one.tolerances)
    if moved:
        listed = listed_changes(moved, words)
        return words("diagnosis.constants_moved", listed=listed)
    shown = [one for one in changes if abs(one.share) >= LEAST_CHANGE]
    if not shown:
        return ""
    most = max(shown, key=lambda one: (one.tolerances, abs(one.share)))
    return words("diagnosis.constants_most", listed=listed_changes([most], words))


def listed_changes(changes: Sequence[Change], words: Words) -> str:
    """Write changes with both values; of many the first, and how many more there are."""
    told = [
        words(
            "diagnosis.constant_change",
            name=words(f"diagnosis.constant_{one.quantity}", id=one.of),
            share=f"{'+' if one.share > 0 else ''}{words.percent(one.share, 4)}",
            given=words.number(one.given, 4),
            fitted=words.number(one.fitted, 4),
            unit=f" {one.unit}" if one.unit else "",
        )
        for one in changes[:MOST_CHANGES]
    ]
    more = len(changes) - len(told)
    rest = [words("modes.more", n=more)] if more > 0 else []
    return " ".join(["; ".join(told), *rest])


def _values(model: Description) -> Iterator[tuple[Quantity, str, float]]:
    for node in model.nodes:
        if node.mass_kg:
            yield "mass", node.id, node.mass_kg
    for element in model.elements:
        if isinstance(element, Matrix):
            yield "factor", element.id, element.stiffness_factor
            continue
        if isinstance(element, Beam):
            yield "bending", element.id, element.bending_stiffness_n_m2
            continue
        yield "stiffness", element.id, element.stiffness_n_per_m
        yield "damping", element.id, element.damping_n_s_per_m
