"""Events of shaking: where they lie in a record, how strong they are, and what they excite."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float

from slowtime.signals.shaking import guideline_values, measures, onsets, response_spectra
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_services.argument_checks import Bounds, Positive, checked
from slowtime_services.files import bridged

DERIVATIVE = {"m": 0, "m/s": 1, "m/s^2": 2}
"""Units of motion → derivative of displacement."""

LEAST_PERIODS = 4
"""[periods] of the high-pass's corner that a record must hold: its answer to a step is then
below 1 % before the record ends."""

EDGE_SHARE = 0.02
"""[1] Share of a record at either end, in which a peak may belong to an event that is cut."""

Frequencies = Annotated[Sequence[float], Bounds(above=0)]
Place = guideline_values.Place


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FoundEvents(Result):
    """Events of a record, in order of time; each one is a slice of seconds.

    Parameters
    ----------
    spans_s
        First and last time of each event since the first sample [s].
    largest_ratio
        Largest ratio of short- to long-time power in each [1].
    notes
        What was assumed about the record.
    """

    spans_s: tuple[tuple[float, float], ...]
    largest_ratio: tuple[float, ...]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.spans_s)

    def __iter__(self) -> Iterator[slice]:
        return (slice(first, last) for first, last in self.spans_s)

    def __getitem__(self, k: int) -> slice:
        return slice(*self.spans_s[k])

    @property
    def heading(self) -> str:
        """How many were found, in a line."""
        return f"{len(self)} events"

    def rows(self) -> list[dict[str, Any]]:
        """Return each event.

        Returns
        -------
        One dictionary each: ``start_s``, ``end_s`` and ``largest_ratio``.
        """
        return [
            {"start_s": first, "end_s": last, "largest_ratio": ratio}
            for (first, last), ratio in zip(self.spans_s, self.largest_ratio, strict=True)
        ]


@checked
def find_events(
    signals: Signals,
    *,
    short_s: Positive = 0.5,
    long_s: Positive = 30.0,
    on: Positive = 6.0,
    off: Positive = 1.5,
    before_s: Annotated[float, Bounds(least=0)] = 5.0,
    after_s: Annotated[float, Bounds(least=0)] = 5.0,
) -> FoundEvents:
    """Find events in a long record by the ratio of short- to long-time power (STA/LTA).

    Parameters
    ----------
    signals
        Vibration. The largest ratio of all channels counts.
    short_s, long_s
        Time constants of the averages [s]. Within the first `long_s` no event is found.
    on, off
        Ratio from which an event begins, and below which it ends [1].
    before_s, after_s
        What is added before and after [s]; events that then touch are one.

    Returns
    -------
    The events; ``signals[events[0]]`` is the first one.

    Raises
    ------
    ValueError
        If the averages do not fit into the record, or `off` is above `on`.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(12_000)
    >>> noise[8_000:8_200] *= 20.0
    >>> events = find_events(Signals(noise, 100.0))
    >>> len(events), round(events[0].start)
    (1, 75)
    """
    record, said = bridged(signals.record)
    rate = record.rate_hz
    short, long = round(short_s * rate), round(long_s * rate)
    if not 1 <= short < long < len(record.samples):
        raise ValueError(
            f"short_s={short_s:g} and long_s={long_s:g} were given for "
            f"{signals.duration_s:g} s at {rate:g} Hz. Give a short_s of at least one sample, "
            "a longer long_s, and a record that is longer than both."
        )
    if off > on:
        raise ValueError(f"off={off:g} is above on={on:g}. Give an off of at most {on:g}.")
    samples = np.asarray(record.samples, dtype=float)
    ratio = onsets.sta_lta(samples - samples.mean(axis=0), short, long).max(axis=1)
    spans = onsets.merged(
        onsets.spans_above(ratio, on, off),
        round(before_s * rate),
        round(after_s * rate),
        len(ratio),
    )
    return FoundEvents(
        spans_s=tuple((span.first / rate, span.end / rate) for span in spans),
        largest_ratio=tuple(float(ratio[slice(*span)].max()) for span in spans),
        notes=(said,) if said else (),
    )


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ShakingMeasures(Result):
    """Measures of an event, of each channel of motion.

    Parameters
    ----------
    channels
        Names of the channels.
    corner_hz
        Of the high-pass before integration [Hz].
    measures
        Arrays with one value per channel: ``peak_acceleration`` [m/s²], ``peak_velocity``
        [m/s], ``peak_displacement`` [m], ``peak_time_s`` of the velocity [s],
        ``rms_velocity`` [m/s], ``arias_intensity`` [m/s], ``cumulative_absolute_velocity``
        [m/s], ``duration_s`` from 5 to 95 % of the Arias intensity [s], and the dominating
        ``frequency_hz`` [Hz].
    guideline
        Peak velocity up to which no damage is expected [m/s]; None where no building was given.
    notes
        What is doubtful about the record.
    """

    channels: tuple[str, ...]
    corner_hz: float
    measures: measures.EventMeasures
    guideline: Float[np.ndarray, " channel"] | None
    notes: tuple[str, ...]

    @property
    def heading(self) -> str:
        """What was measured, in a line."""
        said = f"Shaking of {len(self.channels)} channels above {self.corner_hz:.3g} Hz"
        return " ".join((said, *(f"({note})" for note in self.notes)))

    def rows(self) -> list[dict[str, Any]]:
        """Return the measures of each channel.

        Returns
        -------
        One dictionary each: ``channel`` and the measures, in SI units; with a building also
        ``guideline_velocity`` [m/s] and ``share_of_guideline`` [1].
        """
        return [self._row(c) for c in range(len(self.channels))]

    def _row(self, c: int) -> dict[str, Any]:
        row: dict[str, Any] = {"channel": self.channels[c]}
        row |= {name: float(of[c]) for name, of in self.measures._asdict().items()}
        if self.guideline is not None:
            row["guideline_velocity"] = float(self.guideline[c])
            row["share_of_guideline"] = row["peak_velocity"] / row["guideline_velocity"]
        return row


@checked
def shaking(
    signals: Signals,
    *,
    corner_hz: Positive | None = None,
    building: guideline_values.Building | None = None,
    place: Place = "foundation",
    duration: Literal["short", "lasting"] = "short",
) -> ShakingMeasures:
    """Measure an event: peaks, Arias intensity, duration, and DIN 4150-3 where asked.

    They describe the record. A sensor's noise adds to its peaks, and a high-pass takes from
    peak velocity and displacement what is slower than its corner.

    Parameters
    ----------
    signals
        Acceleration, velocity or displacement, with units. Other channels are left out.
    corner_hz
        Of a high-pass that shifts no phase [Hz]; where not given, four periods of it fill the
        record.
    building
        ``industrial``, ``residential`` or ``sensitive``: compare with DIN 4150-3 (2016).
    place
        Where was measured: at the ``foundation`` any direction, at the ``top_floor``
        horizontal, in a ``ceiling`` vertical.
    duration
        ``short`` as of blasts and piles, or ``lasting``, where fatigue or resonance may occur.

    Returns
    -------
    The measures of each channel.

    Raises
    ------
    ValueError
        If no channel has a unit of motion, the corner does not fit the record, or the standard
        gives no value.

    Examples
    --------
    >>> time = np.arange(2_000) / 200.0
    >>> blast = 0.8 * np.sin(2 * np.pi * 8 * time) * np.exp(-((time - 5) ** 2))
    >>> found = shaking(Signals(blast, 200.0, units="m/s^2"), building="residential")
    >>> row = found.rows()[0]
    >>> round(1e3 * row["peak_velocity"], 1), round(row["frequency_hz"], 1)
    (15.9, 8.0)
    >>> row["share_of_guideline"] > 1
    True
    """
    record, motion, corner = _motion(signals, corner_hz)
    found = measures.event_measures(motion, record.rate_hz)
    guideline = None
    if building is not None:
        guideline = guideline_values.guideline_value(
            found.frequency_hz, building, place, duration
        )
    return ShakingMeasures(
        channels=record.channels, corner_hz=corner, measures=found, guideline=guideline,
        notes=_doubts(found, record.duration_s),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ResponseSpectrum(Result):
    """Largest responses of oscillators to the motion of a base.

    Parameters
    ----------
    channels
        Names of the channels.
    damping_ratio
        Of the oscillators [1].
    frequency_hz
        Their natural frequencies [Hz].
    spectra
        ``displacement`` [m], ``pseudo_velocity`` [m/s], ``pseudo_acceleration`` and
        ``acceleration`` [m/s²], each [oscillator, channel].
    """

    channels: tuple[str, ...]
    damping_ratio: float
    frequency_hz: Float[np.ndarray, " oscillator"]
    spectra: response_spectra.ResponseSpectra

    @property
    def heading(self) -> str:
        """What was computed, in a line."""
        return (
            f"Response spectra of {len(self.channels)} channels at "
            f"{100 * self.damping_ratio:g} % damping"
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return each oscillator and channel.

        Returns
        -------
        One dictionary each: ``frequency_hz``, ``channel``, and the spectra in SI units.
        """
        return [
            {"frequency_hz": float(f), "channel": name}
            | {what: float(of[k, c]) for what, of in self.spectra._asdict().items()}
            for k, f in enumerate(self.frequency_hz)
            for c, name in enumerate(self.channels)
        ]

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the pseudo-acceleration against the period.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        axes = new_figure()[0]
        for c, name in enumerate(self.channels):
            axes.semilogx(
                1 / self.frequency_hz, self.spectra.pseudo_acceleration[:, c], label=name
            )
        axes.set(xlabel="period [s]", ylabel="pseudo-acceleration [m/s²]")
        axes.legend()
        return save(axes, path)


@checked
def response_spectrum(
    signals: Signals,
    frequencies_hz: Frequencies | None = None,
    *,
    damping_ratio: Annotated[float, Bounds(least=0, below=1)] = 0.05,
    corner_hz: Positive | None = None,
) -> ResponseSpectrum:
    """Compute response spectra: what single-degree-of-freedom oscillators make of a motion.

    Parameters
    ----------
    signals
        Motion of a base, with units: acceleration, velocity or displacement.
    frequencies_hz
        Natural frequencies of the oscillators [Hz]; where not given, 100 from the corner to
        half of the sampling rate, at equal ratios.
    damping_ratio
        Of the oscillators [1].
    corner_hz
        Of a high-pass that shifts no phase [Hz]; where not given, four periods of it fill the
        record. Oscillators below it see only part of the motion.

    Returns
    -------
    Relative displacement, pseudo-velocity, pseudo- and absolute acceleration of each.

    Raises
    ------
    ValueError
        If no channel has a unit of motion, or the corner does not fit the record.

    References
    ----------
    .. [1] N. C. Nigam and P. C. Jennings, "Calculation of response spectra from strong-motion
       earthquake records", BSSA 59 (1969) 909-922.

    Examples
    --------
    >>> time = np.arange(12_000) / 200.0
    >>> shake = Signals(np.sin(2 * np.pi * 2 * time), 200.0, units="m/s^2")
    >>> found = response_spectrum(shake, [2.0])
    >>> round(float(found.spectra.pseudo_acceleration[0, 0]), 1)  # 1 / (2 x 0.05)
    10.0
    """
    record, motion, corner = _motion(signals, corner_hz)
    if frequencies_hz is None:
        wanted = np.geomspace(corner, record.rate_hz / 2, 100)
    else:
        wanted = np.asarray(frequencies_hz, dtype=float)
    found = response_spectra.response_spectra(
        motion.acceleration, record.rate_hz, wanted, damping_ratio
    )
    return ResponseSpectrum(
        channels=record.channels, damping_ratio=damping_ratio, frequency_hz=wanted,
        spectra=found,
    )  # fmt: skip


def _motion(signals: Signals, corner_hz: float | None) -> tuple[Any, measures.Motion, float]:
    record, _ = bridged(signals.record)
    moving = [k for k, unit in enumerate(record.units) if unit in DERIVATIVE]
    if not moving:
        units = ", ".join(unit or "none" for unit in record.units)
        raise ValueError(
            f"No channel has a unit of motion; the units are: {units}. Give units such as "
            "'m/s^2', 'g' or 'mm/s' to Signals or to read."
        )
    lowest = LEAST_PERIODS / record.duration_s
    corner = lowest if corner_hz is None else corner_hz
    if not lowest <= corner * (1 + 1e-9) < record.rate_hz / 2:
        raise ValueError(
            f"corner_hz={corner:g} was given. Give from {lowest:g} Hz, of which "
            f"{LEAST_PERIODS} periods fill the record, up to below {record.rate_hz / 2:g} Hz."
        )
    kept = dataclasses.replace(
        record,
        samples=np.asarray(record.samples, dtype=float)[:, moving],
        channels=tuple(record.channels[k] for k in moving),
        units=tuple(record.units[k] for k in moving),
    )
    parts = [
        measures.motion_of(kept.samples[:, [k]], kept.rate_hz, corner, DERIVATIVE[unit])
        for k, unit in enumerate(kept.units)
    ]
    whole = (np.concatenate(columns, axis=1) for columns in zip(*parts, strict=True))
    return kept, measures.Motion(*whole), corner


def _doubts(found: measures.EventMeasures, duration_s: float) -> tuple[str, ...]:
    edge = EDGE_SHARE * duration_s
    times = found.peak_time_s
    if math.isfinite(edge) and ((times < edge) | (times > duration_s - edge)).any():
        return ("a peak lies at the edge of the record, which may cut the event",)
    return ()
