"""Facts about twins from which the answer about a composite is made."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from pydantic_core import from_json

from twin_server.composites.composite import Failing
from twin_server.history.rendering import state_objects
from twin_server.serve.knowledge import Knowledge

from .failure import Failure, failure_probability
from .pooled_rates import Rates, rates_of


class FailureQuestion(NamedTuple):
    """What is asked about the failure of one twin.

    Parameters
    ----------
    horizon
        How far ahead, in slow time; None for that of the twin's forecast.
    failing
        From where on it counts as failed; None for its own registration.
    """

    horizon: float | None
    failing: Failing | None = None


class TwinFacts(Protocol):
    """Facts about twins, whichever process has them."""

    def health(self, twins: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Find out whether twins are alive and valid, and their alarms."""
        ...

    def failures(self, asked: Mapping[str, FailureQuestion]) -> dict[str, Failure]:
        """Compute the failure probability of each twin asked about."""
        ...

    def rates(self, twins: Sequence[str]) -> dict[str, Rates]:
        """Compute the drift rates of twins."""
        ...


class KnownFacts:
    """Facts about the twins of this process.

    Parameters
    ----------
    knowledge
        What is known of them.
    """

    def __init__(self, knowledge: Knowledge) -> None:
        self._knowledge = knowledge

    def health(self, twins: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Find out whether twins are alive and valid, and their alarms."""
        return {twin_id: _health_of(self._knowledge, twin_id) for twin_id in twins}

    def failures(self, asked: Mapping[str, FailureQuestion]) -> dict[str, Failure]:
        """Compute the failure probability of each twin asked about."""
        return {
            twin_id: failure_probability(self._knowledge, twin_id, *question)
            for twin_id, question in asked.items()
        }

    def rates(self, twins: Sequence[str]) -> dict[str, Rates]:
        """Compute the drift rates of twins."""
        return {twin_id: rates_of(self._knowledge, twin_id) for twin_id in twins}


def _health_of(knowledge: Knowledge, twin_id: str) -> dict[str, Any]:
    registration = knowledge.registration(twin_id)
    if registration is None:
        gone = "It is not registered any more."
        return {
            "id": twin_id, "name": twin_id, "alive": False, "valid": False,
            "reasons": [gone], "alarms": [],
        }  # fmt: skip
    latest = knowledge.latest(twin_id, None)
    told = state_objects(latest.states, twin_id, latest.boots, latest.units)
    state = next(map(from_json, told), None)
    return {
        "id": twin_id,
        "name": registration.name or twin_id,
        "alive": knowledge.alive(twin_id),
        "valid": bool(state and state["valid"]),
        "reasons": list(state["reasons"]) if state else ["It has no features yet."],
        "alarms": knowledge.raised(twin_id),
    }
