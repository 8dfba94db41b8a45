"""Orders diagnoses of twins that disagree, adopts what they find, and undoes adoptions.

It does what `on_disagreement` of a registration allows, and an event gives the reason of each
decision. What it remembers of a twin ends with the server: a disagreement that lasts is noticed
again by the server that starts next.
"""

import dataclasses
import logging
import threading
from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol

from twin_server.identity.principals import SERVER, Principal
from twin_server.orders import DiagnosisOrder, FromEdge
from twin_server.pipeline.monitoring.gap import Comparison
from twin_server.registration.disagreement import DisagreementPolicy
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError

logger = logging.getLogger(__name__)

DECIDED = "policy"
"""Kind of the events that say what was decided without a person, and why."""


class DiagnosisDesk(Protocol):
    """What orders, adopts and undoes diagnoses, as REST asks for it too."""

    def order(
        self,
        twin_id: str,
        registration: Registration,
        order: DiagnosisOrder,
        principal: Principal,
    ) -> int:
        """Take an order; return its number."""
        ...

    def adopt(self, twin_id: str, registration: Registration, number: int) -> None:
        """Adopt the result of a diagnosis."""
        ...

    def undo(self, twin_id: str, registration: Registration, number: int) -> None:
        """Undo the latest adoption."""
        ...


@dataclasses.dataclass(slots=True)
class _Disagreement:
    """What has been done about the disagreement of one twin.

    Parameters
    ----------
    running
        Number of the diagnosis under way; None for none.
    before
        The registration that it was ordered with.
    tries
        Diagnoses ordered since the model last agreed.
    waited
        Comparisons since the last of them ended.
    against
        Comparisons in a row that speak against what was adopted.
    """

    running: int | None = None
    before: Registration | None = None
    tries: int = 0
    waited: int = 0
    against: int = 0


class AutomaticDiagnoses:
    """Acts on comparisons and on ended diagnoses as registrations allow.

    Parameters
    ----------
    registration
        Gives that of a twin; None where there is no such twin.
    note
        Stores an event: twin, kind, severity, message, details.
    samples_s
        Raw samples of a diagnosis whose policy does not say how many [s].
    """

    def __init__(
        self,
        desk: DiagnosisDesk,
        registration: Callable[[str], Registration | None],
        note: Callable[
            [str, str, Literal["info", "warning", "alarm"], str, Mapping[str, Any]], None
        ],
        samples_s: float,
    ) -> None:
        self._desk, self._registration, self._note = desk, registration, note
        self._samples_s = samples_s
        self._twins: dict[str, _Disagreement] = {}
        self._lock = threading.Lock()

    def compared(self, twin_id: str, found: Comparison) -> None:
        """React to a comparison; called by the thread that compares."""
        registration = self._registration(twin_id)
        policy = None if registration is None else registration.on_disagreement
        if registration is None or policy is None:
            self._twins.pop(twin_id, None)
            return
        with self._lock:
            mind = self._twins.setdefault(twin_id, _Disagreement())
            if self._speaks_against(registration, policy, mind, found):
                self._undo(twin_id, registration, mind, found)
            elif not found.disagrees:
                mind.tries = mind.waited = 0
            elif mind.against or found.in_use <= found.limit:
                pass  # it may be undone soon, or has just been: that would be another model's
            elif mind.running is None and mind.tries < policy.tries:
                mind.waited += 1
                if not mind.tries or mind.waited > policy.between:
                    self._order(twin_id, registration, policy, mind)

    def ended(self, twin_id: str, number: int, report: Mapping[str, Any] | None) -> None:
        """Adopt what a diagnosis has found, if it was ordered here and the policy allows it.

        Parameters
        ----------
        report
            None where the diagnosis failed.
        """
        with self._lock:
            mind = self._twins.get(twin_id)
            if mind is None or mind.running != number:
                return
            before, mind.before = mind.before, None
            mind.running, mind.waited, mind.against = None, 0, 0
        registration = self._registration(twin_id)
        policy = None if registration is None else registration.on_disagreement
        if report is None or registration is None or policy is None:
            return
        reason = refusal(policy, report)
        if reason is None and before is not None and registration.model != before.model:
            reason = "the model of the twin was changed meanwhile."
        if reason is not None:
            message = f"Diagnosis {number} is not adopted without a person: {reason}"
            self._note(twin_id, DECIDED, "warning", message, {"diagnosis": number})
            return
        try:
            self._desk.adopt(twin_id, registration, number)
        except ProblemError as error:
            message = f"Diagnosis {number} could not be adopted: {error}"
            self._note(twin_id, DECIDED, "warning", message, {"diagnosis": number})
            return
        gap = report["gap"]
        message = (
            f"Diagnosis {number} was adopted without a person: its probability is "
            f"{_probability(report):.1%}, and the error of the free run falls from "
            f"{gap['refitted_nominal']:.1%} to {gap['augmented']:.1%}."
        )
        self._note(twin_id, DECIDED, "info", message, {"diagnosis": number})

    def _speaks_against(
        self,
        registration: Registration,
        policy: DisagreementPolicy,
        mind: _Disagreement,
        found: Comparison,
    ) -> bool:
        """Count a comparison against the adopted model; whether they suffice to undo it."""
        last = registration.adopted[-1] if registration.adopted else None
        if policy.undo_after is None or last is None or last.clock != "fast":
            mind.against = 0
            return False
        worse = found.in_use > found.limit and found.in_use > found.nominal
        mind.against = mind.against + 1 if worse else 0
        return mind.against >= policy.undo_after

    def _undo(
        self, twin_id: str, registration: Registration, mind: _Disagreement, found: Comparison
    ) -> None:
        number, times = registration.adopted[-1].diagnosis, mind.against
        mind.against = mind.tries = mind.waited = 0
        try:
            self._desk.undo(twin_id, registration, number)
        except ProblemError as error:
            logger.info("Diagnosis %d of %s stays adopted: %s", number, twin_id, error)
            return
        self._note(
            twin_id, DECIDED, "warning",
            f"Diagnosis {number} was undone without a person: in {times} comparisons in a row "
            f"the model with it is worse than the one without it, {found.in_use:.1%} against "
            f"{found.nominal:.1%}.",
            {"diagnosis": number},
        )  # fmt: skip

    def _order(
        self,
        twin_id: str,
        registration: Registration,
        policy: DisagreementPolicy,
        mind: _Disagreement,
    ) -> None:
        seconds = policy.samples_s or self._samples_s
        order = DiagnosisOrder(
            raw=FromEdge(duration_s=seconds), holdout_s=policy.holdout_s, quick=policy.quick
        )
        try:
            mind.running = self._desk.order(twin_id, registration, order, SERVER)
        except ProblemError as error:
            # An edge that is away, or a full queue: asked again at the next comparison.
            logger.info("No diagnosis of %s was ordered: %s", twin_id, error)
            return
        mind.before = registration
        mind.tries += 1
        self._note(
            twin_id, DECIDED, "info",
            f"Diagnosis {mind.running} was ordered without a person, of the last {seconds:g} s "
            f"of raw samples: attempt {mind.tries} of {policy.tries}.",
            {"diagnosis": mind.running},
        )  # fmt: skip


def refusal(policy: DisagreementPolicy, report: Mapping[str, Any]) -> str | None:
    """Return why a policy does not adopt what a report says; None where it does.

    Examples
    --------
    >>> refusal(DisagreementPolicy(), {"verdict": "missing_effect"})
    'adopting is left to a person.'
    """
    if policy.adopt_above is None:
        return "adopting is left to a person."
    allowed = ("missing_effect", *["undecided"] * policy.adopt_undecided)
    if report["verdict"] not in allowed or not report["effects"]:
        return f"its verdict is {report['verdict'].replace('_', ' ')}."
    probability = _probability(report)
    if probability < policy.adopt_above:
        return f"its probability is {probability:.1%}, below {policy.adopt_above:.1%}."
    gap = report["gap"]
    if gap["augmented"] >= gap["refitted_nominal"]:
        return (
            f"the error of the free run does not fall: {gap['refitted_nominal']:.1%} without "
            f"it, {gap['augmented']:.1%} with it."
        )
    return None


def _probability(report: Mapping[str, Any]) -> float:
    """Probability of the least certain effect, or of all that are not told apart together."""
    if report["verdict"] == "undecided":
        return min(1.0, sum(float(one["probability"]) for one in report["undecided"]))
    return min(float(effect["probability"]) for effect in report["effects"])
