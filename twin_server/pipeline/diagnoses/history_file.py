"""Writes the kept features of a twin as the input file of a diagnosis in slow time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_schemas.quantities import RENEWALS
from twin_server.diagnose import HISTORY
from twin_server.diagnose.history_diagnosis import COVARIATE
from twin_server.history import states as st
from twin_server.persist import Store
from twin_server.pipeline.ingestion.rows import decoded
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError

FEWEST = 60
"""Epochs from which the twin learns what a covariate does, at least."""
SPANNED = 0.95
"""Share of a covariate's range that these must have seen."""

_UNJUDGED = st.NO_MODE


def history_of(
    store: Store, twin_id: str, registration: Registration, folder: Path, most: int
) -> dict[str, Any]:
    """Write the history file of a diagnosis; return its description for the task."""
    found = store.history(twin_id, limit=most, newest=True)
    states = found.states
    if registration.changes == "stiffness" and registration.covariates is None:
        quantity, name, scale = "stiffness_change", "stiffness_change", 1.0
    else:
        quantity, name = "frequency_ratio", "frequency_hz"
        scale = float(np.nanmedian(states[name][:, 0])) if len(states) else 1.0
    usable = np.isfinite(states[name][:, 0]) & ((states["reasons"] & _UNJUDGED) == 0)
    if usable.sum() < FEWEST:
        raise ProblemError(
            409,
            "too-few-epochs",
            f"{twin_id} has {int(usable.sum())} epochs with an estimate. A diagnosis in slow "
            f"time needs {FEWEST}. Wait for more.",
        )
    value, sd = states[name][:, 0] / scale, states[name][:, 1] / scale
    covariates = _covariates(store, twin_id, found.number, states["sequence"].tolist())
    units = [unit for _, unit in found.boots.values()]
    np.savez(
        folder / HISTORY,
        slow_time=states["slow_time"][usable],
        value=value[usable] - (1.0 if quantity == "frequency_ratio" else 0.0),
        sd=sd[usable],
        **{COVARIATE + key: column[usable] for key, column in covariates.items()},
    )
    return {"quantity": quantity, "slow_time_unit": units[-1] if units else "s"}


def covariates_of(store: Store, twin_id: str, names: Sequence[str], most: int) -> int:
    """Return how many first epochs cover nearly the whole range of the covariates."""
    found = store.history(twin_id, limit=most)
    columns = _covariates(store, twin_id, found.number, found.states["sequence"].tolist())
    needed = FEWEST
    for name in names:
        values = columns.get(name, np.empty(0))
        known = np.flatnonzero(np.isfinite(values))
        if not known.size:
            continue
        low = np.minimum.accumulate(values[known])
        high = np.maximum.accumulate(values[known])
        seen = (high - low) >= SPANNED * (high[-1] - low[-1])
        needed = max(needed, int(np.argmax(seen)) + 1)
    return needed


def reference_of(
    store: Store, twin_id: str, names: Sequence[str], most: int
) -> dict[str, float]:
    """Find where the nominal model holds: where a line through the history is at no change.

    Several covariates share the shift as their lines say; none leaves the range it was seen in.
    """
    found = store.history(twin_id, limit=most, newest=True)
    columns = _covariates(store, twin_id, found.number, found.states["sequence"].tolist())
    read = np.column_stack([columns[name] for name in names])
    change = found.states["frequency_hz"][:, 0]
    change = change / np.nanmedian(change) - 1.0
    for name in ("stiffness_change", "mass_change"):
        own = found.states[name][:, 0]
        if np.nanstd(own) > 0.0:
            change = own
            break
    used = np.isfinite(read).all(axis=1) & np.isfinite(change)
    read, change = read[used], change[used]
    centre = read.mean(axis=0)
    slope, *_ = np.linalg.lstsq(read - centre, change - change.mean(), rcond=None)
    steep = float(slope @ slope)
    shift = -change.mean() * slope / steep if steep > 0.0 else np.zeros(len(names))
    held = np.clip(centre + shift, read.min(axis=0), read.max(axis=0))
    return dict(zip(names, held.tolist(), strict=True))


def _covariates(
    store: Store, twin_id: str, numbers: Sequence[int], sequences: Sequence[int]
) -> dict[str, np.ndarray]:
    """Read the covariates of states; NaN where missing."""
    rows = {key: row for row, key in enumerate(zip(numbers, sequences, strict=True))}
    columns: dict[str, np.ndarray] = {}
    if not rows:
        return columns
    first = min(rows)
    after = (first[0], first[1] - 1)
    while messages := store.messages(twin_id, after, 2_000):
        for message in messages:
            row = rows.get((message.number, message.sequence))
            if row is None:
                continue
            for name, value in decoded(message.message).covariates.items():
                if name == RENEWALS:  # tells of an event, and explains no change
                    continue
                columns.setdefault(name, np.full(len(rows), np.nan))[row] = value
        after = (messages[-1].number, messages[-1].sequence)
        if after >= max(rows):
            break
    return columns
