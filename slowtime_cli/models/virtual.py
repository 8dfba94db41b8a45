"""The verb `virtual`: estimates displacements, drifts, forces and moments of a model."""

import contextlib
import csv
import sys
from pathlib import Path
from typing import Any

from slowtime_api.models import Model
from slowtime_api.responses.virtual_quantities import VirtualQuantity
from slowtime_api.responses.virtual_quantities import virtual as estimate
from slowtime_api.signals import Signals
from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import note, show
from slowtime_services.files import Record
from slowtime_services.matrices import read_any_description


@with_record
def virtual(model: Path, record: Record, path: Path, **given: Any) -> None:
    """Estimate a quantity, and write or summarise it."""
    out: Path | None = given.pop("out")
    found = asked_of(model, record, given)
    if out is not None:
        aside = str(out) == "-"
        with contextlib.ExitStack() as stack:
            target = sys.stdout if aside else stack.enter_context(out.open("w", newline=""))
            writer = csv.writer(target)
            writer.writerow(["time_s", f"{found.name}_{found.unit}", "sd", "settled"])
            rows = zip(found.values, found.sd, found.settled, strict=True)
            for i, row in enumerate(rows):
                writer.writerow(
                    [f"{i / record.rate_hz:.6f}", *map(_short, row[:2]), int(row[2])]
                )
        if aside:
            return
    (plain,) = found.rows()
    show(
        f"{found.name} from {len(found.channels)} channels",
        (
            "quantity",
            f"rms [{found.unit}]",
            "largest",
            "mean sd",
            "above [Hz]",
            "length [s]",
        ),
        [
            [
                found.name,
                *(f"{plain[k]:.4g}" for k in ("rms", "largest", "sd", "lowest_hz", "seconds")),
            ]
        ],
        plain=[plain],
    )
    for said in found.notes:
        note(said)


def asked_of(model: Path, record: Record, given: dict[str, Any]) -> VirtualQuantity:
    """Take the quantity out of the flags, and estimate it from the accelerations of a record.

    Raises
    ------
    ValueError
        Where the flags do not make one quantity of a model, or the record is too short.
    """
    names = (
        "quantity", "node", "between", "element", "end", "factor", "factor_unit", "factor_sd",
        "lowest_hz", "moving_base",
    )  # fmt: skip
    flags = {name: given.pop(name) for name in names}
    flags["between"] = flags["between"] or None
    described = Model(read_any_description(model, note=note))
    return estimate(described, Signals.from_record(record), **flags)


def _short(value: float) -> str:
    return f"{value:.7g}"
