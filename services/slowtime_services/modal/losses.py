"""Samples that are not there: used, filled or cut at, and what their loss adds to errors."""

import dataclasses
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.estimates import Identified, Measured
from slowtime.identification.modes import Mode
from slowtime.identification.options import Gaps
from slowtime.identification.single_mode.excitation import energetic_share
from slowtime.identification.single_mode.machine_lines import ModesAndLines
from slowtime.signals.imputation import LEAST_SHARE, impute
from slowtime_services.files import Gap, Record, bridged

F = TypeVar("F", Identified, Mode)

STEADY_SHARE = 0.5
"""Share of the time with 90 % of the energy [1] from which a record counts as steady, so that
missing samples are drawn. Of decays it is less; there, they are predicted."""

BESIDE = 16
"""Samples on either side of a gap whose level is compared with the record's."""

FEWEST_TO_TELL = 8
"""Least number of gaps of which is told whether they come where the level is high."""

TOLD = 4.0
"""Excess of the mean rank of levels beside gaps that is told [standard deviations]."""

LOUD = "loss_at_high_level"
"""Flag of modes from a record whose losses come where its level is high."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Completed:
    """A record whose missing samples were dealt with.

    Parameters
    ----------
    record
        Record with the gaps that remain.
    note
        What was done; empty where nothing was missing.
    present
        Rows that were measured, where missing ones were drawn; else None.
    spread
        Mean conditional variance of what was drawn, relative to that of its channel [1].
    flags
        Words on what to mistrust in all modes.
    """

    record: Record
    note: str = ""
    present: np.ndarray[Any, np.dtype[np.bool_]] | None = None
    spread: float = 0.0
    flags: tuple[str, ...] = ()

    def inflation(self, first: int, last: int) -> float:
        """Factor of standard deviations of what was identified in some rows [1]."""
        if self.present is None:
            return 1.0
        return inflation_of(float(np.mean(~self.present[first:last])), self.spread)


def inflation_of(missing: float, spread: float) -> float:
    """Return the factor of standard deviations by which the loss of samples counts [1].

    A share p of the samples is missing, and a share e of their variance does not follow
    from the others. What was measured is 1 - p of the information; a single draw adds the
    error of the mean of p e of the samples [1]_.

    Parameters
    ----------
    missing
        p [1].
    spread
        e [1].

    References
    ----------
    .. [1] D. B. Rubin, "Multiple Imputation for Nonresponse in Surveys" (1987), section 3.
    """
    return float(np.sqrt((1.0 + missing * spread) / max(1.0 - missing, 1e-9)))


def completed(record: Record, gaps: Gaps) -> Completed:
    """Deal with the missing samples of a record.

    Parameters
    ----------
    record
        Record with gaps.
    gaps
        ``"use"``: all samples there are; those that are missing are drawn given the others.
        ``"fill"``: short gaps are filled by linear prediction, long ones cut the record.
        ``"split"``: every gap cuts the record.

    Returns
    -------
    Record, and what to say of it.
    """
    if not record.gaps or gaps == "split":
        return Completed(record)
    if gaps == "fill":
        return Completed(*bridged(record))
    missing = sum(gap.missing for gap in record.gaps)
    total = len(record.samples) + missing
    samples = np.asarray(record.samples, dtype=float)
    why = ""
    if missing > (1.0 - LEAST_SHARE) * total:
        why = f"more than {100 * (1.0 - LEAST_SHARE):.0f} % of the record"
    elif not np.isfinite(samples).all():
        why = "beside values that are not finite"
    else:
        try:
            return _drawn(record, samples, missing, total)
        except ValueError:
            why = "too many for so short a record"
    said = f"{missing} missing samples could not be taken into account: they are {why}."
    return Completed(record, said)


def _drawn(record: Record, samples: np.ndarray, missing: int, total: int) -> Completed:
    present = np.ones(total, dtype=bool)
    late = 0
    for gap in record.gaps:
        present[gap.row + late : gap.row + late + gap.missing] = False
        late += gap.missing
    steady = energetic_share(samples - samples.mean(axis=0)) >= STEADY_SHARE
    spread = np.zeros((total, samples.shape[1]))
    spread[present] = samples
    # The same record gives the same modes: draws have a seed of their own.
    made = impute(spread, present, rng=np.random.default_rng(0) if steady else None)
    flags: tuple[str, ...] = (LOUD,) if _is_lost_where_loud(samples, record.gaps) else ()
    runs = "1 gap" if len(record.gaps) == 1 else f"{len(record.gaps)} gaps"
    share, way = f"{100 * missing / total:.1f} %", "drawn" if steady else "predicted"
    said = (
        f"{missing} samples are missing in {runs} ({share}). All others are used: the missing "
        f"ones were {way} from what the others say of them, and standard deviations are larger "
        "by the loss. --gaps split uses the longest part alone."
    )
    if flags:
        said += (
            " Samples are missing where the level is high, as after an overflow, which biases "
            "damping."
        )
    aux = {k: v for k, v in record.aux.items() if np.shape(v)[:1] != (len(samples),)}
    whole = dataclasses.replace(record, samples=made.samples, gaps=(), aux=aux)
    return Completed(whole, said, present, made.spread, flags)


def _is_lost_where_loud(samples: np.ndarray, gaps: Iterable[Gap]) -> bool:
    """Whether the level beside gaps is high among the levels of the record.

    Ranks of the level beside n gaps are uniform, of mean 1/2 and deviation 1/sqrt(12 n), where
    samples are lost without regard to it.
    """
    scale = np.maximum(samples.std(axis=0), np.finfo(float).tiny)
    power = np.sum(((samples - samples.mean(axis=0)) / scale) ** 2, axis=1)
    level = np.convolve(power, np.ones(2 * BESIDE), "same")
    rows = np.array([gap.row for gap in gaps])
    rows = rows[(rows >= BESIDE) & (rows < len(level) - BESIDE)]
    if len(rows) < FEWEST_TO_TELL:
        return False
    ranks = np.searchsorted(np.sort(level), level[rows]) / len(level)
    return bool((ranks.mean() - 0.5) * np.sqrt(12 * len(ranks)) > TOLD)


def widened(
    told: ModesAndLines, whole: ModalResult | None, factor: float, flags: tuple[str, ...] = ()
) -> tuple[ModesAndLines, ModalResult | None]:
    """Put the loss of information into standard deviations.

    Parameters
    ----------
    told, whole
        As `identify_record` gives them.
    factor
        Of all standard deviations [1].
    flags
        Words on what to mistrust in all modes.

    Returns
    -------
    The same, with larger standard deviations.
    """
    told = dataclasses.replace(
        told,
        modes=tuple(wider(mode, factor, flags) for mode in told.modes),
        lines=tuple(wider(line, factor, flags) for line in told.lines),
    )
    if whole is not None:
        whole = dataclasses.replace(
            whole, modes=tuple(wider(mode, factor, flags) for mode in whole.modes)
        )
    return told, whole


def wider(mode: F, factor: float, flags: tuple[str, ...] = ()) -> F:
    """Return a mode with larger standard deviations, and flags."""
    new: tuple[str, ...] = tuple(flag for flag in flags if flag not in mode.flags)
    changes: dict[str, Any] = {
        "frequency_hz": _times(mode.frequency_hz, factor),
        "damping_ratio": _times(mode.damping_ratio, factor),
        "flags": (*mode.flags, *new),
    }
    if isinstance(mode, Mode):
        changes["shape_sd"] = mode.shape_sd * factor
    return dataclasses.replace(mode, **changes)


def _times(measured: Measured, factor: float) -> Measured:
    return dataclasses.replace(measured, sd=measured.sd * factor)
