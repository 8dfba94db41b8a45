"""The verb `place`: sensors that tell most about the parameters of a model."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from slowtime.evolution.assessment import AssessmentSettings, DetectionLimit
from slowtime_api.finite_elements.placement import PlacedSensors
from slowtime_api.finite_elements.placement import place as place_on
from slowtime_cli.shared.terminal import note, show

ASSUMED = ("model_error", "temperature_sd", "false_alarm")
LIMIT_HEADINGS = ("member", "smallest loss [%]", "evenly spread [%]", "not told apart from")


def place(model: Path, number: int, **given: Any) -> None:
    """Read the model, choose the sensors, and print them."""
    as_json = given.pop("as_json")
    given["directions"] = given["directions"] or ("ux", "uy", "uz")
    settings = AssessmentSettings(**{name: given.pop(name) for name in ASSUMED})
    found = place_on(model, number, **given, settings=settings)
    _print(found, as_json=as_json)
    if found.limits and not as_json:
        _print_limits(found, given["power"], settings)


def _print(found: PlacedSensors, *, as_json: bool) -> None:
    sites = [{"site": site, "directions": " ".join(ways)} for site, ways in found.sites]
    if as_json:
        body = {"sensors": sites, "parameters": found.rows()}
        if found.limits:
            body["limits"] = _limits(found)
        click.echo(json.dumps(body, indent=2))
        return
    show(
        "Sensors, in the order of what they add",
        ("site", "directions"),
        [tuple(one.values()) for one in sites],
        plain=sites,
    )
    note(
        "Expected standard deviation of a parameter: "
        f"{float(found.posterior_sd.mean()):.2%} on average, against "
        f"{float(found.prior_sd.mean()):.2%} before, and "
        f"{float(found.evenly_spread_sd.mean()):.2%} with evenly spread sensors."
    )
    if found.poorly_identifiable:
        note(
            "Poorly identifiable (more than half of the prior standard deviation remains): "
            f"{', '.join(found.poorly_identifiable)}."
        )


def _limits(found: PlacedSensors) -> list[dict[str, Any]]:
    pairs = zip(found.limits, found.evenly_spread_limits, strict=True)
    return [
        {
            "name": one.name,
            "loss": _known(one.loss),
            "evenly_spread_loss": _known(even.loss),
            "alike": list(one.alike),
        }
        for one, even in pairs
    ]


def _known(loss: float) -> float | None:
    return loss if math.isfinite(loss) else None


def _print_limits(found: PlacedSensors, power: float, settings: AssessmentSettings) -> None:
    entries = _limits(found)
    rows = [
        (
            one["name"],
            _percent(one["loss"]),
            _percent(one["evenly_spread_loss"]),
            ", ".join(one["alike"]),
        )
        for one in entries
    ]
    plain = [one | {"alike": ", ".join(one["alike"])} for one in entries]
    show("Smallest losses", LIMIT_HEADINGS, rows, plain=plain)
    note(
        f"These losses are found between two measurements with {power:.0%} probability, at "
        f"{settings.false_alarm:.0%} false alarms. Largest: {_largest(found.limits)}, against "
        f"{_largest(found.evenly_spread_limits)} with evenly spread sensors."
    )


def _percent(loss: float | None) -> str:
    return "none" if loss is None else f"{100 * loss:.1f}"


def _largest(limits: Sequence[DetectionLimit]) -> str:
    known = [one.loss for one in limits if math.isfinite(one.loss)]
    unfound = len(limits) - len(known)
    said = f"{100 * max(known):.1f} %" if known else "none"
    return said if not unfound else f"{said} ({unfound} members are never found)"
