"""Twins: without a server, and of a running server."""

import contextlib
import json
import math
import tempfile
import weakref
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import Sample
from slowtime_services.client import Client
from twin_server.history.rendering import points, state_objects
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline, TwinKnowledge
from twin_server.registration.nominal import Nominal
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError, foretell
from twin_server.settings import TwinSettings

from .arguments import existing_file, fields_named, finite, number, positive, whole
from .optional import optional
from .plotting import Figure, new_figure, save

SITE, ASSET = "offline", "twin"
_ARGUMENTS = {
    "frequency_hz": "nominal_hz",
    "damping_ratio": "nominal_damping",
    "learn_epochs": "learn_readings",
}
"""Field of a registration → argument of `Twin`."""
EPOCH_NS = 946_684_800_000_000_000
"""2000-01-01 UTC [ns]: sensor time of slow time 0, for which nothing but the order counts."""


class Twin:
    """A twin of one mode, kept in this process: no server, no network.

    The estimates are those of a twin server with the same registration.

    Parameters
    ----------
    nominal_hz, nominal_damping
        Natural frequency [Hz] and damping ratio [1] as built; learnt from the first readings
        where not given.
    changes
        What may change: ``"stiffness"``, ``"mass"`` or ``"both"``.
    learn_readings
        Readings from which nominal values are learnt.

    Raises
    ------
    ValueError
        If a nominal value is not possible.

    Examples
    --------
    >>> twin = Twin(nominal_hz=3.0, nominal_damping=0.02)
    >>> state = twin.update(slow_time=1.0, frequency_hz=2.97, frequency_sd=0.01)
    >>> round(state["stiffness_change"]["value"], 3)
    -0.02
    """

    def __init__(
        self,
        *,
        nominal_hz: float | None = None,
        nominal_damping: float | None = None,
        changes: Literal["stiffness", "mass", "both"] = "stiffness",
        learn_readings: int = 20,
    ) -> None:
        if nominal_hz is None and nominal_damping is not None:
            raise ValueError("nominal_damping was given without nominal_hz. Give both.")
        if changes not in ("stiffness", "mass", "both"):
            raise ValueError(f"changes={changes!r} was given. Allowed: stiffness, mass, both.")
        with fields_named(_ARGUMENTS):
            nominal = (
                None
                if nominal_hz is None
                else Nominal(frequency_hz=nominal_hz, damping_ratio=nominal_damping)
            )
            self.registration = Registration(
                changes=changes, nominal=nominal, learn_epochs=learn_readings
            )
        self._id, self._count, self._last = f"{SITE}.{ASSET}", 0, -math.inf
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="slowtime-"))
            database = Path(folder) / "twin.sqlite"
            self._store = stack.enter_context(contextlib.closing(SqliteStore(database)))
            self._pipeline = Pipeline(TwinSettings(database=database, connect=()), self._store)
            self._pipeline.start()
            stack.callback(self._pipeline.stop)
            self._pipeline.register(self._id, self.registration)
            self._close = weakref.finalize(self, stack.pop_all().close)

    def close(self) -> None:
        """Remove the twin's temporary files; it happens by itself at the end of the program."""
        self._close()

    def update(
        self,
        slow_time: float,
        frequency_hz: float,
        frequency_sd: float,
        damping_ratio: float | None = None,
        damping_sd: float | None = None,
    ) -> dict[str, Any]:
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
        State with ``stiffness_change``, ``mass_change`` (value, sd, lo, hi), ``valid`` and
        ``reasons``, as REST returns it.

        Raises
        ------
        ValueError
            If slow time does not ascend, or a number is not possible.
        """
        self._check_open()
        slow_time = number(slow_time, "slow_time", "a time in any unit, ascending")
        if not self._last < slow_time < math.inf:
            raise ValueError(
                f"Slow time {slow_time:g} was given after {self._last:g}. Give readings in "
                "ascending order of time."
            )
        if (damping_ratio is None) != (damping_sd is None):
            raise ValueError(
                "Of damping_ratio and damping_sd one was given. Give both or none."
            )
        ratio = damping_ratio or 0.0, damping_sd or 0.0
        mode = Mode(
            frequency_hz=_quantity("frequency", frequency_hz, frequency_sd, "Hz"),
            damping_ratio=_quantity("damping", *ratio, "1"), correlation=0.0, flags=(),
        )  # fmt: skip
        t_ns = EPOCH_NS + self._count * 1_000_000_000
        features = Features(
            site=SITE, asset=ASSET, boot="offline", sequence=self._count, t_ns=t_ns,
            start_ns=t_ns, time_base="recorded", slow_time=slow_time, method="peak",
            modes=(mode,), quality=Quality(samples=0),
        )  # fmt: skip
        self._pipeline.ingest(
            [Sample(FEATURES.key(SITE, ASSET), encode(features), None, replayed=True)]
        )
        self._count, self._last = self._count + 1, slow_time
        return self._states(1)[0]

    def history(self) -> list[dict[str, Any]]:
        """Return the state after each reading.

        Returns
        -------
        States as `update` returns them, oldest first.
        """
        self._check_open()
        return self._states(None)

    def _check_open(self) -> None:
        if not self._close.alive:
            raise ValueError("The twin was closed. Make another with slowtime.Twin(...).")

    def _states(self, last: int | None) -> list[dict[str, Any]]:
        """Return the states after the last readings, oldest first; None for all."""
        found = self._store.history(self._id, limit=last, newest=last is not None)
        if not found.number:
            return []
        boots, units = zip(*(found.boots[number] for number in found.number), strict=True)
        body = points(state_objects(found.states, self._id, boots, units))
        states: list[dict[str, Any]] = json.loads(body)["points"]
        return states

    def forecast(
        self,
        horizon: float | None = None,
        *,
        threshold: float | None = None,
        points: int = 40,
    ) -> dict[str, Any]:
        """Forecast the changes, and when a threshold is reached.

        Parameters
        ----------
        horizon
            How far ahead, in units of slow time; as long as the history where not given.
        threshold
            Change at which something happens, such as -0.2.
        points
            Number of points.

        Returns
        -------
        Forecast with bands, crossing times with their probabilities, and warnings, as REST
        returns it.

        Raises
        ------
        ValueError
            If there are no readings yet, or the threshold is of nothing that is estimated.
        """
        self._check_open()
        if not self._count:
            raise ValueError("The twin has no readings yet. Call `update` first.")
        if horizon is not None:
            horizon = positive(horizon, "horizon", "units of slow time")
        if threshold is not None:
            (threshold,) = finite([threshold], "threshold", "a change, such as -0.2")
        points = whole(points, "points", 1)
        try:
            return foretell(
                TwinKnowledge(self._pipeline, self._store), self._id, self.registration,
                horizon, points, threshold=threshold,
            )  # fmt: skip
        except ProblemError as error:
            raise ValueError(error.detail) from error

    def to_dataframe(self) -> Any:
        """Convert the history to a pandas DataFrame.

        Returns
        -------
        One row per reading: slow time, then value, sd, lo and hi of the frequency [Hz] and of
        the changes of stiffness and mass [1], and whether the state is valid.
        """
        rows = [
            {
                "slow_time": state["slow_time"],
                **{
                    f"{name}_{part}": (state[name] or {}).get(part)
                    for name in ("frequency_hz", "stiffness_change", "mass_change")
                    for part in ("value", "sd", "lo", "hi")
                },
                "valid": state["valid"],
            }
            for state in self.history()
        ]
        return optional("pandas").DataFrame(rows)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Draw the estimated changes over slow time, with 95 % intervals.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib figure.
        """
        states = self.history()
        names = [
            name for name in ("stiffness_change", "mass_change")
            if self.registration.changes in ("both", name.removesuffix("_change"))
            and any(state[name] is not None for state in states)
        ]  # fmt: skip
        figure, axes = new_figure(max(1, len(names)))
        for panel, name in zip(axes, names, strict=False):
            shown = [state for state in states if state[name] is not None]
            time = [state["slow_time"] for state in shown]
            value, lo, hi = (
                100 * np.array([state[name][part] for state in shown], dtype=float)
                for part in ("value", "lo", "hi")
            )
            panel.fill_between(time, lo, hi, alpha=0.3, label="95 % interval")
            panel.plot(time, value, marker=".", label="estimate")
            panel.set(xlabel="slow time", ylabel=f"{name.replace('_', ' ')} [%]")
            panel.legend()
        return save(figure, path)

    def __repr__(self) -> str:
        return f"Twin: {self._count} readings, changes of {self.registration.changes}"


def _quantity(name: str, value: Any, sd: Any, unit: str) -> Quantity:
    """Return a measured quantity, of which neither number can be negative."""
    numbers = [number(one, name, f"[{unit}]") for one in (value, sd)]
    if not all(0 <= one < math.inf for one in numbers):
        raise ValueError(
            f"A {name} of {numbers[0]:g} with a standard deviation of {numbers[1]:g} [{unit}] "
            "was given. Give finite numbers from 0."
        )
    return Quantity(value=numbers[0], sd=numbers[1])


def connect(
    url: str = "http://127.0.0.1:8000", *, token: str | None = None, ca: Path | None = None
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
    return Client(str(url), token=token, ca=None if ca is None else existing_file(ca))
