"""Concludes from all that is known of a twin whether anything is wrong with it.

The answer is never "no" without data: what nothing new is known of may have failed.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from slowtime_schemas.answers.twins import ConclusionAnswer, FindingKind
from twin_server.history.states import BEGINNING, MEASURED_BEFORE, sentences

LIKELY = 0.5
"""Probability from which something is more likely than not [1]."""

POSSIBLE = 0.05
"""Probability from which something is mentioned [1]: what the intervals of 95 % leave out."""


class Concern(NamedTuple):
    """Something that stands against a structure, or against knowing it.

    Parameters
    ----------
    text
        Details, in a sentence.
    """

    kind: FindingKind
    text: str


class LimitProspect(NamedTuple):
    """When the limit of an alarm may be reached.

    Parameters
    ----------
    within
        Probability up to the horizon [1].
    already
        Probability that it has been reached [1].
    """

    within: float
    already: float
    sentence: str


class FailureProspect(NamedTuple):
    """How probable failure by a limit state is.

    Parameters
    ----------
    now, within
        Probability of failure at the last reading, and up to the horizon [1].
    accepted
        The probability that the registration accepts [1].
    reached
        Whether that is reached up to the horizon.
    """

    now: float
    within: float
    accepted: float
    reached: bool
    sentence: str


@dataclasses.dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of a twin.

    Parameters
    ----------
    reasons
        Bits of the latest state (`twin_server.history.states`); None without readings.
    alive
        Whether the sensor agent is online.
    silent_s
        How long the sensor has sent nothing [s]; 0 while it sends.
    late_s
        How long a reading is overdue [s]; 0 where none is.
    raised
        Sentences of the raised alarms.
    suspects
        Changed elements.
    unexplained
        Whether a change has entered that covariates do not explain.
    disagrees
        Whether the model disagrees with raw samples.
    set_aside
        Number of messages in quarantine.
    limits, failures
        Limits of alarms that may be reached, and limit states, up to the horizon.
    plan
        What the maintenance plan does at once, and its sentence; None without a plan.
    """

    reasons: int | None
    alive: bool
    silent_s: int = 0
    late_s: int = 0
    raised: Sequence[str] = ()
    suspects: Sequence[str] = ()
    unexplained: bool = False
    disagrees: bool = False
    set_aside: int = 0
    limits: Sequence[LimitProspect] = ()
    failures: Sequence[FailureProspect] = ()
    plan: tuple[str, str] | None = None


ANSWERS: dict[FindingKind, ConclusionAnswer] = {
    "limit_passed": "act",
    "risk_too_high": "act",
    "repair_due": "act",
    "inspection_due": "act",
    "risk_rising": "watch",
    "limit_near": "watch",
    "changed": "watch",
    "unexplained_change": "watch",
    "model_disagrees": "watch",
    "no_readings": "cannot_say",
    "agent_offline": "cannot_say",
    "sensor_silent": "cannot_say",
    "readings_late": "cannot_say",
    "learning": "cannot_say",
    "not_valid": "cannot_say",
    "set_aside": "watch",
}
"""ConclusionAnswer that each kind of finding gives."""

NEXT: dict[FindingKind, str] = {
    "limit_passed": "Inspect the structure, then acknowledge the alarm.",
    "risk_too_high": "Take the load off, or inspect the structure now.",
    "repair_due": "Repair it: the maintenance plan says why.",
    "inspection_due": "Inspect it: the maintenance plan says why.",
    "risk_rising": "Plan an inspection before the accepted probability is reached.",
    "limit_near": "Plan an inspection before the limit may be reached.",
    "changed": "Look at the elements that are named, on the structure or in their history.",
    "unexplained_change": "Look for what happened at that time, on structure and sensors.",
    "model_disagrees": "Start a diagnosis, which looks for what the model lacks.",
    "no_readings": "Start the sensor agent.",
    "agent_offline": "Start the sensor agent, or look at its network.",
    "sensor_silent": "Look at the sensor and its cable.",
    "readings_late": "Look at the log of the sensor agent.",
    "learning": "Wait: the first readings are the reference.",
    "not_valid": "Follow the reasons beside the latest state.",
    "set_aside": "Look at them with `slowtime twin quarantine`, and release or drop them.",
}
"""What to do about each kind of finding."""


class Conclusion(NamedTuple):
    """Whether anything is wrong, why, and what to do next.

    Parameters
    ----------
    findings
        The most urgent first; none only where the answer is no.
    """

    answer: ConclusionAnswer
    findings: tuple[Concern, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as REST gives it."""
        return {
            "answer": self.answer,
            "findings": [one._asdict() for one in self.findings],
            "next": NEXT[self.findings[0].kind] if self.findings else None,
        }


def conclude(known: Evidence) -> Conclusion:
    """ConclusionAnswer whether anything is wrong with a structure.

    Examples
    --------
    >>> conclude(Evidence(reasons=0, alive=True)).answer
    'no'
    >>> told = conclude(Evidence(reasons=0, alive=False))
    >>> told.answer, [one.kind for one in told.findings]
    ('cannot_say', ['agent_offline'])
    """
    order = list(ANSWERS)
    findings = sorted(_findings(known), key=lambda one: order.index(one.kind))
    answers = [ANSWERS[one.kind] for one in findings]
    urgency: tuple[ConclusionAnswer, ...] = ("act", "watch", "cannot_say")
    answer: ConclusionAnswer = next((one for one in urgency if one in answers), "no")
    findings.sort(key=lambda one: urgency.index(ANSWERS[one.kind]))
    return Conclusion(answer, tuple(findings))


def _findings(known: Evidence) -> Iterator[Concern]:
    """Yield what stands against a structure, and against knowing it."""
    yield from _of_structure(known)
    if known.set_aside:
        yield Concern("set_aside", f"{known.set_aside} of its messages were set aside.")
    if known.reasons is None:
        yield Concern("no_readings", "There are no readings yet.")
    elif reasons := known.reasons & ~MEASURED_BEFORE:
        kind: FindingKind = "learning" if reasons & BEGINNING else "not_valid"
        yield Concern(kind, sentences(reasons)[0])
    if not known.alive:
        yield Concern("agent_offline", "Its sensor agent is offline, so nothing new is known.")
    elif known.silent_s:
        yield Concern("sensor_silent", f"Its sensor has sent nothing for {known.silent_s} s.")
    elif known.late_s:
        yield Concern("readings_late", f"Its next reading is {known.late_s} s overdue.")


def _of_structure(known: Evidence) -> Iterator[Concern]:
    for text in known.raised:
        yield Concern("limit_passed", text)
    for one in known.failures:
        if one.now > one.accepted:
            yield Concern("risk_too_high", one.sentence)
        elif one.reached or one.within >= POSSIBLE:
            yield Concern("risk_rising", one.sentence)
    if known.plan is not None and known.plan[0] in ("repair", "close", "inspect"):
        act, sentence = known.plan
        yield Concern("inspection_due" if act == "inspect" else "repair_due", sentence)
    for limit in known.limits:
        # What is passed already is for the alarm to say, with its certainty.
        if limit.within >= POSSIBLE and limit.already < LIKELY:
            yield Concern("limit_near", limit.sentence)
    if known.suspects:
        yield Concern("changed", f"Changed: {', '.join(known.suspects)}.")
    if known.unexplained:
        text = "A change has entered that temperature and load do not explain."
        yield Concern("unexplained_change", text)
    if known.disagrees:
        yield Concern("model_disagrees", "Its model disagrees with what the sensors measure.")
