"""The rows of twins, boots, features, details and events, as named tuples."""

from typing import NamedTuple

from twin_server.history.details import Detail


class TwinRow(NamedTuple):
    """A twin as it is kept."""

    site: str
    asset: str
    registration: str
    checkpoint: str

    @property
    def id(self) -> str:
        """Id of the twin: site and asset."""
        return f"{self.site}.{self.asset}"


class RunRow(NamedTuple):
    """A boot and its account as they are kept."""

    number: int
    site: str
    asset: str
    boot: str
    slow_time_unit: str
    next: int
    last: int
    last_t_ns: int
    told: int
    closed: bool
    lost: str
    """JSON of the ranges that were passed over."""


class FeatureRow(NamedTuple):
    """Features in order, with the state they led to."""

    number: int
    sequence: int
    t_ns: int
    slow_time: float
    message: bytes
    state: bytes


class DetailRow(NamedTuple):
    """Details of the state of one feature of a twin of elements."""

    number: int
    sequence: int
    changes: bytes
    body: bytes


class EventRow(NamedTuple):
    """An event as it is kept; `number` counts those of its twin, 0 before it is kept."""

    number: int
    site: str
    asset: str
    t_ns: int
    slow_time: float | None
    derived: bool
    """Whether it follows from the features, so that estimating anew makes it anew."""
    body: str


class StateRow(NamedTuple):
    """State of a feature, estimated again."""

    number: int
    sequence: int
    state: bytes
    detail: Detail | None = None
