"""The verb `fatigue`: rainflow cycles of a stress, and the fatigue damage that they sum to."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np
from pydantic import ValidationError

from slowtime.fatigue.counter import Count
from slowtime.fatigue.miner import TimeToFailure, equivalent_range
from slowtime.fatigue.spectral import METHODS, SpectralMoments, damage_rate
from slowtime.signals.spectra import welch
from slowtime_cli.models.virtual import (
    asked_quantity,
    estimate_quantity,
    first_message,
    note_limits,
)
from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import as_exact_as, note, show
from slowtime_services.files import Record, find_column
from slowtime_services.virtual_sensors.settings import PointCurve

YEAR_S = 365.25 * 86_400
"""Julian year [s]."""
NORMAL_95 = 1.96
"""Half width of a 95 % interval of the normal distribution [standard deviations]."""
SPECTRAL_WINDOWS = 16
"""Windows of a record whose spectra are averaged for spectral methods [1]."""


@with_record
def fatigue(
    record: Record, path: Path, model: Path | None, channel: str | None, **given: Any
) -> None:
    """Count cycles of a stress, and print the damage."""
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
        raise click.UsageError(first_message(error)) from None
    missing = wrong = 0.0
    reasons: tuple[str, ...] = ()
    if model is not None:
        asked = asked_quantity(given)
        found = estimate_quantity(model, record, asked, given)
        stress, name, unit = found["values"][found["settled"]], asked.name, found["unit"]
        missing, wrong, reasons = found["missing"], found["wrong"], found["reasons"]
        note_limits(found)
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
    moments = SpectralMoments.of(spectrum.frequency_hz, density) if density.any() else None
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
    sd = (damage["hi"] - damage["lo"]) / (2 * NORMAL_95)
    yearly = result["damage_per_year"]
    relative = sd / damage["median"] if damage["median"] else 0.0
    show(
        f"{result['point']}: {result['cycles']:.0f} cycles in {result['seconds']:.0f} s",
        ("what", "value", "unit"),
        [
            ["largest range", f"{result['largest_range']:.4g}", unit],
            ["equivalent range", f"{result['equivalent_range']:.4g}", unit],
            ["Miner's sum, median", as_exact_as(sd, damage["median"]), "1"],
            ["  95 % interval", f"{damage['lo']:.2g} to {damage['hi']:.2g}", "1"],
            ["damage at this rate", as_exact_as(relative * yearly, yearly), "1/year"],
            ["time to failure, 5 %", _years(years["5 %"]), "years"],
            ["time to failure, 50 %", _years(years["50 %"]), "years"],
            ["time to failure, 95 %", _years(years["95 %"]), "years"],
            *(
                [f"spectral: {method}", as_exact_as(relative * value, value), "1/year"]
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
            "Name the one of stress by --channels."
        )
    column = 0 if channel is None else find_column(channel, record.channels)
    unit = record.units[column] or "1"
    return record.samples[:, column], record.channels[column], unit


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _years(value: float | None) -> str:
    return "never" if value is None else f"{value:.2g}"
