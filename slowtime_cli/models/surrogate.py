"""The verb `surrogate`: fits surrogates to runs of a model, and predicts with the best."""

import csv
import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.surrogate.choice import Choice
from slowtime_api.probabilities.surrogates import FittedSurrogate, Kind, fit_surrogate
from slowtime_cli.shared.tables import read_columns
from slowtime_cli.shared.terminal import counting, note, show

PARTS = ("value", "sd", "lo", "hi", "extrapolated")
"""Columns of a prediction."""


def surrogate(
    runs: Path,
    output: str,
    inputs: tuple[str, ...] | None,
    kinds: tuple[Kind, ...],
    at: Path | None,
    out: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Compare surrogates by cross-validation, and predict with the best.

    Raises
    ------
    ValueError
        Where no surrogate can be learnt from the runs.
    """
    table = read_columns(runs)
    names = _inputs(table, output, inputs, runs)
    with counting("comparing surrogates"):
        columns = {name: table[name] for name in names}
        fitted = fit_surrogate(columns, table[output], list(kinds) or None, seed=seed)
    chosen = fitted.choice
    shares = [(name, *pair) for name, pair in fitted.sobol.items()]
    predicted = None if at is None else _predict(fitted, at, names)
    if predicted is not None and out is not None:
        _write(out, names, predicted)
    if as_json:
        click.echo(json.dumps(_body(chosen, shares, names, predicted), indent=1))
        return
    note(chosen.why)
    _show(chosen, shares)
    if predicted is not None and out is None:
        _show_predictions(names, predicted)


def _inputs(
    table: dict[str, np.ndarray], output: str, inputs: tuple[str, ...] | None, path: Path
) -> tuple[str, ...]:
    wanted = inputs or tuple(name for name in table if name != output)
    missing = [name for name in (output, *wanted) if name not in table]
    if missing or output in wanted or not wanted:
        raise click.UsageError(
            f"{path.name} has the columns {', '.join(table)}; "
            f"{', '.join(missing) or output} cannot be used so. Name the output and its inputs."
        )
    return wanted


def _predict(
    fitted: FittedSurrogate, at: Path, names: tuple[str, ...]
) -> list[tuple[list[float], float, float, float, float, bool]]:
    """Predict: inputs, value, sd, ends of the band, and whether the runs lie elsewhere."""
    table = read_columns(at)
    missing = [name for name in names if name not in table]
    if missing:
        raise click.UsageError(f"{at.name} lacks {', '.join(missing)}. Give all inputs.")
    found = fitted.predict({name: table[name] for name in names})
    if found.extrapolated.any():
        note(
            f"{int(found.extrapolated.sum())} of {len(found.value)} points lie outside the "
            "range of the runs; their values are extrapolated."
        )
    return [
        ([row[name] for name in names], *(row[part] for part in PARTS)) for row in found.rows()
    ]


def _write(out: Path, names: tuple[str, ...], predicted: list[Any]) -> None:
    with out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*names, "value", "sd", "lo", "hi", "extrapolated"])
        for row, *told, beyond in predicted:
            writer.writerow([*row, *told, int(beyond)])


def _body(
    chosen: Choice,
    shares: list[tuple[str, float, float]],
    names: tuple[str, ...],
    predicted: list[Any] | None,
) -> dict[str, Any]:
    return {
        "chosen": chosen.name,
        "why": chosen.why,
        "candidates": [
            {
                "name": one.name,
                "crps": one.crps if one.failure is None else None,
                "rmse": one.rmse if one.failure is None else None,
                "coverage": one.coverage if one.failure is None else None,
                "failure": one.failure,
            }
            for one in chosen.candidates
        ],
        "sobol": [
            {"input": name, "first": first, "total": total} for name, first, total in shares
        ],
        "predictions": [
            {
                **dict(zip(names, row, strict=True)),
                "value": value, "sd": sd, "lo": lo, "hi": hi, "extrapolated": beyond,
            }
            for row, value, sd, lo, hi, beyond in predicted or ()
        ],
    }  # fmt: skip


def _show(chosen: Choice, shares: list[tuple[str, float, float]]) -> None:
    good = [one for one in chosen.candidates if one.failure is None]
    show(
        "Points left out, predicted",
        ("surrogate", "crps", "rmse", "inside the 95 % band [%]"),
        [
            (one.name, f"{one.crps:.3g}", f"{one.rmse:.3g}", f"{100 * one.coverage:.0f}")
            for one in good
        ],
        plain=[
            {"surrogate": o.name, "crps": o.crps, "rmse": o.rmse, "coverage": o.coverage}
            for o in good
        ],
    )
    if shares:
        click.echo()
        show(
            "Sobol' indices",
            ("input", "alone [%]", "in total [%]"),
            [(name, f"{100 * one:.1f}", f"{100 * total:.1f}") for name, one, total in shares],
            plain=[
                {"input": name, "first": one, "total": total} for name, one, total in shares
            ],
        )


def _show_predictions(names: tuple[str, ...], predicted: list[Any]) -> None:
    click.echo()
    show(
        "Predictions",
        (*names, "value", "sd", "lo", "hi"),
        [
            (*(f"{v:.5g}" for v in row), *(f"{v:.5g}" for v in told))
            for row, *told, _ in predicted
        ],
        plain=[
            {
                **dict(zip(names, row, strict=True)),
                **dict(zip(("value", "sd", "lo", "hi"), told, strict=True)),
                "extrapolated": beyond,
            }
            for row, *told, beyond in predicted
        ],
    )
