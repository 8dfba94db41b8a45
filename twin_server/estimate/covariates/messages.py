"""Sentences about covariates: their law, and changes that they do not explain."""

from collections.abc import Sequence
from typing import Any

from slowtime.evolution.covariates import ChangeEstimate
from slowtime.identification.estimates import Measured
from slowtime_schemas.slow_times import span_in_words, time_in_words
from twin_server.estimate.notices import Notice
from twin_server.registration.nominal import Covariates
from twin_server.registration.twin import Registration

from .condition import Condition, Verdict


def learnt(row: int, condition: Condition, wanted: Covariates, mode: int | None) -> Notice:
    """Make the notice that normal behaviour was learnt."""
    told = told_of(condition, wanted)
    at = ", ".join(f"{name} = {value:.4g}" for name, value in told["reference"].items())
    law = {
        "constant": "it does not depend on any of them",
        "bilinear": f"the law is bilinear about {told['bend_c'] or 0.0:.3g} °C",
    }.get(told["law"], f"the law is {told['law']}")
    return Notice(
        row,
        "normal_learnt",
        "info",
        f"Normal behaviour has been learnt{_of(mode)} from {told['readings']} readings: "
        f"{told['frequency_hz']:.5g} Hz at {at}; {law}, and leaves "
        f"{100 * told['unexplained']:.2g} % of the frequency unexplained.",
        told if mode is None else {"mode": mode + 1, **told},
    )


def not_learnt(row: int, mode: int | None, why: str) -> Notice:
    """Make the notice that training failed and starts again."""
    return Notice(
        row,
        "normal_not_learnt",
        "warning",
        f"Normal behaviour could not be learnt{_of(mode)}; training starts again. {why}",
        {},
    )


def entered(
    row: int, verdict: Verdict, registration: Registration, mode: int | None, unit: str
) -> Notice:
    """Make the notice that a change without covariates began, or ended.

    Parameters
    ----------
    unit
        Of slow time, as the message of the reading names it.
    """
    wanted = registration.covariates
    assert wanted is not None
    names = " and ".join(wanted.names)
    details = {
        "mode": None if mode is None else mode + 1,
        "evidence": verdict.evidence,
        "limit": verdict.limit,
        **entry_of(verdict.entry, registration),
    }
    if not verdict.holds:
        message = f"What {names} did not explain is seen no more{_of(mode)}."
        return Notice(row, "change_gone", "info", message, details)
    entry = verdict.entry
    said = _percent(entry.frequency.value, entry.frequency_interval)
    if registration.changes in ("stiffness", "mass"):
        size = details[f"{registration.changes}_change"]
        change = _percent(size["value"], (size["lo"], size["hi"]))
        said += f", a change of {registration.changes} by {change}"
    first, last = entry.since_interval
    return Notice(
        row,
        "change_entered",
        "alarm",
        f"A change has occurred that {names} cannot explain: frequency{_of(mode)} {said}, "
        f"since {time_in_words(entry.since, unit)} ({time_in_words(first, unit)} to "
        f"{time_in_words(last, unit)}). False alarms like this come once in "
        f"{span_in_words(verdict.limit, unit, digits=3)} at most.",
        details,
    )


def normal_of(
    conditions: Sequence[tuple[int | None, Condition]], registration: Registration
) -> list[dict[str, Any]]:
    """Render normal behaviour and lasting changes of each mode."""
    wanted = registration.covariates
    if wanted is None:
        return []
    told = []
    for mode, condition in conditions:
        entry = condition.entered(wanted)
        said = None if entry is None else entry_of(entry, registration)
        told.append({"model_mode": mode, **told_of(condition, wanted), "entered": said})
    return told


def told_of(condition: Condition, wanted: Covariates) -> dict[str, Any]:
    """Render normal behaviour of one frequency."""
    normal = condition.normal
    return {
        "law": normal.law,
        "bend_c": normal.bend if normal.law == "bilinear" else None,
        "frequency_hz": condition.frequency_hz,
        "reference": dict(zip(wanted.names, condition.reference, strict=True)),
        "readings": condition.readings,
        "unexplained": (normal.wander_sd**2 + normal.noise**2) ** 0.5,
        "time_between_false_alarms": condition.limit,
    }


def entry_of(entry: ChangeEstimate, registration: Registration) -> dict[str, Any]:
    """Render a lasting change; as stiffness or mass where only one may change."""
    told: dict[str, Any] = {
        "frequency_change": _named(entry.frequency, entry.frequency_interval),
        "since": entry.since,
        "since_interval": list(entry.since_interval),
    }
    if registration.changes == "stiffness":
        told["stiffness_change"] = _named(entry.stiffness, entry.stiffness_interval)
    if registration.changes == "mass":
        value, (lo, hi) = entry.stiffness.value, entry.stiffness_interval
        sd = entry.stiffness.sd / (1 + value) ** 2
        told["mass_change"] = _named(
            Measured(1 / (1 + value) - 1, sd), (1 / (1 + hi) - 1, 1 / (1 + lo) - 1)
        )
    return told


def _named(measured: Measured, interval: tuple[float, float]) -> dict[str, float]:
    lo, hi = interval
    return {"value": measured.value, "sd": measured.sd, "lo": lo, "hi": hi}


def _of(mode: int | None) -> str:
    return "" if mode is None else f" of mode {mode + 1}"


def _percent(value: float, interval: tuple[float, float]) -> str:
    lo, hi = interval
    said = f"{100 * value:+.2g} % (95 % interval {100 * lo:+.2g} to {100 * hi:+.2g})"
    return said.replace("-", "−")
