"""The protocol by which the serve stage reads twins, histories and forecasts."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from slowtime.degradation import RemainingLife
from twin_server.history.buckets import Buckets
from twin_server.history.details import Bodies
from twin_server.history.states import States
from twin_server.identity.principals import Principal
from twin_server.orders import SimulationOrder
from twin_server.registration.changes import Author
from twin_server.registration.costs import RepairTerms
from twin_server.registration.thresholds import Limit
from twin_server.registration.twin import Registration

from .instants import Moment


class HistoryPart(NamedTuple):
    """Part of a twin's history."""

    states: States
    keys: Sequence[int]
    """Of each state, its place in the order of all: ascending, the same for ever."""
    boots: Sequence[str]
    units: Sequence[str]
    bodies: Bodies = ()
    bands: Buckets | None = None
    """What all states show, where these are but some of them."""


@dataclasses.dataclass(frozen=True, slots=True)
class TwinForecast:
    """Forecast of a twin: value, sd, lo and hi at each slow time.

    Parameters
    ----------
    since, horizon
        Slow time of the last reading, and the latest that is looked at.
    crossings
        When each threshold is reached.
    misfits
        Of each quantity that no degradation law fits, a sentence that says so.
    widening
        Factor by which the futures of each are spread wider, as past outlooks call for it.
    periods, jumps
        Of each quantity, after how long it repeats itself, if it does; and slow times after
        which its past went elsewhere.
    unit
        Of slow time.
    """

    since: float
    horizon: float
    slow_time: Float[np.ndarray, " later"]
    bands: Mapping[str, Float[np.ndarray, "later 4"]]
    until: float
    reasons: Sequence[str]
    crossings: Sequence[tuple[Limit, RemainingLife]] = ()
    periods: Mapping[str, float | None] = dataclasses.field(default_factory=dict)
    jumps: Mapping[str, Sequence[float]] = dataclasses.field(default_factory=dict)
    unit: str | None = None
    misfits: Sequence[str] = ()
    widening: Mapping[str, float] = dataclasses.field(default_factory=dict)


class LedgerProofService(Protocol):
    """Tree heads of chains, and proofs of them; a `ProblemError` where there is none."""

    def head(self, twin_id: str) -> dict[str, Any]:
        """Return the signed tree head of a twin's chain."""
        ...

    def consistency(self, twin_id: str, first: int) -> dict[str, Any]:
        """Prove that a chain begins with its first entries as they were."""
        ...

    def inclusion(
        self, twin_id: str, boot: str, sequence: int, before: int | None
    ) -> dict[str, Any]:
        """Prove that a reading is among the entries of a chain, of those before one."""
        ...


class Knowledge(Protocol):
    """Interface by which REST, live stream and metrics read and change twins."""

    def ids(self, principal: Principal) -> list[str]:
        """Twins that a principal may see, in the order of their registration."""
        ...

    def registration(self, twin_id: str) -> Registration | None:
        """Return the registration of a twin; None where there is none."""
        ...

    def nominal(self, twin_id: str) -> dict[str, float] | None:
        """Return the nominal model in use; None while it is being learnt."""
        ...

    def nominal_modes(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the modes of a twin of elements as learnt; empty while they are not."""
        ...

    def spatial_scene(self, twin_id: str, state: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return measured shapes over the model's in space; None without a geometry."""
        ...

    def normal(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the normal behaviour under covariates, and detected departures from it."""
        ...

    def alive(self, twin_id: str) -> bool:
        """Whether the edge of a twin is there."""
        ...

    def sensor(self, twin_id: str) -> dict[str, int] | None:
        """Return counters of the live sensor; None for other inputs."""
        ...

    def link(self, twin_id: str) -> dict[str, Any] | None:
        """Return what the edge said of its link; None of one that sends all at once."""
        ...

    def heard_ns(self, twin_id: str) -> int | None:
        """When features last came; None where not since this server began."""
        ...

    def raised(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the alarms that are raised now: quantity, side and limit of each."""
        ...

    def latest(self, twin_id: str, at: Moment | None) -> HistoryPart:
        """Find the last state, now or at a moment: one, or none."""
        ...

    def history(
        self, twin_id: str, start: Moment | None, end: Moment | None, max_points: int
    ) -> HistoryPart:
        """States between two instants; of too many, a selection with statistics of all."""
        ...

    def since(self, twin_id: str, key: int, limit: int) -> HistoryPart:
        """States behind the one of `key`."""
        ...

    def boot_number(self, twin_id: str, boot: str) -> int | None:
        """Return the number of a boot in the keys of `since`; None where the twin has none.

        It counts the boots of all twins, so that it is told to nobody.
        """
        ...

    def outlook(
        self,
        twin_id: str,
        horizon: float | None,
        count: int,
        thresholds: Sequence[Limit] = (),
        at: Moment | None = None,
    ) -> TwinForecast | None:
        """Forecast a twin from now or from an instant; None if there are too few readings.

        Parameters
        ----------
        horizon
            Slow time ahead; the default of the registration if None.
        count
            Number of future slow times.
        thresholds
            Limits whose crossing times are wanted.
        at
            Instant from which to forecast; now if None.

        Returns
        -------
        The forecast, or None.
        """
        ...

    def track_record(self, twin_id: str) -> dict[str, Any]:
        """Return the past outlooks of a twin, and what came of them, as REST does."""
        ...

    def risk(
        self, twin_id: str, horizon: float | None, since: float | None = None
    ) -> dict[str, Any]:
        """Return the failure probability of a twin by each of its limit states.

        Parameters
        ----------
        twin_id
            SITE.ASSET.
        horizon
            Slow time ahead; the default of the registration if None.
        since
            Slow time of the reading whose forecast it has to agree with; the last if None, or
            if that forecast is not kept any more.

        Returns
        -------
        Probabilities as REST returns them.
        """

    def plan(
        self,
        twin_id: str,
        *,
        stale: bool = False,
        since: float | None = None,
        terms: RepairTerms | None = None,
    ) -> dict[str, Any]:
        """Return the maintenance plan of a twin; with `stale`, one of some readings ago.

        `terms` are terms of a repair other than those registered.

        Parameters
        ----------
        since
            As for `risk`.
        """
        ...

    def heads(self, after: int | None, limit: int) -> list[dict[str, Any]]:
        """Signed heads of the ledger: those that follow a number, or the newest."""
        ...

    @property
    def proofs(self) -> LedgerProofService:
        """Tree heads of chains, and proofs of them."""
        ...

    def ledger_refusal(self) -> str:
        """Why heads are not signed any more, with names of twins; empty if all is well."""
        ...

    def fatigue(self, twin_id: str) -> list[dict[str, Any]]:
        """Damage of each point of a twin, its course and the time that is left."""
        ...

    def virtual(self, twin_id: str) -> list[dict[str, Any]]:
        """Latest windows of virtual quantities, since this server began."""
        ...

    def conclusion(
        self, twin_id: str, reasons: int | None, suspects: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Answer whether anything is wrong with a twin now.

        Parameters
        ----------
        reasons
            Bits of its latest state (`twin_server.history.states`); None without one.
        suspects
            Changed elements in it.
        """
        ...

    def check(self, twin_id: str, order: SimulationOrder) -> None:
        """Refuse an invalid simulation by a `ProblemError`, at no cost."""
        ...

    def simulate(self, twin_id: str, order: SimulationOrder) -> bytes:
        """Simulate a twin, and return the response as JSON; refusals are a `ProblemError`."""
        ...

    def events(
        self, twin_id: str | None, *, after: int, limit: int, newest: bool
    ) -> list[tuple[int, str]]:
        """Find number and body of events in order."""
        ...

    def digest(self, twin_id: str) -> tuple[str, int]:
        """SHA-256 of a twin's whole history, and how many features it has."""
        ...

    def register(
        self, twin_id: str, registration: Registration, author: Author | None = None
    ) -> bool:
        """Register a twin; True where it is new."""
        ...

    def delete(self, twin_id: str) -> bool:
        """Forget a twin; False where there is none."""
        ...

    def troubles(self) -> list[str]:
        """Return sentences on problems of this server; none if all is well."""
        ...

    def cautions(self) -> list[str]:
        """Return sentences on what fails while readings go on; they name no twin."""
        ...

    def aside(self, twin_id: str) -> int:
        """Count the messages of a twin that are set aside."""
        ...

    def stalled(self) -> str:
        """Say that the work stands still; empty while it goes on."""
        ...

    def counts(self) -> Mapping[str, int]:
        """Return all counters."""
        ...

    def refused(self) -> Mapping[str, int]:
        """Return the number of refusals for each reason."""
        ...

    def gauges(self) -> Mapping[str, Any]:
        """Return the gauges of the server."""
        ...
