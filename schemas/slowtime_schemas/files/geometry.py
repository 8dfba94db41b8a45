"""Section `geometry` of a reduced model file: what is drawn of the full model."""

import base64
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from .base64_text import checked_base64
from .finite_elements import FrameNode, Vector
from .model import Id, Part

MOST_NODES = 1000
"""Nodes that a geometry may have; motions take 16 bytes for each node and coordinate."""

MOST_LINES = 5000
"""Lines that a geometry may have."""

_BYTES = 4


class DrawnLine(Part):
    """A line between two nodes, and the parameter that scales the part there."""

    between: tuple[Id, Id]
    parameter: Id | None = None


class DrawnSensor(Part):
    """A node at which a channel measures, and the line along which it does."""

    channel: Id
    node: Id
    along: Vector


class Geometry(Part):
    """Nodes and lines of the full model, and their motions over the reduced coordinates.

    `motions` has three rows for each node (along x, y and z) and a column for each of
    `coordinates`, row by row, as little-endian numbers of 32 bits in base64.
    """

    nodes: tuple[FrameNode, ...] = Field(min_length=1, max_length=MOST_NODES)
    lines: tuple[DrawnLine, ...] = Field(default=(), max_length=MOST_LINES)
    sensors: tuple[DrawnSensor, ...] = ()
    coordinates: tuple[Id, ...] = ()
    motions: Annotated[str, Field(max_length=4 << 20)] = ""

    @field_validator("motions")
    @classmethod
    def _is_base64(cls, value: str) -> str:
        return checked_base64(value)

    @model_validator(mode="after")
    def _is_consistent(self) -> "Geometry":
        known = [node.id for node in self.nodes]
        if len(set(known)) < len(known):
            raise ValueError("Two nodes of `geometry` have the same id. Give each its own.")
        named = [end for line in self.lines for end in line.between]
        named += [sensor.node for sensor in self.sensors]
        strange = sorted(set(named) - set(known))
        if strange:
            raise ValueError(
                f"`geometry` names the node {strange[0]!r}, which it does not have. Allowed "
                f"are its {len(known)} nodes, such as {known[0]!r}."
            )
        expected = 3 * len(known) * len(self.coordinates)
        given = len(base64.b64decode(self.motions)) / _BYTES
        if given != expected:
            raise ValueError(
                f"`motions` of `geometry` holds {given:g} numbers. Expected are 3 for each of "
                f"{len(known)} nodes and {len(self.coordinates)} coordinates: {expected}."
            )
        return self
