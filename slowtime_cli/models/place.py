"""The verb `place`: sensors that tell most about the parameters of a model."""

import json
from pathlib import Path
from typing import Any

import click

from slowtime_api.finite_elements.placement import PlacedSensors
from slowtime_api.finite_elements.placement import place as place_on
from slowtime_cli.shared.terminal import note, show


def place(model: Path, number: int, **given: Any) -> None:
    """Read the model, choose the sensors, and print them."""
    as_json = given.pop("as_json")
    given["directions"] = given["directions"] or ("ux", "uy", "uz")
    _print(place_on(model, number, **given), as_json=as_json)


def _print(found: PlacedSensors, *, as_json: bool) -> None:
    sites = [{"site": site, "directions": " ".join(ways)} for site, ways in found.sites]
    if as_json:
        click.echo(json.dumps({"sensors": sites, "parameters": found.rows()}, indent=2))
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
