"""Raises and clears alarms, and changes of validity, from several readings in a row.

A belief is changed only when several readings in a row speak against it, and an alarm ends only
when it is as certain that the limit is no longer passed as it once was that it was.
"""

import dataclasses
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtri

from twin_server.history.states import BEGINNING, MEASURED_BEFORE, States, sentences
from twin_server.registration.thresholds import Alarm, shown, signed
from twin_server.registration.twin import Registration

from .checkpoint import Checkpoint, SteadyFlag
from .notices import Notice

Estimates: TypeAlias = Float[np.ndarray, "time 4"]
"""Value, sd, lo and hi."""


def follow_alarms(
    registration: Registration,
    checkpoint: Checkpoint,
    states: States,
    parameters: Mapping[str, Estimates] | None = None,
) -> tuple[Checkpoint, list[Notice]]:
    """Follow validity and alarms of one twin through its next states.

    Parameters
    ----------
    parameters
        Estimates of each parameter of a twin of elements at these states, NaN where none.
    """
    is_quiet = checkpoint.trusted.holds and not checkpoint.trusted.against
    if is_quiet and not checkpoint.raised and not states["reasons"].any():
        return checkpoint, []  # valid as before, and nothing is watched
    parameters = parameters or {}
    notices: list[Notice] = []
    judged = (states["reasons"] & (BEGINNING | MEASURED_BEFORE)) == 0
    new = (states["reasons"] & MEASURED_BEFORE) == 0
    valid = states["reasons"] == 0
    trusted, flips = _follow(
        checkpoint.trusted, valid & judged, ~valid & judged, registration.confirm_readings
    )
    notices += [_validity(states, row, holds) for row, holds in flips]
    raised = []
    watched = registration.watched() if registration.alarms else ()
    for (name, alarm), belief in zip(watched, checkpoint.raised, strict=True):
        estimates = parameters[name] if name in parameters else states[name]
        passed, cleared = _evidence(alarm, estimates)
        belief, flips = _follow(
            belief, passed & new, cleared & new, registration.confirm_readings
        )
        raised.append(belief)
        notices += [
            _alarm(name, alarm, estimates[row].tolist(), row, holds) for row, holds in flips
        ]
    notices.sort(key=lambda notice: notice.row)
    if trusted == checkpoint.trusted and tuple(raised) == checkpoint.raised:
        return checkpoint, notices
    return dataclasses.replace(checkpoint, trusted=trusted, raised=tuple(raised)), notices


def _follow(
    belief: SteadyFlag,
    speaks_for: Bool[np.ndarray, " time"],
    speaks_against: Bool[np.ndarray, " time"],
    confirm: int,
) -> tuple[SteadyFlag, list[tuple[int, bool]]]:
    """Return the belief after these readings, and the rows at which the alarm changes.

    A reading that neither supports nor contradicts the alarm does not end a row of readings.
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
    return SteadyFlag(holds, against), flips


def _evidence(
    alarm: Alarm, estimates: Estimates
) -> tuple[Bool[np.ndarray, " time"], Bool[np.ndarray, " time"]]:
    """Return where a limit is passed with certainty, and where it is not."""
    value, sd = estimates[:, 0], estimates[:, 1]
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


def _alarm(name: str, alarm: Alarm, estimate: list[float], row: int, holds: bool) -> Notice:
    value, sd, lo, hi = estimate
    side, limit = alarm.limit
    details = {
        "quantity": name,
        "limit": limit,
        "side": side,
        "certainty": alarm.certainty,
        "estimate": {"value": value, "sd": sd, "lo": lo, "hi": hi},
    }
    words, unit, times = shown(name)
    now, low, high, at = (signed(times * x) for x in (value, lo, hi, limit))
    said = f"{now} {unit}, 95 % interval {low} to {high} {unit}"
    if holds:
        sure = f"{100.0 * alarm.certainty:g} %"
        message = f"{words} {side} {at} {unit} with {sure} certainty: {said}."
        return Notice(row, "alarm", "alarm", message, details)
    message = f"{words} no longer {side} {at} {unit}: {said}."
    return Notice(row, "alarm_cleared", "info", message, details)
