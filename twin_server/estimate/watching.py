"""What a person is told: alarms and changes of validity, once each, not once a reading.

A belief is changed only when several readings in a row speak against it, and an alarm ends only
when it is as certain that the limit is no longer passed as it once was that it was.
"""

import dataclasses
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool
from scipy.special import ndtri

from twin_server.registration import Alarm, Registration
from twin_server.states import LEARNING, States, sentences

from .checkpoint import Belief, Checkpoint


class Notice(NamedTuple):
    """Something worth an event.

    Parameters
    ----------
    row
        Which of the states it belongs to.
    """

    row: int
    kind: str
    severity: Literal["info", "warning", "alarm"]
    message: str
    details: dict[str, Any]


def watch(
    registration: Registration, checkpoint: Checkpoint, states: States
) -> tuple[Checkpoint, list[Notice]]:
    """Follow validity and alarms of one twin through its next states."""
    notices: list[Notice] = []
    judged = (states["reasons"] & LEARNING) == 0
    valid = states["reasons"] == 0
    trusted, flips = _follow(
        checkpoint.trusted, valid & judged, ~valid & judged, registration.confirm_readings
    )
    notices += [_validity(states, row, holds) for row, holds in flips]
    raised = []
    for alarm, belief in zip(registration.alarms, checkpoint.raised, strict=True):
        passed, cleared = _evidence(alarm, states)
        belief, flips = _follow(belief, passed, cleared, registration.confirm_readings)
        raised.append(belief)
        notices += [_alarm(alarm, states, row, holds) for row, holds in flips]
    notices.sort(key=lambda notice: notice.row)
    if trusted == checkpoint.trusted and tuple(raised) == checkpoint.raised:
        return checkpoint, notices
    return dataclasses.replace(checkpoint, trusted=trusted, raised=tuple(raised)), notices


def _follow(
    belief: Belief,
    speaks_for: Bool[np.ndarray, " time"],
    speaks_against: Bool[np.ndarray, " time"],
    confirm: int,
) -> tuple[Belief, list[tuple[int, bool]]]:
    """Find the belief after these readings, and at which of them it changed to what.

    A reading that speaks neither for nor against breaks no row.
    """
    contrary = speaks_against if belief.holds else speaks_for
    if not belief.against and not contrary.any():
        return belief, []
    holds, against, flips = belief.holds, belief.against, []
    for row, (yes, no) in enumerate(
        zip(speaks_for.tolist(), speaks_against.tolist(), strict=True)
    ):
        if yes == no:
            continue
        against = against + 1 if yes != holds else 0
        if against >= confirm:
            holds, against = not holds, 0
            flips.append((row, holds))
    return Belief(holds, against), flips


def _evidence(
    alarm: Alarm, states: States
) -> tuple[Bool[np.ndarray, " time"], Bool[np.ndarray, " time"]]:
    """Where the limit is certainly passed, and where it certainly is not."""
    value, sd = states[alarm.quantity][:, 0], states[alarm.quantity][:, 1]
    beyond = alarm.below - value if alarm.below is not None else value - (alarm.above or 0.0)
    margin = float(ndtri(alarm.certainty)) * sd
    passed: Bool[np.ndarray, " time"] = (beyond > 0.0) & (beyond >= margin)
    cleared: Bool[np.ndarray, " time"] = (beyond < 0.0) & (-beyond >= margin)
    return passed, cleared


def _validity(states: States, row: int, holds: bool) -> Notice:
    if holds:
        return Notice(row, "validity", "info", "Estimates are valid again.", {"valid": True})
    reasons = sentences(int(states["reasons"][row]))
    return Notice(
        row,
        "validity",
        "warning",
        "Estimates are not valid: " + " ".join(reasons),
        {"valid": False, "reasons": list(reasons)},
    )


def _alarm(alarm: Alarm, states: States, row: int, holds: bool) -> Notice:
    value, sd, lo, hi = states[alarm.quantity][row].tolist()
    details = {
        "quantity": alarm.quantity,
        "limit": alarm.below if alarm.below is not None else alarm.above,
        "side": "below" if alarm.below is not None else "above",
        "certainty": alarm.certainty,
        "estimate": {"value": value, "sd": sd, "lo": lo, "hi": hi},
    }
    said = f"{value:.4g} (95 % interval {lo:.4g} to {hi:.4g})"
    if holds:
        message = f"{alarm.name} with {alarm.certainty:.1%} certainty: {said}."
        return Notice(row, "alarm", "alarm", message, details)
    message = f"No longer {alarm.name}: {said}."
    return Notice(row, "alarm_cleared", "info", message, details)
