"""The verb `identify`: estimates natural frequencies and damping from a record."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from slowtime.identification import checks
from slowtime.identification.estimates import Identified
from slowtime.identification.free_decay.along_decay import DEPENDS, along_decay_note
from slowtime.identification.options import IdentifyOptions, OneByOne
from slowtime.identification.single_mode.machine_lines import (
    LINE,
    ModesAndLines,
)
from slowtime.identification.single_mode.sliding_windows import (
    Epoch,
    dependence,
    identify_windows,
)
from slowtime.signals.imputation import LEAST_SHARE
from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import counting, note, plural, show
from slowtime_services.files import MARK, Record, accelerations, mixed_units
from slowtime_services.matrices import read_any_description
from slowtime_services.modal import UNIVERSAL, read_geometry
from slowtime_services.modal.entries import mode_entry
from slowtime_services.modal.geometry import Geometry
from slowtime_services.modal.identification import (
    RecordModes,
    identify_record,
    is_decay,
    stretches,
)
from slowtime_services.modal.losses import Completed, completed, wider

from . import mode_tables
from .modes_file import write_modes_file
from .shape_scenes import sketch_of_places, spatial_section

MIXED = "mixed_units"
"""Flag of modes whose shape is not told, since channels have several units."""

OVERLAPPING = "overlapping"
"""Flag of what was read from a window that shares samples with its neighbours."""

OVERLAP_TOLERANCE = 0.01
"""Share of a window that neighbours may have in common by rounding [1]."""

MOSTLY = 0.5
"""Share of the variance [1] below the search band from which that is said."""

COLUMNS = ("frequency [Hz]", "damping [%]", "SNR [dB]", "method", "mistrust")


@with_record
def identify(
    record: Record,
    path: Path,
    second: Record | None,
    start_sd_ms: float,
    rate_sd_ppm: float,
    options: IdentifyOptions,
    window_s: float | None,
    hop_s: float | None,
    model: Path | None,
    report: Path | None,
    out: Path | None,
    geometry: Path | None,
) -> None:
    """Find natural frequencies and damping in a record, with errors."""
    universal = out is not None and out.suffix.lower() in UNIVERSAL
    if (model or report or universal) and options.method == "auto":
        options = dataclasses.replace(options, method="modes")
    known = read_geometry(geometry) if geometry else None
    record = _accelerations_of(record)
    if second is not None:
        # Imported here, for most records are of one board.
        from .alignment import ClockErrors, aligned_record

        clocks = ClockErrors(start_sd_ms, rate_sd_ppm)
        record = aligned_record(record, second, clocks, options.band_hz)
    mixed = mixed_units(record.channels, record.units)
    models = reference_modes(model, record.channels, mixed)
    _say_constant(record)
    silent = out is not None and str(out) == "-"
    result: dict[str, Any] = {
        "slowtime_modes": 1,
        "record": path.name,
        "rate_hz": record.rate_hz,
        "channels": list(record.channels),
        "duration_s": record.duration_s,
        "start_ns": record.start_ns,
        "assumptions": [*record.assumptions, *record.notes],
    }
    if window_s is None:
        with counting("Identifying"):
            found = identify_record(record, options)
        _say(found, options.band_hz)
        told = _told_one_by_one if found.whole is None else _told_together
        references = _References(models, model, mixed, known)
        result["modes"] = told(found, references, None if silent else path.name)
        completed_record, texts = found.record, [found.note]
        texts += found.whole.notes if found.whole is not None else ()
        if report is not None and found.whole is not None:
            _write_report(report, path.name, record.duration_s, found, references)
    else:
        given = completed(record, options.gaps)
        texts, completed_record = [given.note], given.record
        if given.note:
            note(given.note)
        epochs = _windows(given, window_s, hop_s, options)
        result |= {"window_s": window_s, "epochs": [_epoch_json(epoch) for epoch in epochs]}
        if not silent:
            _show_epochs(epochs, path.name)
    result["assumptions"] += [text for text in texts if text]
    if out is not None:
        _mark(result, len(completed_record.samples) > len(record.samples))
        write_modes_file(out, result, known, record.units[0])


@dataclasses.dataclass(frozen=True, slots=True)
class _References:
    """What measured modes are compared with and drawn on."""

    models: Sequence[mode_tables.ModelMode]
    model: Path | None
    mixed: str
    geometry: Geometry | None


def _say(found: RecordModes, band_hz: tuple[float, float] | None) -> None:
    """Report what was done about missing samples, on the force, lines, laws and silence."""
    if found.note:
        note(found.note)
    if found.record.gaps:
        note(
            f"only the longest part without a gap is used, {found.duration_s:.3f} s. "
            "--gaps use takes all samples."
        )
    _say_force(found)
    _say_lines(found.single)
    for mode in found.single.modes:
        text = DEPENDS in mode.flags and along_decay_note(
            mode, found.part, found.record.rate_hz
        )
        if text:
            note(text)
    if not found.force.flags:
        _say_slow(found, band_hz)


def _told_one_by_one(
    found: RecordModes, _: _References, name: str | None
) -> list[dict[str, Any]]:
    """Give modes of single channels for a file, and show them unless there is no name."""
    single = found.single
    modes = sorted([*single.modes, *single.lines], key=lambda mode: mode.frequency_hz.value)
    if name is not None:
        _show_modes(modes, name)
    return [_as_json(mode) for mode in modes]


def _told_together(
    found: RecordModes, references: _References, name: str | None
) -> list[dict[str, Any]]:
    """Give modes of all channels likewise."""
    whole, models, mixed = found.whole, references.models, references.mixed
    assert whole is not None
    if mixed and len(found.record.channels) > 1:
        note_mixed_units(mixed)
    for text in whole.notes:
        note(text)
    if name is not None:
        mode_tables.show_modes(whole, models, name, method=found.method)
    span_s = 0.0, found.duration_s
    return [
        without_shape(mode_tables.as_json(mode, models, span_s, method=found.method), mixed)
        for mode in whole.modes
    ]


def _write_report(
    report: Path, name: str, duration_s: float, found: RecordModes, references: _References
) -> None:
    whole, models, known = found.whole, references.models, references.geometry
    assert whole is not None
    channels = found.record.channels
    spatial = (
        []
        if references.mixed
        else spatial_section(whole, channels, models, model=references.model, geometry=known)
    )
    mode_tables.write_report(
        report,
        name,
        channels,
        whole,
        models,
        shapes=not references.mixed,
        extra=spatial,
        selection=found.selection,
        about={
            "rate_hz": found.record.rate_hz,
            "duration_s": duration_s,
            "start_ns": found.record.start_ns,
            "structure": structure_name(references.model),
            "sketch": sketch_of_places(known, channels),
        },
    )


def reference_modes(
    model: Path | None, channels: tuple[str, ...], mixed: str
) -> list[mode_tables.ModelMode]:
    """Modes of a model file, or of a universal file, at the channels of the record."""
    if model is None:
        return []
    if model.suffix.lower() in UNIVERSAL:
        found = mode_tables.read_model_modes(model, channels)
    else:
        found = mode_tables.model_modes(read_any_description(model, note=note), channels)
    return [(hz, None) for hz, _ in found] if mixed else found


def structure_name(model: Path | None) -> str:
    """Name of the structure in a model file; empty without one."""
    if model is None or model.suffix.lower() in UNIVERSAL:
        return ""
    return read_any_description(model, note=lambda _: None).name


def note_mixed_units(mixed: str) -> None:
    """Explain why there are no shapes."""
    note(
        f"channels are of several units ({mixed}), so no mode shapes are given: their "
        "components could not be compared. Give --unit or --reading sensitivity, or select "
        "channels with --channels. Frequencies and damping do not depend on units."
    )


def without_shape(body: dict[str, Any], mixed: str) -> dict[str, Any]:
    """Take the shape from a mode over channels of several units, and flag it."""
    if not mixed:
        return body
    return {**body, "shape": None, "flags": [*body["flags"], MIXED]}


def _say_force(found: RecordModes) -> None:
    """Report that the force violates the assumptions of ambient identification."""
    force, modes = found.force, found.single.modes
    if not force.flags or (modes and all(is_decay(mode) for mode in modes)):
        return
    why = []
    if force.event_s is not None:
        why.append(
            f"90 % of its energy came within {force.event_s:.3g} of {found.duration_s:.4g} s, "
            "as in an earthquake"
        )
    elif force.onset:
        why.append("it sets in after the record begins, as an earthquake does")
    if force.period_s is not None:
        why.append(f"it repeats itself after {force.period_s:.4g} s, as a multisine does")
    if modes or found.whole is not None:
        doing = "The standard deviations of the modes found are not reliable."
    else:
        doing = (
            "No modes are reported, because the spectrum of the force would be mistaken "
            "for that of the structure. Give a record under a steady random force or of "
            "a free decay; --method modes identifies modes nevertheless."
        )
    note(f"the force was not steady and random: {', and '.join(why)}. {doing}")


def _say_lines(told: ModesAndLines) -> None:
    """Report the speeds of machines whose multiples are among the lines."""
    speeds = [f"{family.base_hz.value:.4g} Hz" for family in told.families]
    if told.lines:
        of = f", multiples of {' and of '.join(speeds)}" if speeds else ""
        if speeds and sum(len(family.members) for family in told.families) < len(told.lines):
            of += " and lines beside these"
        note(f"{plural(len(told.lines), 'line')} of machines{of}: kind harmonic, no modes.")


def _mark(result: dict[str, Any], estimated: bool) -> None:
    """Flag modes found in samples of which some were estimated."""
    if not estimated:
        return
    of_windows = [mode for epoch in result.get("epochs", ()) for mode in epoch["modes"]]
    for mode in [*result.get("modes", ()), *of_windows]:
        mode["flags"] = [*mode["flags"], MARK]


def _accelerations_of(record: Record) -> Record:
    """Leave out channels that are no accelerations by name, if others are, with a note."""
    chosen = accelerations(record.channels, record.units)
    left_out = [name for name in record.channels if name not in chosen]
    if not left_out:
        return record
    note(
        f"identified from {', '.join(chosen)}; {', '.join(left_out)} left out, because "
        "name and unit do not show an acceleration. Choose other channels with "
        "--channels."
    )
    columns = [record.channels.index(name) for name in chosen]
    return dataclasses.replace(
        record,
        samples=record.samples[:, columns],
        channels=chosen,
        units=tuple(record.units[column] for column in columns),
    )


def _say_slow(found: RecordModes, band_hz: tuple[float, float] | None) -> None:
    """Say that there is no mode, and of a slow record that most lies below the search band."""
    part, rate_hz = found.part, found.record.rate_hz
    low_hz = checks.band(None, rate_hz, len(part))[0]
    share = checks.share_below(part, rate_hz, low_hz)
    if band_hz is None and share > MOSTLY:
        note(
            f"{100 * share:.0f} % of the variance lies up to {low_hz:.3g} Hz, four cycles in "
            "the record, below which no mode is looked for: it is drift or a slower mode. For "
            "that, give a longer record, or a lower band with --band-hz."
        )
    elif not (found.single.modes or (found.whole and found.whole.modes)):
        note(
            "no mode stands out from the noise. Give a longer record, or a band with --band-hz."
        )


def _say_constant(record: Record) -> None:
    constant = np.ptp(np.asarray(record.samples, dtype=float), axis=0) == 0
    dead = [name for name, same in zip(record.channels, constant, strict=True) if same]
    if dead and len(dead) < len(record.channels):
        note(
            f"{', '.join(dead)} never changes, so it carries no information. Check the sensor."
        )


def _informed(epoch: Epoch, whole: Completed) -> Epoch:
    """Window with errors as large as its samples allow; refused where most are missing."""
    if whole.present is None:
        return epoch
    rate = whole.record.rate_hz
    first, last = round(epoch.start_s * rate), round(epoch.end_s * rate)
    there = float(np.mean(whole.present[first:last]))
    if there < LEAST_SHARE:
        why = f"{100 * (1 - there):.0f} % of the samples of this window are missing."
        return dataclasses.replace(epoch, modes=(), refused=why)
    factor = whole.inflation(first, last)
    return dataclasses.replace(
        epoch, modes=tuple(wider(mode, factor, whole.flags) for mode in epoch.modes)
    )


def _windows(
    given: Completed, window_s: float, hop_s: float | None, options: IdentifyOptions
) -> list[Epoch]:
    record = given.record
    samples = np.asarray(record.samples, dtype=float)
    shortest = round(window_s * record.rate_hz)
    parts = [part for part in stretches(record) if part[1] - part[0] >= shortest]
    if not parts:
        longest = max(b - a for a, b, _ in stretches(record)) / record.rate_hz
        raise click.UsageError(
            f"--window-s {window_s:g} is longer than the longest part of the record without a "
            f"gap, {longest:g} s. Give a shorter window{' or --gaps use' * bool(record.gaps)}."
        )
    epochs: list[Epoch] = []
    with counting("Identifying windows") as tell:
        for number, (first, last, lost) in enumerate(parts):
            if len(parts) > 1:
                tell(f"part {number + 1} of {len(parts)}, {plural(len(epochs), 'window')} done")
            offset = (first + lost) / record.rate_hz
            for epoch in identify_windows(
                samples[first:last],
                record.rate_hz,
                window_s=window_s,
                hop_s=hop_s,
                band_hz=options.band_hz,
                method=cast(OneByOne, options.method),
            ):
                span = epoch.start_s + offset, epoch.end_s + offset
                epochs.append(Epoch(*span, epoch.modes, epoch.refused))
    return [_informed(epoch, given) for epoch in _marked(epochs)]


def _marked(epochs: list[Epoch]) -> list[Epoch]:
    """Flag the modes of windows that share samples with their neighbours."""
    edges = np.array([(epoch.start_s, epoch.end_s) for epoch in epochs])
    factors = dependence(edges[:, 0], edges[:, 1])
    return [
        dataclasses.replace(
            epoch,
            modes=tuple(
                dataclasses.replace(mode, flags=(*mode.flags, OVERLAPPING))
                for mode in epoch.modes
            ),
        )
        if factor > 1 + OVERLAP_TOLERANCE
        else epoch
        for epoch, factor in zip(epochs, factors, strict=True)
    ]


def _as_json(mode: Identified) -> dict[str, Any]:
    return mode_entry(
        mode.frequency_hz, mode.damping_ratio, mode.correlation,
        kind="harmonic" if mode.method == LINE else "structural", method=mode.method,
        span_s=mode.span_s, flags=mode.flags, snr_db=mode.snr_db,
    )  # fmt: skip


def _epoch_json(epoch: Epoch) -> dict[str, Any]:
    body: dict[str, Any] = {
        "start_s": epoch.start_s,
        "end_s": epoch.end_s,
        "modes": [_as_json(mode) for mode in epoch.modes],
    }
    return body | ({"refused": epoch.refused} if epoch.refused else {})


def _cells(mode: Identified) -> tuple[str, ...]:
    f, z = mode.frequency_hz, mode.damping_ratio
    return (
        f"{f.value:.4f} ± {f.sd:.4f}",
        "machine" if mode.method == LINE else f"{100 * z.value:.3f} ± {100 * z.sd:.3f}",
        "" if mode.snr_db is None else f"{mode.snr_db:.0f}",
        mode.method,
        ", ".join(mode.flags),
    )


def _fields_of_mode(mode: Identified | None) -> dict[str, Any]:
    """Return the mode as fields of a line; all empty if there is none."""
    fields: dict[str, Any] = dict.fromkeys(
        ("frequency_hz", "frequency_sd", "damping_ratio", "damping_sd", "snr_db", "method")
    )
    fields |= {"kind": None, "quality": None, "flags": None}
    if mode is not None:
        f, z = mode.frequency_hz, mode.damping_ratio
        fit = (f.value, f.sd, z.value, z.sd, mode.snr_db, mode.method)
        kind = "harmonic" if mode.method == LINE else "structural"
        values = (*fit, kind, None, ",".join(mode.flags))
        fields.update(zip(fields, values, strict=True))
    return fields


def _show_modes(modes: Sequence[Identified], title: str) -> None:
    if modes:
        plain = [_fields_of_mode(mode) for mode in modes]
        show(title, COLUMNS, [_cells(mode) for mode in modes], plain=plain)


def _show_epochs(epochs: Sequence[Epoch], title: str) -> None:
    rows, plain = [], []
    for epoch, mode in _by_mode(epochs):
        cells = _cells(mode) if mode is not None else ("-",) * len(COLUMNS)
        rows.append((f"{epoch.start_s:g} – {epoch.end_s:g}", *cells))
        plain.append({"start_s": epoch.start_s, "end_s": epoch.end_s} | _fields_of_mode(mode))
    show(title, ("window [s]", *COLUMNS), rows, plain=plain)


def _by_mode(epochs: Sequence[Epoch]) -> Iterator[tuple[Epoch, Identified | None]]:
    for epoch in epochs:
        for mode in epoch.modes or (None,):
            yield epoch, mode
