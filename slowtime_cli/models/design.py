"""The verb `design`: optimises a design, and compares it with the starting one."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.design import Design, Evaluated
from slowtime_api.probabilities.designs import load_samples, optimise_file
from slowtime_cli.shared.record_input import note_reading, read_any
from slowtime_cli.shared.terminal import note, show
from slowtime_services.files import ALL, ReadingOptions


def design(
    design: Path,
    alphas: Sequence[float],
    variation: float,
    out_model: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Optimise, once for each weight of the mean.

    Raises
    ------
    ValueError
        Where the file, its model or its load cannot be used.
    """
    answer = optimise_file(
        design, _samples, alphas=alphas, variation=variation, seed=seed, say=note
    )
    task, found = answer.task, answer.designs
    if out_model is not None:
        if task.structure is None:
            raise ValueError(f"{design.name} has no model. Leave --out out, or give .json.")
        answer.model().save(out_model)
        note(f"{out_model}: the model with the design built in.")
    if as_json:
        body = {"name": task.name, "seed": seed, "designs": [_object(one) for one in found]}
        click.echo(json.dumps(body, indent=1, allow_nan=False))
        return
    if len(found) > 1:
        _show_weights(found)
    else:
        _show(found[0])
    for one in found:
        for said in one.warnings:
            note(said)


def _samples(
    path: Path, channel: str | None, rate_hz: float | None
) -> tuple[np.ndarray, float]:
    """Read the record of a load."""
    record = read_any(path, ReadingOptions(rate_hz=rate_hz, keep=(ALL,)))
    note_reading(record)
    return load_samples(record, path.name, channel), record.rate_hz


def _object(found: Design) -> dict[str, Any]:
    """One optimisation as JSON holds it."""
    return {
        "alpha": found.alpha,
        "reference": {"mean": found.reference[0], "sd": found.reference[1]},
        "feasible": found.feasible,
        "start": _evaluated(found, found.start),
        "best": _evaluated(found, found.best),
        "at_bounds": dict(found.bounds),
        "rounds": found.rounds,
        "calls": found.calls,
        "warnings": list(found.warnings),
    }


def _evaluated(found: Design, one: Evaluated) -> dict[str, Any]:
    return {
        "variables": dict(zip(found.names, one.variables.tolist(), strict=True)),
        "objective": one.value,
        "mean": one.mean,
        "sd": one.sd,
        "constraints": {
            name: {
                "probability": verified.found.probability,
                "interval": None
                if verified.found.interval is None
                else list(verified.found.interval),
                "accepted": verified.accepted,
                "met": verified.met,
            }
            for name, verified in one.constraints.items()
        },
    }


def _show(found: Design) -> None:
    rows, plain = [], []
    for k, name in enumerate(found.names):
        start, best = float(found.start.variables[k]), float(found.best.variables[k])
        at = found.bounds.get(name)
        rows.append((name, f"{start:.5g}", f"{best:.5g}", f"at its {at} bound" if at else ""))
        plain.append({"variable": name, "start": start, "best": best, "bound": at})
    for name in ("mean", "sd", "value"):
        label = {"value": "objective (4.18)"}.get(name, f"objective {name}")
        start, best = getattr(found.start, name), getattr(found.best, name)
        rows.append((label, f"{start:.5g}", f"{best:.5g}", ""))
        plain.append({"variable": label, "start": start, "best": best, "bound": None})
    show(f"Design, alpha = {found.alpha:g}", ("", "start", "best", ""), rows, plain=plain)
    if found.best.constraints:
        _show_constraints(found)


def _show_constraints(found: Design) -> None:
    rows, plain = [], []
    words = {True: "met", False: "violated", None: "met within sampling error"}
    for name, best in found.best.constraints.items():
        start = found.start.constraints[name].found.probability
        lo, hi = best.found.interval or (None, None)
        interval = "none" if lo is None else f"{lo:.3g} to {hi:.3g}"
        probability = best.found.probability
        rows.append(
            (name, f"{start:.3g}", f"{probability:.3g}", interval, f"{best.accepted:.3g}",
             words[best.met])
        )  # fmt: skip
        plain.append(
            {"limit_state": name, "start": start, "best": probability, "lo": lo, "hi": hi,
             "accepted": best.accepted, "met": best.met}
        )  # fmt: skip
    click.echo()
    heads = (
        "limit state",
        "P_f at start [1]",
        "P_f [1]",
        "95 % interval [1]",
        "accepted [1]",
        "",
    )
    show("Probability of failure", heads, rows, plain=plain)


def _show_weights(found: Sequence[Design]) -> None:
    """Designs side by side, one row for each weight of the mean."""
    rows, plain = [], []
    for one in found:
        worst = max(
            (each.found.probability / each.accepted for each in one.best.constraints.values()),
            default=0.0,
        )
        rows.append(
            (
                f"{one.alpha:g}",
                *(f"{value:.5g}" for value in one.best.variables),
                f"{one.best.mean:.5g}",
                f"{one.best.sd:.5g}",
                f"{worst:.2f}",
            )
        )
        plain.append(
            {
                "alpha": one.alpha,
                **dict(zip(one.names, one.best.variables.tolist(), strict=True)),
                "mean": one.best.mean,
                "sd": one.best.sd,
                "worst": worst,
            }
        )
    heads = ("alpha", *found[0].names, "objective mean", "objective sd", "P_f / accepted")
    show("Designs by weight of the mean", heads, rows, plain=plain)
