"""Twins: without a server, and of a running server."""

import contextlib
import json
import math
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from slowtime_schemas.answers.forecasts import ForecastModel
from slowtime_schemas.answers.plans import PlanModel
from slowtime_schemas.answers.risks import RiskModel
from slowtime_schemas.answers.twins import State
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.argument_checks import (
    Bounds,
    Count,
    NotNegative,
    Positive,
    Vector,
    checked,
)
from slowtime_services.bus import Sample
from slowtime_services.client import Client, TwinHistory
from slowtime_services.documents.document_files import read_json_file
from twin_server.events.asset_events import orders_in
from twin_server.history.rendering import points, state_objects
from twin_server.orders import SimulationOrder
from twin_server.persist import SqliteStore
from twin_server.pipeline import AssetEvents, Pipeline, TwinKnowledge
from twin_server.registration.costs import RepairTerms
from twin_server.registration.nominal import Nominal
from twin_server.registration.twin import Registration, registrations
from twin_server.serve import ProblemError, foretell
from twin_server.settings import TwinSettings

from .arguments import existing_file, fields_named, with_arguments
from .deprecations import renamed
from .plotting import Axes, new_figure, save
from .twin_files import samples_of
from .twin_responses import TwinResponse

SITE, ASSET = "offline", "twin"
_ARGUMENTS = {
    "frequency_hz": "nominal_hz",
    "damping_ratio": "nominal_damping",
    "learn_epochs": "learn_readings",
}
"""Field of a registration → argument of `Twin`."""
EPOCH_NS = 946_684_800_000_000_000
"""2000-01-01 UTC [ns]: sensor time of slow time 0, for which nothing but the order counts."""
Changes = Literal["stiffness", "mass", "both"]
Learning = Annotated[int, Bounds(least=2)]


class Twin:
    """A twin kept in this process: no server, no network.

    The estimates are those of a twin server with the same registration, and the answers are the
    objects that `slowtime.connect` returns. Keys, as in ``state["stiffness_change"]``, still
    work with a warning.

    Parameters
    ----------
    nominal_hz, nominal_damping
        Natural frequency [Hz] and damping ratio [1] as built; learnt from the first readings
        where not given.
    changes
        What may change: ``"stiffness"``, ``"mass"`` or ``"both"``.
    learn_readings
        Readings from which nominal values are learnt.
    registration
        Further fields of a registration, as a server takes them: ``costs`` and ``decision`` for
        `plan`, ``limit_states`` for `risk`, ``forecast``, ``alarms``.

    Raises
    ------
    ValueError
        If a nominal value is not possible, or a field of the registration is wrong.

    Examples
    --------
    >>> twin = Twin(nominal_hz=3.0, nominal_damping=0.02)
    >>> state = twin.update(slow_time=1.0, frequency_hz=2.97, frequency_sd=0.01)
    >>> round(float(state.stiffness_change), 3)
    -0.02
    """

    MADE_BY = "slowtime.Twin(nominal_hz=...) or slowtime.evolve(...)"
    """What makes one, for messages."""

    @checked
    def __init__(
        self,
        *,
        nominal_hz: Positive | None = None,
        nominal_damping: NotNegative | None = None,
        changes: Changes = "stiffness",
        learn_readings: Learning = 20,
        registration: Mapping[str, Any] | None = None,
    ) -> None:
        if nominal_hz is None and nominal_damping is not None:
            raise ValueError("nominal_damping was given without nominal_hz. Give both.")
        with fields_named(_ARGUMENTS):
            nominal = (
                None
                if nominal_hz is None
                else Nominal(frequency_hz=nominal_hz, damping_ratio=nominal_damping)
            )
            own = {"changes": changes, "nominal": nominal, "learn_epochs": learn_readings}
            self._begin(Registration.model_validate(own | dict(registration or {})))

    def _begin(self, registration: Registration, twin_id: str = f"{SITE}.{ASSET}") -> None:
        """Start a pipeline with an empty database in a temporary file."""
        self.registration, self._id = registration, twin_id
        self._count, self._last, self._sent = 0, -math.inf, list[tuple[str, bytes]]()
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="slowtime-"))
            database = Path(folder) / "twin.sqlite"
            self._store = stack.enter_context(contextlib.closing(SqliteStore(database)))
            self._pipeline = Pipeline(TwinSettings(database=database, connect=()), self._store)
            self._pipeline.start()
            stack.callback(self._pipeline.stop)
            self._pipeline.register(self._id, registration)
            self._knowledge = TwinKnowledge(self._pipeline, self._store)
            self._close = weakref.finalize(self, stack.pop_all().close)

    @classmethod
    @checked
    def from_file(
        cls,
        path: str | Path,
        *,
        asset: str | None = None,
        registration: str | Path | Mapping[str, Any] | None = None,
        events: str | Path | None = None,
    ) -> "Twin":
        """Make a twin of a file of readings, as ``slowtime twin evolve`` and ``forecast`` do.

        Parameters
        ----------
        path
            Recording (.mcap), epochs that ``slowtime identify --window-s`` wrote (.json), or
            text with the columns slow_time, frequency_hz and frequency_sd.
        asset
            Twin of a recording of several.
        registration
            Fields of a registration, or the path of a file of registrations (TOML or JSON);
            nominal values are learnt from the first readings where not given.
        events
            File of maintenance events (JSON).

        Returns
        -------
        The twin, with all readings of the file.

        Raises
        ------
        ValueError
            If the file has no readings, or a line cannot be read.
        FileNotFoundError
            If there is no such file.
        """
        try:
            twin_id, samples = samples_of(existing_file(path), asset)
            twin = object.__new__(cls)
            with fields_named({}):
                twin._begin(_registration(registration, twin_id), twin_id)
            twin._ingest(samples)
        except ValueError as error:
            raise ValueError(with_arguments(str(error))) from error
        if not twin.history():
            raise ValueError(f"{path} holds no epoch. Give one with some.")
        if events is not None:
            twin._record(Path(events))
        return twin

    def _ingest(self, samples: Iterable[Sample]) -> None:
        """Take messages as a server does, and keep them for copies."""
        taken = list(samples)
        self._sent += [(sample.key, bytes(sample.payload)) for sample in taken]
        self._pipeline.ingest(taken)
        self._pipeline.give_up()

    def _record(self, events: Path) -> None:
        keeping = AssetEvents(self._pipeline, self._store)
        for order in orders_in(read_json_file(existing_file(events))):
            with _problems():
                keeping.record(self._id, self.registration, order, order.person or "offline")

    def __getstate__(self) -> dict[str, Any]:
        """Return registration and messages; a copy estimates again from these."""
        self._check_open()
        return {
            "registration": self.registration, "id": self._id, "sent": self._sent,
            "count": self._count, "last": self._last,
        }  # fmt: skip

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._begin(state["registration"], state["id"])
        self._ingest(
            Sample(key, payload, None, replayed=True) for key, payload in state["sent"]
        )
        self._count, self._last = state["count"], state["last"]

    def close(self) -> None:
        """Remove the twin's temporary files; it happens by itself at the end of the program."""
        self._close()

    @checked
    def update(
        self,
        slow_time: float,
        frequency_hz: NotNegative,
        frequency_sd: NotNegative,
        damping_ratio: NotNegative | None = None,
        damping_sd: NotNegative | None = None,
    ) -> State:
        """Add a reading, and return the state after it.

        Parameters
        ----------
        slow_time
            Slow time of the reading, in any unit; ascending.
        frequency_hz, frequency_sd
            Natural frequency and its standard deviation [Hz].
        damping_ratio, damping_sd
            Damping ratio and its standard deviation [1], where measured.

        Returns
        -------
        State with ``stiffness_change`` and ``mass_change`` (``value``, ``sd`` and the ends
        ``lo`` and ``hi`` of the 95 % interval) [1], ``valid`` and ``reasons``.

        Raises
        ------
        ValueError
            If slow time does not ascend, or a number is not possible.

        Examples
        --------
        >>> twin = Twin(nominal_hz=3.0, nominal_damping=0.02, changes="mass")
        >>> state = twin.update(0.0, 3.0, 0.01)
        >>> state.valid, state.stiffness_change is None
        (True, False)
        """
        self._check_open()
        if not self._last < slow_time:
            raise ValueError(
                f"Slow time {slow_time:g} was given after {self._last:g}. Give readings in "
                "ascending order of time."
            )
        if (damping_ratio is None) != (damping_sd is None):
            raise ValueError(
                "Of damping_ratio and damping_sd one was given. Give both or none."
            )
        mode = Mode(
            frequency_hz=Quantity(value=frequency_hz, sd=frequency_sd),
            damping_ratio=Quantity(value=damping_ratio or 0.0, sd=damping_sd or 0.0),
            correlation=0.0, flags=(),
        )  # fmt: skip
        site, _, asset = self._id.partition(".")
        t_ns = EPOCH_NS + self._count * 1_000_000_000
        features = Features(
            site=site, asset=asset, boot="offline", sequence=self._count, t_ns=t_ns,
            start_ns=t_ns, time_base="recorded", slow_time=slow_time, method="peak",
            modes=(mode,), quality=Quality(samples=0),
        )  # fmt: skip
        key, payload = FEATURES.key(site, asset), encode(features)
        self._pipeline.ingest([Sample(key, payload, None, replayed=True)])
        self._sent.append((key, payload))
        self._count, self._last = self._count + 1, slow_time
        return self._states(1)[0]

    @property
    def state(self) -> State | None:
        """The state after the last reading; None before the first."""
        self._check_open()
        return next(iter(self._states(1)), None)

    def history(self) -> TwinHistory:
        """Return the state after each reading.

        Returns
        -------
        States as `update` returns them, oldest first; ``to_pandas()`` makes a table of them.
        """
        self._check_open()
        return TwinHistory(self._states(None))

    def __len__(self) -> int:
        return len(self._sent)

    def _check_open(self) -> None:
        if not self._close.alive:
            raise ValueError("The twin was closed. Make another with slowtime.Twin(...).")

    def _check_read(self) -> None:
        self._check_open()
        if not self._sent:
            raise ValueError("The twin has no readings yet. Call `update` first.")

    def _states(self, last: int | None) -> list[State]:
        """Return the states after the last readings, oldest first; None for all."""
        found = self._store.history(self._id, limit=last, newest=last is not None)
        if not found.number:
            return []
        boots, units = zip(*(found.boots[number] for number in found.number), strict=True)
        body = points(state_objects(found.states, self._id, boots, units))
        return [State.model_validate(one) for one in json.loads(body)["points"]]

    @checked
    def forecast(
        self,
        horizon: Positive | None = None,
        *,
        threshold: float | None = None,
        points: Count = 40,
        quantity: str | None = None,
        toward: Literal["below", "above"] | None = None,
    ) -> ForecastModel:
        """Forecast the changes, and when a threshold is reached.

        Parameters
        ----------
        horizon
            How far ahead, in units of slow time; as long as the history where not given.
        threshold
            Change at which something happens, such as -0.2.
        points
            Number of points.
        quantity
            Quantity of the threshold, such as ``"mass_change"``; the only one that is estimated
            where not given.
        toward
            Side of the threshold that is asked for; the one where the quantity is not now where
            not given.

        Returns
        -------
        Forecast with bands, crossing times with their probabilities, and warnings.

        Raises
        ------
        ValueError
            If there are no readings yet, or the threshold is of nothing that is estimated.
        """
        self._check_read()
        with _problems():
            body = foretell(
                self._knowledge, self._id, self.registration, horizon, points,
                threshold=threshold, quantity=quantity, toward=toward,
            )  # fmt: skip
        return ForecastModel.model_validate(body)

    @checked
    def risk(self, horizon: Positive | None = None) -> RiskModel:
        """Compute the probability of failure by each limit state of the registration.

        Parameters
        ----------
        horizon
            How far ahead, in units of slow time; that of the forecast where not given.

        Returns
        -------
        Probability now, within the horizon and over time, by limit state.

        Raises
        ------
        ValueError
            If there are no readings, or the registration has no limit states.
        """
        self._check_read()
        if not self.registration.limit_states:
            raise ValueError(
                "The registration has no limit states. Give them as "
                "Twin(registration={'limit_states': [...]})."
            )
        with _problems():
            return RiskModel.model_validate(self._knowledge.risk(self._id, horizon))

    @checked
    def plan(
        self,
        *,
        lead_time: NotNegative | None = None,
        months: str | None = None,
        accepted: Positive | None = None,
    ) -> PlanModel:
        """Recommend an action: repair, inspect, wait or close, with reasons.

        Parameters
        ----------
        lead_time
            From the order of a repair to its effect, in the unit of the costs; as registered
            where not given.
        months
            Months in which a repair can take effect, such as ``"5-9"``.
        accepted
            Accepted probability of a failure [1].

        Returns
        -------
        Action, options with their expected costs, last safe day of an order, and what would
        change the decision.

        Raises
        ------
        ValueError
            If there are no readings, or the registration has no costs and decision.
        """
        self._check_read()
        if self.registration.costs is None or self.registration.decision is None:
            raise ValueError(
                "The registration has no costs and decision. Give them as "
                "Twin(registration={'costs': {...}, 'decision': {...}})."
            )
        with _problems():
            terms = RepairTerms(lead_time, months, accepted)
            return PlanModel.model_validate(self._knowledge.plan(self._id, terms=terms))

    @checked
    def simulate(self, load: Mapping[str, Any], **order: Any) -> TwinResponse:
        """Simulate the structure as it is now under a load, with bands.

        Parameters
        ----------
        load
            ``{"kind": "harmonic", "amplitude": 0.5, "frequency_hz": 3.9}``, ``"step"``,
            ``"white"`` with ``"psd"``, or ``"recorded"`` with ``"samples"``: an acceleration
            of the base [m/s^2], or a force [N] on a node.
        **order
            Other fields of an order, as a server takes them: ``on``, ``outputs``,
            ``quantity``, ``duration_s`` [s], ``rate_hz`` [Hz], ``level`` [1], ``draws`` and
            ``seed``.

        Returns
        -------
        Response of each node with its standard deviation and band.

        Raises
        ------
        ValueError
            If there are no readings, or load or order are not possible.
        """
        self._check_read()
        with fields_named({}):
            asked = SimulationOrder.model_validate({"load": dict(load)} | order)
        with _problems():
            return TwinResponse.of(json.loads(self._knowledge.simulate(self._id, asked)))

    to_dataframe = renamed("Twin.to_dataframe", "to_pandas")

    def to_pandas(self) -> Any:
        """Convert the history to a pandas DataFrame.

        Returns
        -------
        One row per reading: slow time, then value, sd, lo and hi of the frequency [Hz] and of
        the changes of stiffness and mass [1], and whether the state is valid.
        """
        return self.history().to_pandas()

    @checked
    def plot(self, path: str | Path | None = None) -> list[Axes]:
        """Draw the estimated changes over slow time, with 95 % intervals.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes, one for each change.
        """
        states = self.history()
        names = [
            name for name in ("stiffness_change", "mass_change")
            if self.registration.changes in ("both", name.removesuffix("_change"))
            and any(getattr(state, name) is not None for state in states)
        ]  # fmt: skip
        axes = new_figure(max(1, len(names)))
        for panel, name in zip(axes, names, strict=False):
            shown = [state for state in states if getattr(state, name) is not None]
            time = [state.slow_time for state in shown]
            value, lo, hi = (
                [100 * float(getattr(getattr(state, name), part)) for state in shown]
                for part in ("value", "lo", "hi")
            )
            panel.fill_between(time, lo, hi, alpha=0.3, label="95 % interval")
            panel.plot(time, value, marker=".", label="estimate")
            panel.set(xlabel="slow time", ylabel=f"{name.replace('_', ' ')} [%]")
            panel.legend()
        return list(save(axes, path))

    def __eq__(self, other: object) -> bool:
        """Whether registration and readings are the same."""
        if not isinstance(other, Twin):
            return NotImplemented
        return self.registration == other.registration and self._sent == other._sent

    __hash__ = None  # type: ignore[assignment]

    def _repr_html_(self) -> str:
        state = self.state
        return f"<p>{self!r}</p>" + ("" if state is None else state._repr_html_())

    def __repr__(self) -> str:
        return f"Twin: {len(self)} readings, changes of {self.registration.changes}"


def _registration(given: str | Path | Mapping[str, Any] | None, twin_id: str) -> Registration:
    """Return fields as a registration, or that of a twin in a file."""
    if given is None or isinstance(given, Mapping):
        return Registration.model_validate(dict(given or {}))
    found = registrations(existing_file(given))
    if twin_id in found:
        return found[twin_id]
    if len(found) == 1:
        return next(iter(found.values()))
    raise ValueError(
        f"{given} registers {', '.join(found) or 'nothing'}, not {twin_id}. Name one of them "
        "as asset, or add it."
    )


@contextlib.contextmanager
def _problems() -> Iterator[None]:
    """Convert what a server would answer with a problem to an error."""
    try:
        yield
    except ProblemError as error:
        raise ValueError(error.detail) from error


@checked
def evolve(
    slow_time: Vector,
    frequency_hz: Vector,
    frequency_sd: Vector,
    damping_ratio: Vector | None = None,
    damping_sd: Vector | None = None,
    *,
    nominal_hz: Positive | None = None,
    nominal_damping: NotNegative | None = None,
    changes: Changes = "stiffness",
    learn_readings: Learning = 20,
    registration: Mapping[str, Any] | None = None,
) -> Twin:
    """Estimate changes of stiffness and mass from a history of frequencies.

    Parameters
    ----------
    slow_time
        Slow time of each reading, in any unit; ascending.
    frequency_hz, frequency_sd
        Natural frequencies and their standard deviations [Hz], one for each reading.
    damping_ratio, damping_sd
        Damping ratios and their standard deviations [1], where measured.
    nominal_hz, nominal_damping
        Natural frequency [Hz] and damping ratio [1] as built; learnt from the first readings
        where not given.
    changes
        What may change: ``"stiffness"``, ``"mass"`` or ``"both"``.
    learn_readings
        Readings from which nominal values are learnt.
    registration
        Further fields of a registration, as `Twin` takes them.

    Returns
    -------
    Twin with the readings: `Twin.history` has the changes, `Twin.forecast` where they lead.

    Raises
    ------
    ValueError
        If lengths differ, slow time does not ascend, or a number is not possible.

    Examples
    --------
    >>> twin = evolve([0, 1, 2], [3.0, 2.99, 2.97], [0.01] * 3, nominal_hz=3.0)
    >>> [round(float(state.stiffness_change), 3) for state in twin.history()][1:]
    [-0.007, -0.02]
    """
    columns = [slow_time, frequency_hz, frequency_sd]
    if (damping_ratio is None) != (damping_sd is None):
        raise ValueError("Of damping_ratio and damping_sd one was given. Give both or none.")
    if damping_ratio is not None:
        columns += [damping_ratio, damping_sd]
    if len({len(column) for column in columns}) > 1:
        raise ValueError(
            f"Series of {', '.join(str(len(one)) for one in columns)} values were given. Give "
            "one value of each for each reading."
        )
    twin = Twin(
        nominal_hz=nominal_hz, nominal_damping=nominal_damping, changes=changes,
        learn_readings=learn_readings, registration=registration,
    )  # fmt: skip
    for reading in zip(*(column.tolist() for column in columns), strict=True):
        twin.update(*reading)
    return twin


@checked
def connect(
    url: str = "http://127.0.0.1:8000",
    *,
    token: str | None = None,
    ca: str | Path | None = None,
) -> Client:
    """Return a client of a twin server.

    Parameters
    ----------
    url
        Address of the server.
    token
        Token, where the server wants one; the environment variable SLOWTIME_TOKEN where not
        given.
    ca
        Certificates (PEM) to trust instead of the system's.

    Returns
    -------
    Client with typed answers: ``twins()``, ``history()``, ``forecast()`` and so on.

    Raises
    ------
    ValueError
        If `url` is not a valid address.

    Examples
    --------
    >>> connect("http://127.0.0.1:8000").url
    'http://127.0.0.1:8000'
    """
    return Client(url, token=token, ca=None if ca is None else existing_file(ca))
