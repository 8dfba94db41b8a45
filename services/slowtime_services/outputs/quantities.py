"""The quantities of a state by name, with their units."""

from collections.abc import Iterator
from typing import NamedTuple

from slowtime_schemas.answers.twins import RegisteredTwin, State
from slowtime_schemas.quantities import Estimate


class Quantity(NamedTuple):
    """One estimated quantity of a state.

    Parameters
    ----------
    name
        Such as ``frequency_hz``, ``elements/storey2`` or ``modes/0/frequency_hz``.
    unit
        ``Hz``, or empty for a ratio.
    estimate
        None where the state has none.
    """

    name: str
    label: str
    unit: str
    estimate: Estimate | None


_PLAIN = (
    ("frequency_hz", "Natural frequency", "Hz"),
    ("damping_ratio", "Damping ratio", ""),
    ("stiffness_change", "Change of stiffness", ""),
    ("mass_change", "Change of mass", ""),
)


def quantities_of(state: State | RegisteredTwin) -> Iterator[Quantity]:
    """Yield the quantities of a state, or of a twin as it is now, with elements and modes."""
    for name, label, unit in _PLAIN:
        estimate = getattr(state, name)
        # A twin of elements has no single change of stiffness and mass.
        if estimate is not None or not state.elements:
            yield Quantity(name, label, unit, estimate)
    for element, change in state.elements.items():
        yield Quantity(f"elements/{element}", f"Change of {element}", "", change)
    for mode in state.modes:
        if mode.model_mode is None:
            continue
        where, label = f"modes/{mode.model_mode}", f"Mode {mode.model_mode + 1}"
        yield Quantity(f"{where}/frequency_hz", f"{label}, frequency", "Hz", mode.frequency_hz)
        yield Quantity(
            f"{where}/damping_ratio", f"{label}, damping ratio", "", mode.damping_ratio
        )
