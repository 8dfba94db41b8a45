"""The verb `place`: sensors that tell most about the parameters of a model."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.evolution.structures import (
    ModePrecision,
    Placement,
    PlacementProblem,
    ReducedStructure,
    place_sensors,
)
from slowtime.finite_elements.degrees_of_freedom import DIRECTIONS, DofMap
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime_cli.shared.terminal import note, show
from slowtime_services.matrices import MatrixFileError, MatrixModel, read_matrix_model

TRANSLATIONS = ("ux", "uy", "uz")
Candidate = tuple[str, tuple[str, ...]]
"""Node (or channel) and directions of a site."""


def place(model: Path, number: int, **given: Any) -> None:
    """Read the model, choose the sensors, and print them."""
    read = read_matrix_model(model)
    if not read.matrices.names or read.matrices.dofs is None:
        raise MatrixFileError(
            f"{model.name} needs `parameters` (the quantities to identify) and `dofs` "
            "(possible sensor positions) under `matrices`."
        )
    kept = len(read.channels) if given["keep"] else 0
    rows, sites, names = _candidates(read, read.matrices.dofs, given)
    modes = min(given["modes"], read.matrices.size)
    coordinates = max(100, 3 * modes)
    settings = BasisSettings(modes=modes, coordinates=min(coordinates, read.matrices.size))
    reduced = reduce_modal(read.matrices, settings, trials=0)
    precision = ModePrecision(
        modes=modes, frequency_sd=given["frequency_sd"], shape_sd=given["shape_sd"]
    )
    problem = PlacementProblem(
        ReducedStructure(model=reduced), rows, sites, precision, read.prior_sd
    )
    best = place_sensors(
        problem, number, fixed=tuple(range(kept)), criterion=given["criterion"]
    )
    even = problem.placement(_evenly(names, number, kept))
    _print(best, even, [names[site] for site in best.sites], as_json=given["as_json"])


def _candidates(
    read: MatrixModel, dofs: DofMap, given: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, list[Candidate]]:
    """Rows of all candidate sensors, their sites, and the names of the sites."""
    directions = given["directions"] or TRANSLATIONS
    wanted = [DIRECTIONS.index(word) for word in directions]
    free = np.ones(dofs.size, dtype=bool)
    if read.matrices.expansion is not None:
        free = np.diff(read.matrices.expansion.indptr) > 0
    rows, names = [], list[Candidate]()
    if given["keep"]:
        rows += list(read.sensors)
        names += [(channel, ()) for channel in read.channels]
    for node, name in enumerate(dofs.node_names):
        own = np.flatnonzero((dofs.node == node) & free)
        found = [k for way in wanted for k in own if dofs.direction[k] == way]
        if given["together"] and len(found) < len(wanted):
            continue
        sets = [found] if given["together"] else [[k] for k in found]
        for one in sets:
            rows += [np.eye(1, dofs.size, int(k))[0] for k in one]
            names.append((name, tuple(DIRECTIONS[dofs.direction[k]] for k in one)))
    if not names:
        raise MatrixFileError(
            f"No node is free in {', '.join(directions)}. Give another --direction."
        )
    each = len(wanted) if given["together"] else 1
    return np.array(rows), np.repeat(np.arange(len(names)), each), names


def _evenly(names: list[Candidate], number: int, kept: int) -> tuple[int, ...]:
    """As many sites, spread evenly over the list of candidates."""
    others = np.linspace(kept, len(names) - 1, max(number - kept, 0)).round().astype(int)
    return (*range(kept), *others.tolist())


def _print(best: Placement, even: Placement, chosen: list[Candidate], *, as_json: bool) -> None:
    sites = [{"site": site, "directions": " ".join(ways)} for site, ways in chosen]
    parameters = [
        {"parameter": name, "prior_sd": prior, "posterior_sd": sd, "evenly_spread_sd": other}
        for name, prior, sd, other in zip(
            best.names,
            best.prior_sd.tolist(),
            best.posterior_sd.tolist(),
            even.posterior_sd.tolist(),
            strict=True,
        )
    ]
    if as_json:
        click.echo(json.dumps({"sensors": sites, "parameters": parameters}, indent=2))
        return
    show(
        "Sensors, in the order of what they add",
        ("site", "directions"),
        [tuple(one.values()) for one in sites],
        plain=sites,
    )
    mean, other = float(best.posterior_sd.mean()), float(even.posterior_sd.mean())
    note(
        f"Expected standard deviation of a parameter: {mean:.2%} on average, against "
        f"{float(best.prior_sd.mean()):.2%} before, and {other:.2%} with evenly spread sensors."
    )
    unseen = [name for name, ratio in zip(best.names, best.ratio, strict=True) if ratio > 0.5]
    if unseen:
        note(
            "Poorly identifiable (more than half of the prior standard deviation remains): "
            f"{', '.join(unseen)}."
        )
