"""Screening of records for missing, stuck, constant and clipped samples.

No physics is needed: a value that repeats more often than chance allows, or is not finite, is a
fault of the channel whatever the structure does.
"""

import dataclasses
import math
import types
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Float

from slowtime.discrepancy.records import Trial
from slowtime.signals.value_checks import clipped_samples, stuck_samples

Fault = Literal["missing", "constant", "stuck", "zero", "clipped"]

CLIPPED_NOISE_SDS = 4.0
"""[standard deviations of the channel's noise] Within which of a stop noise decides whether
a sample is clipped. Source: four sigma holds all but 6e-5 of normal noise."""
MAX_CLIPPED_MARGIN = 0.1
"""[share of the channel's range] That this margin may be at most: a fast signal curves more
than its noise does. Source: docs/what_decides.md: half and double change no answer."""
NORMAL_MAD = 0.6745
"""[standard deviations] Median of the modulus of a normal variable. Source: 0.75 quantile of
the normal distribution."""

LEVEL_RESOLUTION = float(np.finfo(np.float32).eps)
"""[1] Relative resolution of a level. Source: single precision; recorders keep no more."""

SENTENCES = {
    "missing": "has no finite values in",
    "constant": "never changes in",
    "stuck": "is stuck in",
    "zero": "is exactly zero in",
    "clipped": "is clipped in",
}


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A fault of one channel.

    Parameters
    ----------
    spans_s
        Campaign times of begin and end of each span [s].
    share
        Share of the channel's samples that are concerned.
    level, level_sd
        Modulus of these samples in the channel's unit, and its standard deviation; 0 where
        they are not finite.
    instant_sd
        Standard deviation of an end of a span, which lies between two samples [s].
    """

    fault: Fault
    channel: str
    spans_s: tuple[tuple[float, float], ...]
    share: float
    level: float = 0.0
    level_sd: float = 0.0
    instant_sd: float = 0.0

    @property
    def sentence(self) -> str:
        """The fault in words."""
        spans = f"{len(self.spans_s)} span" + "s" * (len(self.spans_s) != 1)
        return (
            f"Channel {self.channel!r} {SENTENCES[self.fault]} {spans}, {self.share:.1%} of it."
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScreenedTrial:
    """A record whose `use` leaves out what the findings name."""

    trial: Trial
    findings: tuple[Finding, ...]


def screen_records(trials: Sequence[Trial], channels: Sequence[str]) -> list[ScreenedTrial]:
    """Screen the records of a campaign; a stop of a channel in one record holds for all."""
    found = [screen(trial, channels) for trial in trials]
    stops: dict[str, set[float]] = {}
    for one in found:
        for finding in one.findings:
            if finding.fault == "clipped":
                stops.setdefault(finding.channel, set()).add(finding.level)
    return [
        screen(trial, channels, stops)
        if any(f.fault == "stuck" and f.channel in stops for f in one.findings)
        else one
        for trial, one in zip(trials, found, strict=True)
    ]


def screen(
    trial: Trial,
    channels: Sequence[str] = (),
    stops: Mapping[str, Collection[float]] = types.MappingProxyType({}),
) -> ScreenedTrial:
    """Mask what is missing, stuck or clipped.

    Parameters
    ----------
    stops
        Moduli at which channels are known to be clipped, in their units.

    Returns
    -------
    The record with these samples masked, and the findings.

    Examples
    --------
    >>> wave = np.sin(0.3 * np.arange(400.0))[:, None]
    >>> wave[100:150] = 0.25
    >>> trial = Trial(inputs=np.zeros((400, 0)), outputs=wave, rate_hz=10.0)
    >>> screened = screen(trial, ["x"])
    >>> screened.findings[0].sentence
    "Channel 'x' is stuck in 1 span, 12.5% of it."
    >>> int(screened.trial.used.sum())
    350
    """
    names = channels or [str(i + 1) for i in range(trial.outputs.shape[1])]
    use = trial.used.copy()
    findings: list[Finding] = []
    still = _initial_rest(trial)
    for i, (name, samples) in enumerate(zip(names, trial.outputs.T, strict=True)):
        if not use[:, i].any() and np.isfinite(samples).all():
            continue  # not measured in this record: no fault of the channel
        for fault, bad in _detect_faults(samples, still, stops.get(name, ())):
            findings.append(_describe_fault(trial, fault, name, bad, samples))
            use[:, i] &= ~(_clipped_neighbourhood(bad, samples) if fault == "clipped" else bad)
    return ScreenedTrial(trial=dataclasses.replace(trial, use=use), findings=tuple(findings))


def _detect_faults(
    samples: Float[np.ndarray, " time"],
    still: Bool[np.ndarray, " time"],
    stops: Collection[float],
) -> Iterable[tuple[Fault, Bool[np.ndarray, " time"]]]:
    missing = ~np.isfinite(samples)
    if missing.any():
        yield "missing", missing
    there = samples[~missing]
    if there.size and np.ptp(there) == 0:
        yield "constant", ~missing
        return
    clipped = clipped_samples(samples, there, stops)
    stuck = stuck_samples(samples) & ~still & ~clipped
    for fault, which in (("zero", samples == 0), ("stuck", samples != 0)):
        if (stuck & which).any():
            yield "zero" if fault == "zero" else "stuck", stuck & which
    if clipped.any():
        yield "clipped", clipped


def _initial_rest(trial: Trial) -> Bool[np.ndarray, " time"]:
    """Mask of the first samples before any input changes: rest, not a fault."""
    moved = (trial.inputs != trial.inputs[0]).any(axis=1)
    if trial.inputs.shape[1] == 0:
        return np.zeros(len(moved), dtype=bool)
    first = int(np.argmax(moved)) if moved.any() else 0
    return np.arange(len(moved)) < first + 1


def _clipped_neighbourhood(
    clipped: Bool[np.ndarray, " time"], samples: Float[np.ndarray, " time"]
) -> Bool[np.ndarray, " time"]:
    """Mask clipped samples, and adjacent ones within the noise of the stop."""
    bend = np.diff(samples, 3)
    bend = np.abs(bend[np.isfinite(bend)])
    noise = np.median(bend) / (NORMAL_MAD * math.sqrt(20.0)) if len(bend) else 0.0
    # Where a signal turns within a few samples, it bends more than its noise does.
    # Noise decides which samples near a stop were clipped, and those that are left are biased
    # towards zero.
    reach = min(
        CLIPPED_NOISE_SDS * noise, MAX_CLIPPED_MARGIN * np.ptp(samples[np.isfinite(samples)])
    )
    found = np.zeros(len(samples), dtype=bool)
    for level in np.unique(samples[clipped]):
        near = np.abs(samples - level) <= reach
        at = clipped & (samples == level)
        found |= scipy.ndimage.binary_propagation(at, mask=at | near)
    return np.asarray(scipy.ndimage.binary_dilation(found))


def _describe_fault(
    trial: Trial,
    fault: Fault,
    channel: str,
    bad: Bool[np.ndarray, " time"],
    samples: Float[np.ndarray, " time"],
) -> Finding:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(int)))
    spans = tuple(
        (
            float(trial.start_s + first / trial.rate_hz),
            float(trial.start_s + last / trial.rate_hz),
        )
        for first, last in edges.reshape(-1, 2)
    )
    column = np.abs(samples[bad])
    told = bool(np.isfinite(column).all())
    level = float(np.median(column)) if told else 0.0
    return Finding(
        fault=fault,
        channel=channel,
        spans_s=spans,
        share=float(bad.mean()),
        level=level,
        level_sd=float(np.hypot(column.std(), LEVEL_RESOLUTION * level)) if told else 0.0,
        instant_sd=1 / (trial.rate_hz * math.sqrt(3)),
    )
