"""What a reliability problem means: structure, failure in words, period, units."""

import dataclasses
from collections.abc import Mapping


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """What the owner states of a reliability problem; empty where nothing is stated.

    Parameters
    ----------
    name
        Of the structure.
    failure
        What happens when the limit state is violated, in words.
    formula
        Name of the limit state, where it is a function of the owner.
    period
        Time or instant that the probability is of, such as "50 years".
    accepted
        Probability of failure that is accepted [1]; None where none is stated.
    units
        Unit of each input by name.
    """

    name: str = ""
    failure: str = ""
    formula: str = ""
    period: str = ""
    accepted: float | None = None
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)


NOTHING_STATED = Stated()
