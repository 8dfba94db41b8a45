"""Simulates the current structure of a twin under an ordered load, and renders the answer."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic_core import to_json

from slowtime_schemas.messages import Features
from twin_server.estimate import (
    CurrentStructure,
    OrderError,
    Simulated,
    Twin,
    UnknownStructureError,
    check,
    current_structure_of,
    simulate,
)
from twin_server.history.rendering import estimate_objects
from twin_server.orders import SimulationOrder
from twin_server.persist import Store, StoredHistory
from twin_server.pipeline.ingestion.rows import decoded
from twin_server.pipeline.workers.processes import WorkerPool
from twin_server.serve import ProblemError

_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
_ROUND = 7
"""Significant digits of the numbers of an answer."""


class Simulations:
    """Has simulations run where there is room for them.

    Parameters
    ----------
    workers
        Where they are run.
    effects
        Installed parts that may be imported there.
    """

    def __init__(
        self, store: Store, workers: WorkerPool, effects: tuple[str, ...] = ()
    ) -> None:
        self._store, self._workers, self._effects = store, workers, effects

    def check(self, twin: Twin, order: SimulationOrder) -> None:
        """Refuse an invalid simulation, at no cost.

        Raises
        ------
        ProblemError
            Saying what to change.
        """
        try:
            check(twin.registration, twin.checkpoint, order)
        except OrderError as error:
            raise ProblemError(422, "not-valid", str(error)) from error

    def run(
        self,
        twin_id: str,
        twin: Twin,
        found: StoredHistory,
        now: Mapping[str, tuple[float, float]],
        order: SimulationOrder,
    ) -> bytes:
        """Return the answer as JSON.

        Parameters
        ----------
        found
            The newest states of the twin.
        now
            What the forecast believes of each change at its last reading.

        Raises
        ------
        ProblemError
            Where it cannot be run.
        """
        last = None
        if twin.checkpoint.elements is not None and len(found.states):
            after = found.number[-1], int(found.states["sequence"][-1]) - 1
            rows = self._store.messages(twin_id, after, 1)
            last = decoded(rows[0].message) if rows else None
        try:
            return self._workers.run(
                answered, twin_id, twin, found, now, last, order, self._effects
            )
        except UnknownStructureError as error:
            raise ProblemError(409, "not-known-yet", str(error)) from error
        except OrderError as error:
            raise ProblemError(422, "not-valid", str(error)) from error


def answered(
    twin_id: str,
    twin: Twin,
    found: StoredHistory,
    now: Mapping[str, tuple[float, float]],
    last: Features | None,
    order: SimulationOrder,
    effects: tuple[str, ...] = (),
) -> bytes:
    """Simulate the current structure of a twin, and render the result for REST.

    Raises
    ------
    UnknownTodayError, OrderError
        Where it cannot be run.
    """
    today = current_structure_of(
        twin.registration, twin.checkpoint, found.states, found.bodies, now, last
    )
    today = dataclasses.replace(today, parts=effects)
    unit = found.boots[found.number[-1]][1]
    return to_json(
        _simulation_document(twin_id, twin, today, unit, order, simulate(today, order))
    )


def _simulation_document(
    twin_id: str,
    twin: Twin,
    today: CurrentStructure,
    unit: str,
    order: SimulationOrder,
    found: Simulated,
) -> dict[str, Any]:
    model = twin.registration.model
    angle = model is not None and model.unit_of_coordinate == "rad"
    own = _UNITS[order.quantity].replace("m", "rad") if angle else _UNITS[order.quantity]
    base = "rad/s^2" if angle else "m/s^2"
    bands, names = found.bands, found.outputs
    parts = {"value": bands.mean, "sd": bands.sd, "lo": bands.lo, "hi": bands.hi}
    peaks, means = (estimate_objects(table.tolist()) for table in (bands.peak, bands.rms))
    return {
        "id": twin_id,
        "slow_time": today.slow_time,
        "slow_time_unit": unit,
        "on": order.on,
        "load_unit": base if order.on == "base" else ("N m" if angle else "N"),
        "quantity": order.quantity,
        "unit": own,
        "frame": "absolute" if order.quantity == "acceleration" else "relative_to_base",
        "rate_hz": found.rate_hz,
        "draws": found.draws,
        "level": order.level,
        "seed": order.seed,
        "t_s": _rounded(found.times.tolist()),
        "load": _rounded(found.load.tolist()),
        "outputs": {
            name: {
                **{key: _rounded(table[:, i].tolist()) for key, table in parts.items()},
                "peak": peaks[i],
                "rms": means[i],
            }
            for i, name in enumerate(names)
        },
        "today": {
            "changes": {
                name: {"value": value, "sd": sd} for name, (value, sd) in today.changes.items()
            },
            "frequencies_hz": estimate_objects(found.frequencies.tolist()),
            "damping_ratios": estimate_objects(found.dampings.tolist()),
        },
        "assumed": list(today.assumed),
        "valid": not found.reasons,
        "reasons": list(found.reasons),
    }


def _rounded(numbers: Sequence[float]) -> list[float]:
    """Numbers with as many digits as a band deserves: an answer holds many of them."""
    return [float(f"{number:.{_ROUND}g}") for number in numbers]
