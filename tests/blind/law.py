"""A law that can be hidden in a rig, and a law at its place.

A law is text: an expression in e [m] and v [m/s] (elongation of an element and its rate), T
(time of the campaign [s]) and its parameters. `equations` makes equations of motion of them.
"""

import dataclasses
from typing import Literal

Where = Literal["element", "node", "base", "input", "sensor", "structure"]


@dataclasses.dataclass(frozen=True)
class Law:
    """One effect: what it is called, where it sits, what it adds.

    Parameters
    ----------
    leading
        The parameter whose error is scored; empty where there is none.
    force
        Of an element, added to k e + c v.
    rates
        Of the internal states h0, h1 …, where the force has any.
    grip
        Of dry friction: the most that it holds, an expression in e, w = abs(v), and the
        direction d in which it slips or would, 1 or -1.
    inertia
        Of a hidden body at a node, whose `force` is that of its elongation against the node:
        its moment of inertia over mass and radius squared, where it rolls [1].
    listed
        Whether the contract lists it. What is not listed is to be called unknown.
    kin
        Families that would not be a lie, for an effect that is not listed.
    """

    name: str
    family: str
    where: Where = "element"
    leading: str = ""
    force: str = ""
    rates: tuple[str, ...] = ()
    grip: str = ""
    inertia: float = 0.0
    listed: bool = True
    kin: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()
    """Other names under which a library may know it."""


@dataclasses.dataclass(frozen=True)
class Placed:
    """An effect at its place, with numbers."""

    law: Law
    place: str
    parameters: dict[str, float]

    def where(self) -> dict[str, str]:
        """As a report says it."""
        return {"kind": self.law.where, "id": self.place}
