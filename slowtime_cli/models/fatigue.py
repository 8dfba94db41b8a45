"""The verb `fatigue`: rainflow cycles of a stress, and the fatigue damage that they sum to."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime_api.responses.fatigue_damage import FatigueDamage, fatigue_damage
from slowtime_api.responses.virtual_quantities import VirtualQuantity
from slowtime_api.signals import Signals
from slowtime_cli.models.virtual import asked_of
from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import as_exact_as, note, show
from slowtime_services.files import Record

NORMAL_95 = 1.96
"""Half width of a 95 % interval of the normal distribution [standard deviations]."""
CURVE = (
    "detail_category", "constant", "slope", "knee", "lower_slope", "cut_off", "log10_sd",
    "mean_stress", "strength", "constant_mean",
)  # fmt: skip


@with_record
def fatigue(
    record: Record, path: Path, model: Path | None, channel: str | None, **given: Any
) -> None:
    """Count cycles of a stress, and print the damage."""
    as_json = given.pop("as_json")
    curve = {name: given.pop(name) for name in CURVE}
    stress: Signals | VirtualQuantity = Signals.from_record(record)
    if model is not None:
        stress, channel = asked_of(model, record, given), None
        for said in stress.notes:
            note(said)
    result = _document(fatigue_damage(stress, channel=channel, **curve))
    if as_json:
        click.echo(json.dumps(result, indent=1, allow_nan=False))
        return
    _show(result)


def _document(found: FatigueDamage) -> dict[str, Any]:
    """Return the damage as JSON holds it."""
    years = found.years_to_failure.items()
    return {
        "point": found.point,
        "unit": found.unit,
        "seconds": found.seconds,
        "cycles": found.cycles,
        "largest_range": found.largest_range,
        "equivalent_range": found.equivalent_range,
        "damage": {
            "median": found.damage, "lo": found.damage_lo, "hi": found.damage_hi,
            "sd": found.damage_sd,
        },
        "damage_per_year": found.damage_per_year,
        "years_to_failure": {f"{100 * share:g} %": _finite(value) for share, value in years},
        "spectral_damage_per_year": found.spectral_damage_per_year,
        "histogram": {
            "ranges": found.ranges.tolist(), "cycles": found.range_cycles.tolist(),
        },
        "skipped": found.skipped,
        "reasons": list(found.reasons),
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


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _years(value: float | None) -> str:
    return "never" if value is None else f"{value:.2g}"
