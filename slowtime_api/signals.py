"""Signals: channels sampled together, from a file or from arrays."""

import dataclasses
import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float, Shaped

from slowtime_services.argument_checks import Positive, checked
from slowtime_services.declared import takes
from slowtime_services.files import (
    ReadingOptions,
    Record,
    RecordError,
    find_column,
    part_of,
    read_record,
)
from slowtime_services.files.channels.si_conversion import in_si
from slowtime_services.files.integrity import with_checked_values
from slowtime_services.files.record import looks_like_unit
from slowtime_services.files.units import unit_of

from .arguments import existing_file, names_of, real_samples, texts, with_arguments
from .deprecations import renamed
from .optional import optional
from .plotting import Axes, new_figure, save
from .results import html_table, same

SEGMENTS = 16
"""[1] Segments without overlap that a density is averaged over, where none is given. Source:
its relative standard deviation is then about 20 % with half overlap (Welch 1967)."""


SHORTEST_SEGMENT = 8
"""[1] Least number of samples of a segment: a Hann window of fewer has no main lobe between
zero and half the sampling rate (it is four lines wide)."""


class Signals:
    """Channels sampled together at one rate.

    `slowtime.read` makes them from a file. Arrays of your own become signals directly.

    Parameters
    ----------
    samples
        One row per instant, one column per channel [time, channel]; one series is one channel.
    rate_hz
        Sampling rate [Hz].
    channels
        Names of the channels. Where not given, those of the columns of a pandas object, else
        ``"ch0"``, ``"ch1"`` and so on.
    units
        Unit of each channel, or one for all. Motion is converted to SI.
    wide
        Whether there are more channels than samples on purpose.

    Raises
    ------
    ValueError
        If shapes do not fit, the rate is not positive, a value is not a finite real number, a
        unit is not known, or there are more channels than samples without `wide`.
    TypeError
        If the rate is no number, or names or units are no texts.

    Examples
    --------
    >>> import numpy as np
    >>> signals = Signals(np.zeros((500, 2)), rate_hz=100.0, channels=["x", "y"], units="m/s^2")
    >>> signals
    Signals: 2 channels (x, y), 500 samples at 100 Hz (5 s)
    >>> signals["x"].samples.shape
    (500, 1)
    >>> signals[1.0:3.0, "x"]
    Signals: 1 channel (x), 200 samples at 100 Hz (2 s)
    """

    MADE_BY = "slowtime.read(path) or slowtime.Signals(samples, rate_hz=...)"
    """What makes one, for messages."""

    @checked
    def __init__(
        self,
        samples: Any,
        rate_hz: Positive,
        channels: Sequence[str] | None = None,
        units: str | Sequence[str] = "",
        *,
        wide: bool = False,
    ) -> None:
        values = real_samples(samples)
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or len(values) < 2 or not values.shape[1]:
            raise ValueError(
                f"The samples have shape {np.shape(samples)}. Give one row per instant and one "
                "column per channel, and at least two rows."
            )
        if values.shape[1] > len(values) and not wide:
            raise ValueError(
                f"The samples have shape {np.shape(samples)}: {values.shape[1]} channels of "
                f"{len(values)} samples. Give one row per instant, as in samples.T; or "
                "wide=True, if there are more channels than samples."
            )
        if not np.isfinite(values).all():
            raise ValueError(
                f"{int((~np.isfinite(values)).sum())} samples are not finite. Fill them, or "
                "leave these rows out."
            )
        count = values.shape[1]
        names = names_of(samples) if channels is None else texts(channels, "channels")
        names = names or tuple(f"ch{i}" for i in range(count))
        given = (units,) * count if isinstance(units, str) else texts(units, "units")
        for what, found in (("channels", names), ("units", given)):
            if len(found) != count:
                raise ValueError(
                    f"{len(found)} {what} were given for {count} columns. Give one for each."
                )
        for unit in given:
            if unit and unit_of(unit) is None and not looks_like_unit(unit):
                raise ValueError(
                    f"The unit {unit!r} is not known. Give one such as 'm/s^2', 'g', 'mm/s', "
                    "'um', 'V', 'N', 'strain' or 'degC'; '' where it is not known."
                )
        if len(set(names)) != count:
            raise ValueError(f"Names of channels repeat: {', '.join(names)}.")
        self._record = in_si(
            Record(samples=values, rate_hz=rate_hz, channels=names, units=given), (), ()
        )

    @classmethod
    @checked
    def from_record(cls, record: Record) -> "Signals":
        """Wrap a record of the readers of files.

        Parameters
        ----------
        record
            Record of `slowtime_services.files`.

        Returns
        -------
        Signals that share its samples.
        """
        found = object.__new__(cls)
        found._record = record
        return found

    @property
    def record(self) -> Record:
        """The record, as the functions of `slowtime_services` take it."""
        return self._record

    @property
    def samples(self) -> Shaped[np.ndarray, "time channel"]:
        """Samples in the units of the channels [time, channel]."""
        return self._record.samples

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return self._record.rate_hz

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        return self._record.channels

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the channels; empty where they are not known."""
        return self._record.units

    @property
    def start(self) -> datetime.datetime | None:
        """Time of the first sample, in UTC; None where it is not known."""
        if self._record.start_ns is None:
            return None
        epoch = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
        return epoch + datetime.timedelta(microseconds=self._record.start_ns / 1000)

    @property
    def duration_s(self) -> float:
        """Duration, gaps included [s]."""
        return self._record.duration_s

    @property
    def times_s(self) -> Float[np.ndarray, " time"]:
        """Time of each sample since the first, gaps included [s]."""
        rows = np.arange(len(self._record.samples), dtype=float)
        for gap in self._record.gaps:
            rows[gap.row :] += gap.missing
        return rows / self.rate_hz

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of the reader: what it assumed about the file, and what is doubtful."""
        return (*self._record.assumptions, *self._record.notes)

    def __len__(self) -> int:
        return len(self._record.samples)

    def __array__(
        self, dtype: Any = None, copy: bool | None = None
    ) -> Shaped[np.ndarray, "time channel"]:
        """Give the samples to functions of NumPy, in the units of the channels."""
        return np.array(self.samples, dtype=dtype, copy=copy)

    __iter__ = None
    """Neither over samples nor over channels: `samples` and `channels` say which."""

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def __eq__(self, other: object) -> bool:
        """Whether samples, rate, channels, units, gaps and start are the same."""
        if not isinstance(other, Signals):
            return NotImplemented
        names = ("samples", "rate_hz", "channels", "units", "gaps", "start_ns")
        return all(
            same(getattr(self._record, name), getattr(other._record, name)) for name in names
        )

    __hash__ = None  # type: ignore[assignment]

    def __getitem__(self, chosen: Any) -> "Signals":
        """Select channels by name or by number from 0, a span of time by a slice, or both.

        ``signals["x"]`` and ``signals["x", "y"]`` are channels; ``signals[10:60]`` is the time
        from 10 s up to, and without, 60 s after the first sample; ``signals[10:60, "x"]`` is
        both. A slice counts in seconds, not in samples.

        Raises
        ------
        KeyError
            If no channel has that name, or none is named.
        TypeError
            If it is neither a name nor a slice of seconds.
        ValueError
            If the span holds fewer than two samples, or the slice has a step.
        """
        if isinstance(chosen, tuple) and chosen and isinstance(chosen[0], slice):
            return self._between(chosen[0])[list(chosen[1:])]
        if isinstance(chosen, slice):
            return self._between(chosen)
        given = [chosen] if isinstance(chosen, int | np.integer) else chosen
        names = texts(given, "channels")
        if not names:
            raise KeyError(f"No channel was named. There are: {', '.join(self.channels)}.")
        try:
            columns = [find_column(name, self.channels) for name in names]
        except RecordError as error:
            raise KeyError(str(error)) from None
        return Signals.from_record(
            dataclasses.replace(
                self._record,
                samples=self._record.samples[:, columns],
                channels=tuple(self.channels[i] for i in columns),
                units=tuple(self.units[i] for i in columns),
            )
        )

    def _between(self, span: slice) -> "Signals":
        """Cut out a slice of seconds."""
        if span.step is not None:
            raise ValueError(
                f"A slice with step {span.step!r} was given. Give two times in seconds, such "
                "as signals[10:60]."
            )
        first = 0.0 if span.start is None else span.start
        last = self.duration_s + 1.0 / self.rate_hz if span.stop is None else span.stop
        return self.between(first, last)

    @checked
    def between(self, first_s: float, last_s: float) -> "Signals":
        """Cut out a span of time.

        Parameters
        ----------
        first_s, last_s
            Beginning and end, since the first sample [s].

        Returns
        -------
        Samples from `first_s` up to, and without, `last_s`.

        Raises
        ------
        ValueError
            If the span holds fewer than two samples.
        """
        first, last = first_s, last_s
        if not first < last:
            raise ValueError(
                f"The span from {first:g} to {last:g} s was given. Give a beginning and a "
                f"later end between 0 and {self.duration_s:g} s."
            )
        try:
            return Signals.from_record(part_of(self._record, first, last, name="The record"))
        except RecordError as error:
            raise ValueError(
                f"The span from {first:g} to {last:g} s holds fewer than two samples. The "
                f"record has {self.duration_s:g} s at {self.rate_hz:g} Hz."
            ) from error

    @checked
    def psd(
        self, segment_s: Positive | None = None
    ) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "frequency channel"]]:
        """Estimate one-sided power spectral densities (Welch's method, Hann window).

        Parameters
        ----------
        segment_s
            Length of a segment [s]; a sixteenth of the record where not given.

        Returns
        -------
        Frequencies [Hz], and densities in squared units per hertz.

        Raises
        ------
        ValueError
            If a segment is longer than the record or has fewer than 8 samples.
        """
        if len(self) < SHORTEST_SEGMENT:
            raise ValueError(
                f"The signals have {len(self)} samples. A density needs {SHORTEST_SEGMENT}."
            )
        if segment_s is None:
            count = max(len(self) // SEGMENTS, SHORTEST_SEGMENT)
        else:
            length = segment_s * self.rate_hz
            if not SHORTEST_SEGMENT - 0.5 < length < len(self) + 0.5:
                raise ValueError(
                    f"A segment of {segment_s:g} s was given. Give between "
                    f"{SHORTEST_SEGMENT / self.rate_hz:g} and {len(self) / self.rate_hz:g} s."
                )
            count = min(max(round(length), SHORTEST_SEGMENT), len(self))
        frequency, density = scipy.signal.welch(
            np.asarray(self.samples, dtype=float), self.rate_hz, nperseg=count, axis=0
        )
        return frequency, density

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw the channels over time, and their densities.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes: over time, and over frequency.
        """
        over_time, over_frequency = axes = new_figure(2)
        frequency, density = self.psd()
        for column, name in enumerate(self.channels):
            unit = self.units[column]
            label = f"{name} [{unit}]" if unit else name
            over_time.plot(self.times_s, self.samples[:, column], label=label, linewidth=0.7)
            over_frequency.semilogy(frequency[1:], density[1:, column], label=name)
        over_time.set(xlabel="time [s]", ylabel=", ".join(dict.fromkeys(self.units)))
        over_time.legend(loc="upper right")
        over_frequency.set(xlabel="frequency [Hz]", ylabel="power spectral density [unit²/Hz]")
        return save(axes, path)

    to_dataframe = renamed("Signals.to_dataframe", "to_pandas")

    def to_pandas(self) -> Any:
        """Convert to a pandas DataFrame.

        Returns
        -------
        One column per channel, in its unit. The index is the time in UTC where the start is
        known, else the time since the start [s].
        """
        pandas = optional("pandas")
        if self._record.start_ns is None:
            index = pandas.Index(self.times_s, name="time_s")
        else:
            ns = self._record.start_ns + np.round(self.times_s * 1e9).astype(np.int64)
            index = pandas.DatetimeIndex(ns, tz="UTC", name="time")
        return pandas.DataFrame(self.samples, index=index, columns=list(self.channels))

    def to_xarray(self) -> Any:
        """Convert to an xarray Dataset.

        Returns
        -------
        One variable per channel over ``time_s`` [s], with its unit in ``attrs["units"]``.
        """
        xarray = optional("xarray")
        if "time_s" in self.channels:
            raise ValueError(
                "A channel is called 'time_s', as the axis is. Give the signals other names: "
                "Signals(signals.samples, signals.rate_hz, channels=[...])."
            )
        return xarray.Dataset(
            {
                name: ("time_s", self.samples[:, i], {"units": self.units[i]})
                for i, name in enumerate(self.channels)
            },
            coords={"time_s": self.times_s},
            attrs={"rate_hz": self.rate_hz},
        )

    @checked
    def save(self, path: str | Path) -> None:
        """Write the signals to a file with clock, names and units.

        Parameters
        ----------
        path
            ``.csv``, ``.parquet``, ``.uff`` or ``.unv``, or ``.mcap``: a recording, which
            `slowtime.read`, servers and Foxglove read.

        Raises
        ------
        ValueError
            If the path has another ending.
        ImportError
            If the package that a format needs is not installed.

        Examples
        --------
        >>> import tempfile
        >>> signals = Signals(np.arange(100.0), rate_hz=10.0, channels=["x"], units="m")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     signals.save(f"{folder}/x.csv")
        ...     read(f"{folder}/x.csv") == signals
        True
        """
        from slowtime_services import exports

        out = Path(path)
        writers = {
            ".csv": exports.write_csv, ".parquet": exports.write_parquet,
            ".uff": exports.write_universal, ".unv": exports.write_universal,
        }  # fmt: skip
        kind = out.suffix.lower()
        if kind == ".mcap":
            optional("mcap")
            from slowtime_services.exports.recordings import write_imported

            write_imported(out, self._record, site="local", asset="record")
        elif kind in writers:
            writers[kind](out, self._record)
        else:
            raise ValueError(
                f"path={out.name!r} was given. Allowed endings: {', '.join(writers)}, .mcap."
            )

    def _repr_html_(self) -> str:
        rows = [
            {
                "channel": name, "unit": unit, "rms": float(np.sqrt(np.mean(column**2))),
                "smallest": float(column.min()), "largest": float(column.max()),
            }
            for name, unit, column in zip(
                self.channels, self.units, np.asarray(self, dtype=float).T, strict=True
            )
        ]  # fmt: skip
        return html_table(repr(self), rows)

    def __repr__(self) -> str:
        names = ", ".join(self.channels[:6]) + (", ..." if len(self.channels) > 6 else "")
        count = len(self.channels)
        return (
            f"Signals: {count} {'channel' if count == 1 else 'channels'} ({names}), "
            f"{len(self)} samples at {self.rate_hz:g} Hz ({self.duration_s:g} s)"
        )


@takes(ReadingOptions)
def read(path: str | Path, options: ReadingOptions) -> Signals:
    """Read a file of measurements.

    Text of any delimiter, NumPy, MATLAB and MCAP recordings are read without further packages;
    Excel, TDMS, WAV, miniSEED, HDF5, Parquet, UFF and ROS 2 with ``slowtime[formats]``.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Signals in SI units where the unit of a channel is known. `Signals.notes` says what was
    assumed about the file.

    Raises
    ------
    ValueError
        If the file is no record, or can be read in several ways; the message says what to
        state.
    FileNotFoundError
        If there is no such file.
    """
    path = existing_file(path)
    if options.channels == ():
        raise ValueError("channels=[] was given. Name at least one, or leave it out for all.")
    try:
        if path.suffix.lower() == ".mcap":
            found = _read_recording(path, options)
            return found if options.channels is None else found[tuple(options.channels)]
        said = {one.name: getattr(options, one.name) for one in dataclasses.fields(options)}
        return Signals.from_record(read_record(path, **said))
    except RecordError as error:
        raise RecordError(with_arguments(str(error))) from error


def _read_recording(path: Path, options: ReadingOptions) -> Signals:
    optional("mcap")
    from slowtime_services.replay import record_or_foreign

    record = in_si(record_or_foreign(path), options.units, options.sensitivities)
    if options.rate_hz is not None:
        record = dataclasses.replace(record, rate_hz=options.rate_hz)
    return Signals.from_record(with_checked_values(record, path.name, options.repeated))
