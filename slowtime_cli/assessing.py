"""The verbs `fatigue` and `virtual`: stress cycles and damage, and what nobody measures."""

import contextlib
import csv
import json
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from pydantic import ValidationError

from slowtime.estimation.virtual import VirtualSettings
from slowtime.fatigue.counter import Count
from slowtime.fatigue.miner import TimeToFailure, equivalent_range
from slowtime.fatigue.spectral import METHODS, Moments, damage_rate
from slowtime.signals.spectra import welch
from slowtime_services.files import Record, bridged, find_column
from slowtime_services.models import read_description
from slowtime_services.virtual_sensors.sensor import make_sensor, si_factors
from slowtime_services.virtual_sensors.settings import Asked, PointCurve

from .reading import with_record
from .terminal import note, show

YEAR_S = 365.25 * 86_400
SPECTRAL_WINDOWS = 16
"""Windows of a record whose spectra are averaged for spectral methods."""


@with_record
def virtual(model: Path, record: Record, path: Path, **given: Any) -> None:
    """Estimate a quantity, and write or summarise it."""
    out: Path | None = given.pop("out")
    asked = _asked(given)
    found = _estimated(model, record, asked, given)
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
    _say(found)


@with_record
def fatigue(
    record: Record, path: Path, model: Path | None, channel: str | None, **given: Any
) -> None:
    """Count cycles of a stress, and tell the damage."""
    given.pop("second", None)
    as_json = given.pop("as_json")
    try:
        point = PointCurve(
            **{
                name: given.pop(name)
                for name in (
                    "detail_category", "constant", "slope", "knee", "lower_slope", "cut_off",
                    "log10_sd", "mean_stress", "strength", "constant_mean",
                )
            }
        )  # fmt: skip
    except ValidationError as error:
        raise click.UsageError(_first(error)) from None
    missing = wrong = 0.0
    reasons: tuple[str, ...] = ()
    if model is not None:
        asked = _asked(given)
        found = _estimated(model, record, asked, given)
        stress, name, unit = found["values"][found["settled"]], asked.name, found["unit"]
        missing, wrong, reasons = found["missing"], found["wrong"], found["reasons"]
        _say(found)
        if not len(stress):
            raise click.ClickException(
                f"The record of {record.duration_s:.0f} s ends before the filters have "
                "settled. Give a longer one."
            )
    else:
        stress, name, unit = _channel(record, channel)
    result = _result(stress, record.rate_hz, point, missing, wrong)
    result = {"point": name, "unit": unit, **result, "reasons": list(reasons)}
    if as_json:
        click.echo(json.dumps(result, indent=1, allow_nan=False))
        return
    _show(result)


def _result(
    stress: Any, rate_hz: float, point: PointCurve, missing: float, wrong: float
) -> dict[str, Any]:
    counter, curve = point.counter(), point.curve
    count = counter.step(Count(), np.asarray(stress, dtype=float))
    total, histogram = counter.miner(count), counter.total(count)
    seconds = (count.samples - count.skipped) / rate_hz
    if missing or wrong:
        size = count.sum_of_squares / max(1, count.samples)
        lacking = 0.5 * np.log1p(missing / size) if size else 0.0
        error = np.sqrt(wrong / size) if size else 0.0
        total = total.with_stress_error(
            float(np.hypot(error, lacking / 2)), float(np.exp(lacking))
        )
    rate = total.median / seconds if seconds else 0.0
    left = TimeToFailure.of(total, rate)
    low, high = total.interval()
    length = max(8, len(stress) // SPECTRAL_WINDOWS)
    spectrum = welch(np.asarray(stress, float)[:, None], rate_hz, segment_s=length / rate_hz)
    density = spectrum.density[:, 0]
    moments = Moments.of(spectrum.frequency_hz, density) if density.any() else None
    return {
        "seconds": seconds,
        "cycles": float(histogram.counts.sum()),
        "largest_range": float(histogram.ranges.max()) if histogram.half_cycles else 0.0,
        "equivalent_range": equivalent_range(histogram, curve.slope),
        "damage": {"median": total.median, "lo": low, "hi": high, "sd": total.sd},
        "damage_per_year": rate * YEAR_S,
        "years_to_failure": {
            f"{100 * p:g} %": _finite(left.quantile(p) / YEAR_S) for p in (0.05, 0.5, 0.95)
        },
        "spectral_damage_per_year": {}
        if moments is None
        else {method: damage_rate(moments, curve, method) * YEAR_S for method in METHODS},
        "histogram": {
            "ranges": histogram.ranges.tolist(), "cycles": histogram.counts.tolist(),
        },
        "skipped": count.skipped,
    }  # fmt: skip


def _show(result: dict[str, Any]) -> None:
    unit, damage, years = result["unit"], result["damage"], result["years_to_failure"]
    show(
        f"{result['point']}: {result['cycles']:.0f} cycles in {result['seconds']:.0f} s",
        ("what", "value", "unit"),
        [
            ["largest range", f"{result['largest_range']:.4g}", unit],
            ["equivalent range", f"{result['equivalent_range']:.4g}", unit],
            ["Miner's sum, median", f"{damage['median']:.4g}", "1"],
            ["  95 % interval", f"{damage['lo']:.3g} to {damage['hi']:.3g}", "1"],
            ["damage at this rate", f"{result['damage_per_year']:.4g}", "1/year"],
            ["time to failure, 5 %", _years(years["5 %"]), "years"],
            ["time to failure, 50 %", _years(years["50 %"]), "years"],
            ["time to failure, 95 %", _years(years["95 %"]), "years"],
            *(
                [f"spectral: {method}", f"{value:.4g}", "1/year"]
                for method, value in result["spectral_damage_per_year"].items()
            ),
        ],
        plain=[{k: v for k, v in result.items() if k != "histogram"}],
    )
    note("Time to failure: of this record repeated for ever.")


def _channel(record: Record, channel: str | None) -> tuple[Any, str, str]:
    if channel is None and len(record.channels) != 1:
        raise click.UsageError(
            f"The record has {len(record.channels)} channels: {', '.join(record.channels)}. "
            "Name the one of stress by --channel."
        )
    column = 0 if channel is None else find_column(channel, record.channels)
    unit = record.units[column] or "1"
    return record.samples[:, column], record.channels[column], unit


def _asked(given: dict[str, Any]) -> Asked:
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
        raise click.UsageError(_first(error)) from None


def _estimated(
    model: Path, record: Record, asked: Asked, given: dict[str, Any]
) -> dict[str, Any]:
    description = read_description(model)
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
        note("The model states no tolerance: its own error is not in the standard deviation.")
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


def _say(found: dict[str, Any]) -> None:
    note(
        f"Only motion above {found['lowest_hz']:.3g} Hz: accelerations do not show what is "
        "slower."
    )
    for reason in found["reasons"]:
        note(REASONS.get(reason.rstrip("0123456789"), "{}").format(reason))


REASONS = {
    "unseen_mode_": "{}: no sensor sees this mode, so that its part rests on the model alone.",
    "model_misfit": "{}: the model does not explain the spectra of the channels. Update it.",
}


def _first(error: ValidationError) -> str:
    return str(error.errors(include_url=False)[0]["msg"]).removeprefix("Value error, ")


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _years(value: float | None) -> str:
    return "never" if value is None else f"{value:.3g}"


def _short(value: float) -> str:
    return f"{value:.7g}"
