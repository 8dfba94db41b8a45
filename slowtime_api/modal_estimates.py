"""Modes of vibration identified from signals."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.estimates import Measured
from slowtime.identification.mode_shapes.criteria import mac_matrix
from slowtime.identification.options import IdentifyOptions, Selection
from slowtime.identification.single_mode.machine_lines import LINE
from slowtime_schemas.files.modes import ModesFile
from slowtime_services.argument_checks import checked
from slowtime_services.declared import takes
from slowtime_services.files import accelerations, mixed_units
from slowtime_services.modal import read_geometry, selection_text, write_modes
from slowtime_services.modal.entries import mode_entry
from slowtime_services.modal.identification import RecordModes, identify_record

from .deprecations import renamed
from .optional import optional
from .plotting import Axes, new_figure, save
from .results import html_table, same
from .signals import Signals


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EstimatedMode:
    """One mode of vibration, or the line of a machine.

    Parameters
    ----------
    frequency_hz
        Undamped natural frequency and its standard deviation [Hz].
    damping_ratio
        Damping ratio and its standard deviation [1].
    shape, shape_sd
        Mode shape of unit norm over the channels, and standard deviations; None where the
        method finds no shapes, or channels have several units.
    kind
        ``"structural"``, or ``"harmonic"`` for the line of a machine.
    method
        Method that found it.
    flags
        Reasons to distrust it; empty where there are none.
    correlation
        Between the errors of frequency and damping ratio [1].
    span_s
        Part of the signals that was used [s].
    quality
        Share of the model orders that show the mode [1]; None where it was not judged.
    """

    frequency_hz: Measured
    damping_ratio: Measured
    shape: Complex[np.ndarray, " channel"] | None
    shape_sd: Float[np.ndarray, " channel"] | None
    kind: str
    method: str
    flags: tuple[str, ...]
    correlation: float
    span_s: tuple[float, float]
    quality: float | None

    def __eq__(self, other: object) -> bool:
        """Whether all values are the same."""
        return same(self, other) if isinstance(other, EstimatedMode) else NotImplemented

    __hash__ = None  # type: ignore[assignment]


class Modes(Sequence[EstimatedMode]):
    """Identified modes, ascending in frequency.

    Parameters
    ----------
    modes
        The modes.
    signals
        Signals that they were identified from.
    notes
        Remarks on the record and its excitation.
    detail
        Stabilisation diagram and spectra, where all channels were identified together.
    """

    MADE_BY = "slowtime.identify(signals)"
    """What makes them, for messages."""

    @checked
    def __init__(
        self,
        modes: Sequence[EstimatedMode],
        signals: Signals,
        notes: Sequence[str],
        detail: ModalResult | None,
    ) -> None:
        self._modes, self.signals = tuple(modes), signals
        self.notes, self.detail = tuple(notes), detail
        self.selection: Selection | None = None

    def __len__(self) -> int:
        return len(self._modes)

    def __getitem__(self, index: Any) -> Any:
        return self._modes[index]

    def __eq__(self, other: object) -> bool:
        """Whether modes, signals and notes are the same."""
        if not isinstance(other, Modes):
            return NotImplemented
        return (
            self._modes == other._modes
            and self.signals == other.signals
            and self.notes == other.notes
        )

    __hash__ = None  # type: ignore[assignment]

    def __iter__(self) -> Iterator[EstimatedMode]:
        return iter(self._modes)

    @property
    def frequencies_hz(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies [Hz]."""
        return np.array([mode.frequency_hz.value for mode in self._modes])

    @property
    def damping_ratios(self) -> Float[np.ndarray, " mode"]:
        """Damping ratios [1]."""
        return np.array([mode.damping_ratio.value for mode in self._modes])

    def rows(self) -> list[dict[str, Any]]:
        """Return each mode as plain values.

        Returns
        -------
        One dictionary per mode: ``frequency_hz`` and ``frequency_sd`` [Hz],
        ``damping_ratio`` and ``damping_sd`` [1], ``kind``, ``method`` and ``flags``.
        """
        return [
            {
                "frequency_hz": mode.frequency_hz.value,
                "frequency_sd": mode.frequency_hz.sd,
                "damping_ratio": mode.damping_ratio.value,
                "damping_sd": mode.damping_ratio.sd,
                "kind": mode.kind,
                "method": mode.method,
                "flags": ", ".join(mode.flags),
            }
            for mode in self._modes
        ]

    def table(self) -> str:
        """Return the modes as text.

        Returns
        -------
        One line per mode: frequency [Hz] and damping [%] with one standard deviation.
        """
        lines = ["  frequency [Hz]        damping [%]       method        flags"]
        for row in self.rows():
            damping = "machine"
            if row["kind"] == "structural":
                damping = f"{100 * row['damping_ratio']:.3f} ± {100 * row['damping_sd']:.3f}"
            frequency = f"{row['frequency_hz']:.4f} ± {row['frequency_sd']:.4f}"
            lines.append(
                f"  {frequency:20}  {damping:16}  {row['method']:12}  {row['flags']}".rstrip()
            )
        return "\n".join(lines)

    to_dataframe = renamed("Modes.to_dataframe", "to_pandas")

    def to_pandas(self) -> Any:
        """Convert to a pandas DataFrame.

        Returns
        -------
        One row per mode, with the columns of `rows`.
        """
        return optional("pandas").DataFrame(self.rows())

    @checked
    def to_uff(self, path: str | Path, geometry: str | Path | None = None) -> None:
        """Write the modes as a universal file (dataset 55).

        Parameters
        ----------
        path
            File to write (.uff or .unv).
        geometry
            Places of the channels: CSV with channel, x, y, z and direction, or a universal
            file with nodes.

        Raises
        ------
        ValueError
            If no mode has a shape.
        """
        self._with_shapes()
        places = read_geometry(Path(geometry)) if geometry is not None else None
        write_modes(Path(path), self.file(), places, self.signals.units[0])

    @checked
    def to_selection(self, path: str | Path) -> None:
        """Write the choice of modes to be edited by hand, for ``identify(select=...)``.

        Parameters
        ----------
        path
            YAML file to write.

        Raises
        ------
        ValueError
            If the modes were not identified from all channels together.
        """
        if self.detail is None:
            raise ValueError(
                "There are no poles to choose from, as each mode was identified by itself. "
                "Identify with method='modes'."
            )
        text = selection_text("signals", self.selection, self.detail.modes)
        Path(path).write_text(text, encoding="utf-8")

    @checked
    def to_json(self, path: str | Path) -> None:
        """Write a modes file, as ``slowtime identify --out`` does.

        Parameters
        ----------
        path
            File to write (.json).
        """
        Path(path).write_text(self.file().model_dump_json(indent=1) + "\n", encoding="utf-8")

    def file(self) -> ModesFile:
        """Return the content of a modes file.

        Returns
        -------
        Model of a modes file, as other functions and commands take it.
        """
        return ModesFile.model_validate(
            {
                "slowtime_modes": 1,
                "record": "signals",
                "rate_hz": self.signals.rate_hz,
                "channels": self.signals.channels,
                "duration_s": self.signals.duration_s,
                "assumptions": self.notes,
                "modes": [_entry(mode) for mode in self._modes],
            }
        )

    @checked
    def plot_stabilisation(self, path: str | Path | None = None) -> Axes:
        """Draw the stabilisation diagram: poles over model order, and the identified modes.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.

        Raises
        ------
        ValueError
            If the modes were not identified from all channels together.
        """
        if self.detail is None or not len(self.detail.stabilisation.order):
            raise ValueError(
                "There is no stabilisation diagram, as each mode was identified by itself. "
                "Identify with method='modes'."
            )
        poles = self.detail.stabilisation
        (axes,) = new_figure()
        sound = np.isfinite(poles.frequency_hz) & (poles.damping_ratio > 0)
        for chosen, label, style in (
            (sound & (poles.mode < 0), "other pole", {"color": "0.7", "marker": "."}),
            (sound & (poles.mode >= 0), "pole of a mode", {"color": "C0", "marker": "x"}),
        ):
            axes.scatter(
                poles.frequency_hz[chosen], poles.order[chosen], label=label, s=14, **style
            )
        for hz in self.frequencies_hz:
            axes.axvline(hz, color="C1", linewidth=0.8)
        highest = 1.4 * self.frequencies_hz.max() if len(self) else self.signals.rate_hz / 2
        axes.set(xlabel="frequency [Hz]", ylabel="model order", xlim=(0, highest))
        level = 10 * np.log10(np.maximum(self.detail.singular_values[:, 0], 1e-300))
        beside = axes.twinx()
        beside.plot(self.detail.spectrum_hz, level, color="C1", alpha=0.5, linewidth=0.8)
        beside.set(ylabel="first singular value [dB]")
        axes.legend(loc="upper right")
        return save(axes, path)

    @checked
    def plot_mac(self, path: str | Path | None = None) -> Axes:
        """Draw the modal assurance criterion of the mode shapes with each other.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.

        Raises
        ------
        ValueError
            If no mode has a shape.
        """
        shown = self._with_shapes()
        shapes = np.stack([mode.shape for mode in shown if mode.shape is not None], axis=1)
        names = [f"{mode.frequency_hz.value:.4g} Hz" for mode in shown]
        (axes,) = new_figure()
        drawn = axes.imshow(mac_matrix(shapes, shapes), vmin=0.0, vmax=1.0, cmap="Blues")
        axes.figure.colorbar(drawn, ax=axes, label="MAC")
        axes.set_xticks(range(len(names)), names, rotation=90)
        axes.set_yticks(range(len(names)), names)
        return save(axes, path)

    def _with_shapes(self) -> list[EstimatedMode]:
        shown = [mode for mode in self._modes if mode.shape is not None]
        if not shown:
            raise ValueError(
                "No mode has a shape. Identify with method='modes', from channels of one unit."
            )
        return shown

    @checked
    def plot_shapes(self, path: str | Path | None = None) -> Axes:
        """Draw the mode shapes over the channels, with one standard deviation.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.

        Raises
        ------
        ValueError
            If no mode has a shape.
        """
        shown = self._with_shapes()
        (axes,) = new_figure()
        for mode in shown:
            assert mode.shape is not None
            axes.errorbar(
                range(len(mode.shape)), mode.shape.real, yerr=mode.shape_sd, marker="o",
                label=f"{mode.frequency_hz.value:.4g} Hz", capsize=2,
            )  # fmt: skip
        axes.axhline(0.0, color="0.8", linewidth=0.8)
        axes.set_xticks(range(len(self.signals.channels)), self.signals.channels)
        axes.set(xlabel="channel", ylabel="mode shape, real part (unit norm)")
        axes.legend()
        return save(axes, path)

    def _repr_html_(self) -> str:
        return html_table(f"Modes: {len(self)} identified", self.rows())

    def __repr__(self) -> str:
        return f"Modes: {len(self)} identified\n{self.table()}"


@takes(IdentifyOptions)
def identify(signals: Signals, options: IdentifyOptions) -> Modes:
    """Find natural frequencies, damping ratios and mode shapes, with standard deviations.

    Parameters
    ----------
    signals
        Vibration, under a steady random excitation or in free decay.

    Returns
    -------
    Modes, ascending in frequency. `Modes.notes` says where assumptions about the excitation do
    not hold.

    Raises
    ------
    ValueError
        If the record is too short for the band, the band is outside the measured range,
        there is no such method, or an edit names no mode or pole.
    TypeError
        If `signals` are no `Signals`, or the band is no pair of numbers.
    """
    record = signals.record
    chosen = accelerations(record.channels, record.units)
    notes = list(signals.notes)
    if len(chosen) < len(record.channels):
        left_out = [name for name in record.channels if name not in chosen]
        notes.append(f"Left out, as they are no accelerations: {', '.join(left_out)}.")
        signals = signals[list(chosen)]
    found = identify_record(signals.record, options)
    notes += [found.note] if found.note else []
    record, whole = found.record, found.whole
    if len(found.part) < len(record.samples):
        notes.append(f"Only the longest part without a gap was used: {found.duration_s:.4g} s.")
    if found.force.flags:
        notes.append(
            "The excitation was not a steady random one, so the assumptions of ambient "
            "identification do not hold."
        )
    if mixed_units(record.channels, record.units) and whole is not None:
        notes.append("Channels have several units: there are no mode shapes.")
    notes += whole.notes if whole is not None else ()
    single = _single(found.single)
    estimates = single if whole is None else _of_all_channels(whole, found)
    modes = Modes(
        sorted(estimates, key=lambda mode: mode.frequency_hz.value), signals, notes, whole
    )
    modes.selection = found.selection
    return modes


def _single(found: Any) -> list[EstimatedMode]:
    """Convert modes that were identified one by one."""
    return [
        EstimatedMode(
            frequency_hz=mode.frequency_hz, damping_ratio=mode.damping_ratio, shape=None,
            shape_sd=None, kind="harmonic" if mode.method == LINE else "structural",
            method=mode.method, flags=mode.flags, correlation=mode.correlation,
            span_s=mode.span_s, quality=None,
        )
        for mode in [*found.modes, *found.lines]
    ]  # fmt: skip


def _of_all_channels(whole: ModalResult, found: RecordModes) -> list[EstimatedMode]:
    """Convert modes that were identified from all channels together."""
    record = found.record
    mixed = bool(mixed_units(record.channels, record.units)) and len(record.channels) > 1
    return [
        EstimatedMode(
            frequency_hz=mode.frequency_hz, damping_ratio=mode.damping_ratio,
            shape=None if mixed else mode.shape, shape_sd=None if mixed else mode.shape_sd,
            kind=mode.kind, method=found.method, flags=mode.flags,
            correlation=mode.correlation, span_s=(0.0, found.duration_s),
            quality=mode.quality,
        )
        for mode in whole.modes
    ]  # fmt: skip


def _entry(mode: EstimatedMode) -> dict[str, Any]:
    """Return the entry of a modes file."""
    shape = None
    if mode.shape is not None and mode.shape_sd is not None:
        shape = mode.shape, mode.shape_sd
    return mode_entry(
        mode.frequency_hz, mode.damping_ratio, mode.correlation, kind=mode.kind,
        method=mode.method, span_s=mode.span_s, flags=mode.flags, shape=shape,
        quality=mode.quality,
    )  # fmt: skip
