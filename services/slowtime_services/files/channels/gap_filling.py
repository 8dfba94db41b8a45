"""Estimation of the samples in short gaps, where the spectrum allows it."""

import dataclasses
import itertools
import math

import numpy as np

from slowtime.signals.gap_filling import bridge
from slowtime_services.files.record import Gap, Record

MAX_GAP_SAMPLES = 10
"""Longest gap that is filled [samples]. Packets of wireless and serial sensors hold some."""
MAX_MISSING_SHARE = 0.1
"""Share of samples of a record that may be missing [1]."""
MAX_ADDED_NOISE = 0.02
"""Error variance that filling may add, over the variance of the record [1]: that of a sensor
with 17 dB between signal and noise. Losing 2 in 60 samples of white noise, which tell nothing,
adds 0.033."""
MARK = "bridged"
"""Flag of what was found in a record whose losses were bridged."""


def bridged(record: Record) -> tuple[Record, str]:
    """Estimate the samples of short losses; return a note, or the reason why not.

    Returns
    -------
    The record, with the losses that stay as its gaps, and a sentence; the record as given and
    an empty sentence where no loss is short.
    """
    short = [gap for gap in record.gaps if gap.missing <= MAX_GAP_SAMPLES]
    missing = sum(gap.missing for gap in short)
    total = len(record.samples) + missing
    samples = np.asarray(record.samples, dtype=float)
    if not short or not np.isfinite(samples).all():
        return record, ""
    if missing > MAX_MISSING_SHARE * total:
        return record, _not_bridged(missing, total, "too many")
    present = np.ones(total, dtype=bool)
    long_gaps, late = [], 0
    for gap in record.gaps:
        if gap.missing <= MAX_GAP_SAMPLES:
            present[gap.row + late : gap.row + late + gap.missing] = False
            late += gap.missing
        else:
            long_gaps.append(Gap(gap.row + late, gap.missing))
    spread = np.zeros((total, samples.shape[1]))
    spread[present] = samples
    error = _fill(spread, present, [gap.row for gap in long_gaps])
    if error is None or error * missing > MAX_ADDED_NOISE * total:
        return record, _not_bridged(missing, total, "too far from what their neighbours tell")
    level = f"{10 * math.log10(max(error, 1e-12)):.0f} dB"
    said = (
        f"{missing} samples in {len(short)} short losses ({100 * missing / total:.1f} %) were "
        f"estimated from their neighbours, with an expected error of {level} of the signal."
    )
    aux = {k: v for k, v in record.aux.items() if np.shape(v)[:1] != (len(samples),)}
    return (
        dataclasses.replace(record, samples=spread, gaps=tuple(long_gaps), aux=aux),
        said,
    )


def _fill(
    spread: "np.ndarray[tuple[int, int], np.dtype[np.float64]]",
    present: "np.ndarray[tuple[int], np.dtype[np.bool_]]",
    cuts: list[int],
) -> float | None:
    """Fill each part between long gaps; the mean error, or None where one cannot be filled."""
    errors, weights = [], []
    for first, last in itertools.pairwise([0, *cuts, len(present)]):
        part = present[first:last]
        if part.all():
            continue
        try:
            found = bridge(spread[first:last], part)
        except ValueError:
            return None
        spread[first:last] = found.samples
        errors.append(found.error)
        weights.append(np.count_nonzero(~part))
    return float(np.average(errors, weights=weights)) if errors else 0.0


def _not_bridged(missing: int, total: int, why: str) -> str:
    return (
        f"{missing} samples of short losses ({100 * missing / total:.1f} %) were not bridged: "
        f"they are {why}."
    )
