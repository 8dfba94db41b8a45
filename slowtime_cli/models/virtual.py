"""The verb `virtual`: estimates displacements, drifts, forces and moments of a model."""

import contextlib
import csv
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from pydantic import ValidationError

from slowtime.estimation.virtual import VirtualSettings
from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import note, show
from slowtime_services.files import Record, bridged
from slowtime_services.matrices import read_any_description
from slowtime_services.virtual_sensors.sensor import make_sensor, si_factors
from slowtime_services.virtual_sensors.settings import Asked

REASON_TEXTS = {
    "unseen_mode_": "{}: no sensor sees this mode, so its contribution comes from the model "
    "alone.",
    "model_misfit": "{}: the model does not explain the spectra of the channels. Update it.",
}


@with_record
def virtual(model: Path, record: Record, path: Path, **given: Any) -> None:
    """Estimate a quantity, and write or summarise it."""
    out: Path | None = given.pop("out")
    asked = asked_quantity(given)
    found = estimate_quantity(model, record, asked, given)
    values, sd, settled = found["values"], found["sd"], found["settled"]
    if out is not None:
        aside = str(out) == "-"
        with contextlib.ExitStack() as stack:
            target = sys.stdout if aside else stack.enter_context(out.open("w", newline=""))
            writer = csv.writer(target)
            writer.writerow(["time_s", f"{asked.name}_{found['unit']}", "sd", "settled"])
            for i, row in enumerate(zip(values, sd, settled, strict=True)):
                writer.writerow(
                    [f"{i / record.rate_hz:.6f}", *map(_short, row[:2]), int(row[2])]
                )
        if aside:
            return
    some = settled if settled.any() else np.ones_like(settled)
    plain = {
        "quantity": asked.name,
        "unit": found["unit"],
        "rms": float(np.sqrt(np.mean(values[some] ** 2))),
        "largest": float(np.abs(values[some]).max()),
        "sd": float(np.sqrt(np.mean(sd[some] ** 2))),
        "lowest_hz": found["lowest_hz"],
        "seconds": len(values) / record.rate_hz,
    }
    show(
        f"{asked.name} from {len(found['channels'])} channels",
        (
            "quantity",
            f"rms [{found['unit']}]",
            "largest",
            "mean sd",
            "above [Hz]",
            "length [s]",
        ),
        [
            [
                asked.name,
                *(f"{plain[k]:.4g}" for k in ("rms", "largest", "sd", "lowest_hz", "seconds")),
            ]
        ],
        plain=[plain],
    )
    note_limits(found)


def asked_quantity(given: dict[str, Any]) -> Asked:
    """Take the quantity out of the flags.

    Raises
    ------
    click.UsageError
        Where the flags do not make one quantity of a model.
    """
    wanted = {
        name: given.pop(name)
        for name in (
            "quantity",
            "node",
            "between",
            "element",
            "end",
            "factor",
            "factor_sd",
        )
    }
    wanted["unit"] = given.pop("factor_unit")
    wanted["between"] = wanted["between"] or None
    where = wanted["node"] or wanted["element"] or "-".join(wanted["between"] or ())
    try:
        return Asked(name=f"{where}.{wanted['quantity']}", **wanted)
    except ValidationError as error:
        raise click.UsageError(first_message(error)) from None


def estimate_quantity(
    model: Path, record: Record, asked: Asked, given: dict[str, Any]
) -> dict[str, Any]:
    """Estimate a quantity of a model from the accelerations of a record.

    Parameters
    ----------
    given
        Flags; `lowest_hz` [Hz] and `moving_base` are taken out of it.

    Returns
    -------
    `values` and `sd` [time], in `unit`; `settled` [time], whether the filters have settled;
    `missing` and `wrong`, the variances of unseen modes and of the model's own error;
    `reasons`, `channels`, `lowest_hz` [Hz].

    Raises
    ------
    click.ClickException
        Where the record is shorter than one window.
    """
    description = read_any_description(model, note=note)
    record, said = bridged(record)
    if said:
        note(said)
    settings = VirtualSettings(lowest_hz=given.pop("lowest_hz"))
    sensor, channels = make_sensor(
        description, record.channels, [asked], record.rate_hz, settings,
        moving_base=given.pop("moving_base"),
    )  # fmt: skip
    columns = [record.channels.index(channel) for channel in channels]
    factors = si_factors(description, channels, [record.units[c] for c in columns])
    samples = np.asarray(record.samples, dtype=float)[:, columns] * factors
    state, windows = sensor.step(sensor.start(), samples)
    _, last = sensor.finish(state)
    if not windows:
        raise click.ClickException(
            f"The record of {record.duration_s:.0f} s is shorter than one window of "
            f"{sensor.window / record.rate_hz:.0f} s, 40 periods of the lowest mode. Give a "
            "longer one."
        )
    every = (*windows, *last)
    if description.tolerance is None:
        note(
            "The model states no tolerance, so its own error is not part of the standard "
            "deviation."
        )
    return {
        "values": np.concatenate([window.values[:, 0] for window in every]),
        "sd": np.concatenate([window.sd[:, 0] for window in every]),
        "settled": np.concatenate([window.settled for window in every]),
        "missing": float(np.mean([window.missing_variance[0] for window in every])),
        "wrong": float(np.mean([window.model_variance[0] for window in every])),
        "reasons": tuple(dict.fromkeys(r for window in every for r in window.reasons)),
        "unit": sensor.outputs[0].unit,
        "channels": channels,
        "lowest_hz": sensor.lowest_hz,
    }


def note_limits(found: dict[str, Any]) -> None:
    """Note the lower edge of the band, and reasons for larger errors than stated."""
    note(
        f"Only motion above {found['lowest_hz']:.3g} Hz is included: accelerations do not "
        "show slower motion."
    )
    for reason in found["reasons"]:
        note(REASON_TEXTS.get(reason.rstrip("0123456789"), "{}").format(reason))


def first_message(error: ValidationError) -> str:
    """Return the first message of a validation error, without its prefix."""
    return str(error.errors(include_url=False)[0]["msg"]).removeprefix("Value error, ")


def _short(value: float) -> str:
    return f"{value:.7g}"
