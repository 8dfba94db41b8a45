"""The verb `identify` on a file of measured frequency responses."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from slowtime.identification.frequency_response.response import Kind
from slowtime.identification.modal_fit.assembly import ModalTest
from slowtime.identification.modal_fit.by_hand import edited_test
from slowtime.identification.modal_fit.identification import identify_responses
from slowtime.identification.options import Selection
from slowtime_cli.shared.terminal import counting, note
from slowtime_services.files import mixed_units
from slowtime_services.frequency_responses import MeasuredResponses, read_responses
from slowtime_services.modal import read_geometry, read_selection

from . import mode_tables
from .identify import note_mixed_units, reference_modes, structure_name
from .identify_inputs import METHOD, driving_points, found_modes
from .modes_file import write_modes_file
from .response_charts import CAPTIONS, response_sections
from .response_files import show_masses, write_response_file
from .shape_scenes import spatial_section

OF_RECORDS = (
    "rate_hz", "channels", "skip_lines", "columns", "time_column", "time_unit", "date_order",
    "wrapped", "repeated", "keep", "units", "sensitivities", "window_s", "hop_s", "second",
)  # fmt: skip
"""Options of records in time, which mean nothing of frequency responses."""


def identify(
    path: Path, kind: Kind | None, flags: Mapping[str, Any], test: Mapping[str, Any]
) -> bool:
    """Find modes in measured frequency responses, with errors.

    Parameters
    ----------
    path
        The file.
    kind
        What they are, as a person says.
    flags
        Options of the verb.
    test
        Options of modal tests.

    Returns
    -------
    Whether the file holds frequency responses.

    Raises
    ------
    click.UsageError
        Where options of records in time are given.
    """
    given = [name for name in OF_RECORDS if flags.get(name) not in (None, (), [])]
    measured = None if given and kind is None else read_responses(path, kind)
    if measured is None:
        if test["driving_points"] or test["frf"]:
            raise click.UsageError(
                "driving_point and --frf can only be used together with --input, which names "
                "the measured inputs, or with a file of frequency responses. Give --input, or "
                "leave them out."
            )
        return False
    if given or flags.get("method", "auto") != "auto":
        options = ", ".join(f"--{name.replace('_', '-')}" for name in given) or "--method"
        raise click.UsageError(
            f"{options} goes with records in time; {path.name} holds frequency responses. "
            "Leave it out."
        )
    for text in measured.notes:
        note(text)
    selection = None if flags["select"] is None else read_selection(flags["select"])
    response = measured.response
    outputs, inputs = (
        [name for name, _ in side] for side in (measured.outputs, measured.inputs)
    )
    points = driving_points(outputs, inputs, test["driving_points"])
    with counting("Identifying"):
        found = identify_responses(response, band_hz=flags["band_hz"], driving_points=points)
        found = found if selection is None else edited_test(found, selection)
    for text in found.result.notes:
        note(text)
    if not found.result.modes:
        note("no mode stands out from the noise. Give another band with --band-hz.")
    _tell(found, measured, path, flags, (test["frf"], selection))
    return True


def _tell(
    found: ModalTest,
    measured: MeasuredResponses,
    path: Path,
    flags: Mapping[str, Any],
    more: tuple[Path | None, Selection | None],
) -> None:
    """Print and write the result; `more` is a file of responses to write, and a choice."""
    frf, selection = more
    outputs = tuple(name for name, _ in measured.outputs)
    mixed = mixed_units(outputs, tuple(unit for _, unit in measured.outputs))
    mixed = mixed if len(outputs) > 1 else ""
    if mixed:
        note_mixed_units(mixed)
    out, report, model = flags["out"], flags["report"], flags["model"]
    known = read_geometry(flags["geometry"]) if flags["geometry"] else None
    models = reference_modes(model, outputs, mixed)
    if out is None or str(out) != "-":
        mode_tables.show_modes(found.result, models, path.name, method=METHOD)
        show_masses(found, outputs, [name for name, _ in measured.inputs])
    channels = measured.outputs, measured.inputs
    if report is not None:
        spatial = (
            []
            if mixed
            else spatial_section(found.result, outputs, models, model=model, geometry=known)
        )
        mode_tables.write_report(
            report, path.name, outputs, found.result, models, shapes=not mixed,
            captions=CAPTIONS, selection=selection,
            about={"structure": structure_name(model)},
            extra=[*spatial, *response_sections(found, *channels)],
        )  # fmt: skip
    if frf is not None:
        write_response_file(frf, found, *channels, known)
    if out is not None:
        hz = measured.response.frequency_hz
        # Of the blocks that these lines would be of.
        duration_s = (len(hz) - 1) / float(hz[-1] - hz[0])
        body = {
            "slowtime_modes": 1,
            "record": path.name,
            "rate_hz": 2 * float(hz[-1]),
            "channels": list(outputs),
            "duration_s": duration_s,
            "assumptions": [*measured.notes, *found.result.notes],
            "modes": found_modes(found, models, (0.0, duration_s), mixed),
        }
        write_modes_file(out, body, known, measured.outputs[0][1])
