"""Declarations of inputs, sensors, supports and initial states in a description."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from slowtime.dynamics.units import Quantity

Where = tuple[str | int, ...]

InputKind = Literal[
    "force",
    "base_acceleration",
    "base_velocity",
    "base_displacement",
    "imposed_acceleration",
    "imposed_velocity",
    "imposed_displacement",
]

INPUT_QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "force": "force",
        "base_acceleration": "acceleration",
        "base_velocity": "velocity",
        "base_displacement": "displacement",
        "imposed_acceleration": "acceleration",
        "imposed_velocity": "velocity",
        "imposed_displacement": "displacement",
    }
)
"""Quantity that an input of each kind measures."""
BASE_KINDS = ("base_acceleration", "base_velocity", "base_displacement")
"""Kinds of input that move the base, and so name no node."""
IMPOSED_KINDS = ("imposed_acceleration", "imposed_velocity", "imposed_displacement")
"""Kinds of input that move a support, or a node that is driven."""
DISPLACED = ("displacement", "velocity")
"""Quantities of imposed motion that must be smooth between samples, for they are
differentiated."""


class DescriptionError(ValueError):
    """A description that contradicts itself; `where` is the path of keys to the fault."""

    def __init__(self, where: Where, sentence: str) -> None:
        super().__init__(sentence)
        self.where = where


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """A measured force on a node, or the measured motion of the base or of a support.

    Parameters
    ----------
    channel
        Name of the channel that measures it.
    kind
        ``force``; ``base_acceleration``, ``base_velocity``, ``base_displacement``; or
        ``imposed_acceleration``, ``imposed_velocity``, ``imposed_displacement`` of a support,
        or of a node that an actuator drives. Motion is absolute, not relative to the base.
    unit
        Unit of the channel, such as ``N`` or ``m/s^2``.
    node
        Node that a force acts on, or support or node that is moved; None for the base.
    hold
        Signal between samples: band-limited (``"band_limited"``), straight lines (``"first"``)
        or steps (``"zero"``); None where it is not known. A displacement or velocity is
        band-limited by default, because it is differentiated.
    """

    channel: str
    kind: InputKind
    unit: str
    node: str | None = None
    hold: Literal["band_limited", "first", "zero"] | None = None

    def __post_init__(self) -> None:
        if self.hold is None and INPUT_QUANTITIES.get(self.kind) in DISPLACED:
            object.__setattr__(self, "hold", "band_limited")

    @property
    def quantity(self) -> Quantity:
        """Measured quantity: force, displacement, velocity or acceleration."""
        return INPUT_QUANTITIES[self.kind]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """What one channel measures: the motion of a node, or a force.

    Parameters
    ----------
    channel
        Name of the channel.
    unit
        Unit of the channel, such as ``m/s^2``, ``g`` or ``mm``.
    quantity
        ``displacement``, ``velocity`` or ``acceleration`` of a node or a support, or
        ``force``.
    node
        Node whose motion is measured. Of a force: the base, a support or a driven node, on
        which it acts from outside, positive in the direction of positive displacement.
    element
        Spring element whose force is measured: the sum of stiffness, damping and effects,
        positive in tension.
    frame
        Reference of a motion: inertial frame, or base.
    noise_sd
        Standard deviation of white noise, in the unit of the channel; None where unknown.
    """

    channel: str
    quantity: Quantity
    node: str = ""
    unit: str
    element: str | None = None
    frame: Literal["absolute", "relative_to_base"] = "absolute"
    noise_sd: float | None = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Support:
    """A point that elements end at; it moves as an input states, or else with the base.

    Parameters
    ----------
    still
        It stands still in space, whatever the base does: a wall beside a shaking table.
    """

    id: str
    still: bool = False


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Initial state of a node in a simulation, relative to the base.

    Parameters
    ----------
    node
        A node, or a node of a beam with `ROTATION` after its name.
    displacement_m, velocity_m_per_s
        At the first sample [m], [m/s]; [rad], [rad/s] of an angle.
    """

    node: str
    displacement_m: float = 0.0
    velocity_m_per_s: float = 0.0
