"""The verb `identify` with measured inputs: hammer or shaker tests, and earthquakes."""

import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.identification.frequency_response.excitation import kind_of_excitation
from slowtime.identification.frequency_response.hits import Hit, find_hits, rest_before
from slowtime.identification.frequency_response.response import Kind
from slowtime.identification.modal_fit.assembly import ModalTest
from slowtime.identification.modal_fit.blows import HammerSettings, identify_blows
from slowtime.identification.modal_fit.by_hand import edited_test
from slowtime.identification.modal_fit.records import identify_record
from slowtime_cli.shared.record_input import with_record
from slowtime_cli.shared.terminal import counting, note, plural
from slowtime_services.files import Record, accelerations, bridged, find_column, mixed_units
from slowtime_services.files.units import unit_of
from slowtime_services.modal import read_geometry, read_selection

from . import mode_tables
from .identify import note_mixed_units, reference_modes, structure_name, without_shape
from .modes_file import write_modes_file
from .response_charts import CAPTIONS, response_sections
from .response_files import show_masses, write_response_file
from .shape_scenes import spatial_section

METHOD = "maximum_likelihood"
"""Method that is named in files of modes."""

LOW_SHARE, HIGH_SHARE = 20.0, 0.4
"""Band without --band-hz: from 20 cycles in the record to 0.4 of the rate, where filters of
data acquisition still pass all."""


AT_REST = 0.03
"""[1] Motion before a blow over that after it, from which a bias of an exponential window is
told. Source: simulations; at 3 % the bias of frequencies reaches their standard deviation."""


@dataclasses.dataclass(frozen=True, slots=True)
class InputsAndOutputs:
    """Inputs and outputs of a record, and what outputs are per input."""

    inputs: np.ndarray[Any, Any]
    outputs: np.ndarray[Any, Any]
    input_channels: tuple[tuple[str, str], ...]
    output_channels: tuple[tuple[str, str], ...]
    excitation: str
    kind: Kind


@with_record
def identify(
    record: Record,
    path: Path,
    inputs: tuple[str, ...],
    band_hz: tuple[float, float] | None,
    out: Path | None,
    report: Path | None,
    frf: Path | None,
    geometry: Path | None,
    model: Path | None,
    **flags: Any,
) -> None:
    """Find modes in a record with measured inputs, with errors."""
    known = read_geometry(geometry) if geometry else None
    selection = None if flags["select"] is None else read_selection(flags["select"])
    record, said = bridged(record)
    if said:
        note(said)
    part = _longest(record)
    measured = _measured(part, inputs, flags["excitation"])
    rate = part.rate_hz
    edges = band_hz or (LOW_SHARE * rate / len(part.samples), HIGH_SHARE * rate)
    with counting("Identifying"):
        found = _identified(measured, rate, edges, flags)
        found = found if selection is None else edited_test(found, selection)
    for text in found.result.notes:
        note(text)
    outputs = tuple(name for name, _ in measured.output_channels)
    mixed = mixed_units(outputs, tuple(unit for _, unit in measured.output_channels))
    if mixed and len(outputs) > 1:
        note_mixed_units(mixed)
    if not found.result.modes:
        note(
            "no mode stands out from the noise. Give a longer record, or a band with --band-hz."
        )
    models = reference_modes(model, outputs, mixed)
    silent = out is not None and str(out) == "-"
    if not silent:
        mode_tables.show_modes(found.result, models, path.name, method=METHOD)
        show_masses(found, outputs, [name for name, _ in measured.input_channels])
    if report is not None:
        spatial = (
            []
            if mixed
            else spatial_section(found.result, outputs, models, model=model, geometry=known)
        )
        mode_tables.write_report(
            report,
            path.name,
            outputs,
            found.result,
            models,
            shapes=not mixed,
            captions=CAPTIONS,
            selection=selection,
            about={
                "rate_hz": part.rate_hz,
                "duration_s": len(part.samples) / part.rate_hz,
                "start_ns": part.start_ns,
                "structure": structure_name(model),
            },
            extra=[
                *spatial,
                *response_sections(found, measured.output_channels, measured.input_channels),
            ],
        )
    if frf is not None:
        write_response_file(
            frf, found, measured.output_channels, measured.input_channels, known
        )
    if out is not None:
        body = _body(found, path, part, outputs, models, mixed)
        write_modes_file(out, body, known, measured.output_channels[0][1])


def _longest(record: Record) -> Record:
    """Return the longest part without a gap."""
    starts = [0, *(gap.row for gap in record.gaps), len(record.samples)]
    first, last = max(itertools.pairwise(starts), key=lambda p: p[1] - p[0])
    if record.gaps:
        note(
            "only the longest part without a gap is used, "
            f"{(last - first) / record.rate_hz:.3f} s."
        )
    return dataclasses.replace(record, samples=record.samples[first:last], gaps=())


def _measured(record: Record, names: tuple[str, ...], excitation: str) -> InputsAndOutputs:
    columns = [find_column(name, record.channels) for name in names]
    others = [k for k in range(len(record.channels)) if k not in columns]
    if len(set(columns)) < len(columns) or not others:
        raise click.UsageError(
            f"--input {','.join(names)} of the channels {', '.join(record.channels)}. Name "
            "each input once, and leave at least one channel as a response."
        )
    others = _responses(record, others)
    samples = np.asarray(record.samples, dtype=float)
    channels = list(zip(record.channels, record.units, strict=True))
    inputs = samples[:, columns]
    motion = [unit_of(record.units[k], record.channels[k]) for k in columns]
    if excitation == "auto":
        base = all(unit is not None for unit in motion)
        excitation = "base" if base else kind_of_excitation(inputs)
        note(f"treated as excitation by {excitation}. --setting excitation overrides this.")
    if excitation == "hammer" and len(columns) > 1:
        raise click.UsageError(
            f"--setting excitation=hammer has one input, and {len(columns)} were given. Give "
            "a record for each place of the hammer."
        )
    of_outputs = {unit_of(record.units[k], record.channels[k]) for k in others}
    quantities = {unit.quantity for unit in of_outputs if unit is not None}
    kind: Kind = "transmissibility" if excitation == "base" else "acceleration"
    if excitation != "base" and len(quantities) == 1:
        kind = quantities.pop()
    elif excitation != "base":
        note(
            "responses are treated as accelerations, because they state no common unit. Give "
            "it with --unit."
        )
    return InputsAndOutputs(
        inputs=inputs,
        outputs=samples[:, others],
        input_channels=tuple(channels[k] for k in columns),
        output_channels=tuple(channels[k] for k in others),
        excitation=excitation,
        kind=kind,
    )


def _responses(record: Record, others: list[int]) -> list[int]:
    """Leave out channels that are no accelerations by name, if others are, with a note."""
    names = tuple(record.channels[k] for k in others)
    chosen = accelerations(names, tuple(record.units[k] for k in others))
    left_out = [name for name in names if name not in chosen]
    if left_out:
        note(
            f"responses are {', '.join(chosen)}; {', '.join(left_out)} left out, because "
            "name and unit do not show an acceleration. Choose other channels with "
            "--channels."
        )
    return [k for k in others if record.channels[k] in chosen]


def _identified(
    measured: InputsAndOutputs,
    rate_hz: float,
    band_hz: tuple[float, float],
    flags: dict[str, Any],
) -> ModalTest:
    points = driving_points(
        [name for name, _ in measured.output_channels],
        [name for name, _ in measured.input_channels],
        flags["driving_points"],
    )
    if measured.excitation != "hammer":
        return identify_record(
            measured.inputs,
            measured.outputs,
            rate_hz,
            kind=measured.kind,
            band_hz=band_hz,
            source="subspace" if measured.excitation == "base" else "both",
            estimator=flags["estimator"],
            driving_points=points,
        )
    force, outputs, lead = _with_rest(measured.inputs[:, 0], measured.outputs)
    hits = find_hits(force, outputs, rate_hz, block_s=flags["block_s"])
    _note_hits(hits, rate_hz, lead)
    decay = 1 / flags["decay_s"] if flags["decay_s"] else 0.0
    loudest = max((hit.ringing for hit in hits if not hit.refused), default=0.0)
    if decay and loudest > AT_REST:
        note(
            f"before a blow the structure moved by {100 * loudest:.2g} % of what it did "
            "after: it was not at rest, and modes have a bias. Leave out --setting decay_s, "
            "or wait longer between blows."
        )
    settings = HammerSettings(
        kind=measured.kind, estimator=flags["estimator"], decay_rate=decay
    )
    return identify_blows(
        force,
        outputs,
        rate_hz,
        hits,
        band_hz=band_hz,
        settings=settings,
        driving_points=points,
    )


def _with_rest(force: np.ndarray, outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Put rest in front of a record that begins with its first blow, with a note."""
    lead = rest_before(force, outputs)
    if lead:
        note(
            "the record begins at a blow or just before it: before the record, force and "
            "responses are taken as at rest."
        )
    rest = np.full(lead, np.median(force)), np.tile(np.median(outputs, axis=0), (lead, 1))
    return np.concatenate([rest[0], force]), np.concatenate([rest[1], outputs]), lead


def _note_hits(hits: Sequence[Hit], rate_hz: float, lead: int) -> None:
    """Report how many blows are used, and why others are not."""
    used = [hit for hit in hits if not hit.refused]
    block_s = (hits[0].last - hits[0].first) / rate_hz
    note(f"{plural(len(used), 'blow')} of {len(hits)} used, blocks of {block_s:.4g} s.")
    for hit in hits:
        if hit.refused:
            note(f"blow at {hit.at_s - lead / rate_hz:.3f} s rejected: {hit.refused}.")


def driving_points(
    outputs: Sequence[str], inputs: Sequence[str], given: Sequence[str]
) -> list[tuple[int, int]]:
    """Return the pairs of output and input that a person names as one place and direction.

    Raises
    ------
    click.UsageError
        Where a name is not one of an output or an input.
    """
    found = []
    for text in given:
        output, _, driven = text.partition("=")
        if output not in outputs or (driven or inputs[0]) not in inputs:
            raise click.UsageError(
                f"--driving-point {text}: give RESPONSE=INPUT with a response of "
                f"{', '.join(outputs)} and an input of {', '.join(inputs)}."
            )
        found.append((outputs.index(output), inputs.index(driven or inputs[0])))
    return found


def _body(
    found: ModalTest,
    path: Path,
    record: Record,
    outputs: tuple[str, ...],
    models: Sequence[mode_tables.ModelMode],
    mixed: str,
) -> dict[str, Any]:
    duration_s = len(record.samples) / record.rate_hz
    return {
        "slowtime_modes": 1,
        "record": path.name,
        "rate_hz": record.rate_hz,
        "channels": list(outputs),
        "duration_s": duration_s,
        "assumptions": [*record.assumptions, *record.notes, *found.result.notes],
        "modes": found_modes(found, models, (0.0, duration_s), mixed),
    }


def found_modes(
    found: ModalTest,
    models: Sequence[mode_tables.ModelMode],
    span_s: tuple[float, float],
    mixed: str,
) -> list[dict[str, Any]]:
    """Return the modes as a file of modes has them."""
    return [
        without_shape(mode_tables.as_json(mode, models, span_s, method=METHOD), mixed)
        for mode in found.result.modes
    ]
