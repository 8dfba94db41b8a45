"""The file of modes that `slowtime identify --out` writes, by the ending of its name."""

from pathlib import Path
from typing import Any

from slowtime_cli.shared.terminal import note, plural, removed_unless_finished, write_json
from slowtime_schemas.files.modes import ModesFile
from slowtime_services.modal import UNIVERSAL, Geometry, write_modes, write_table


def write_modes_file(
    out: Path, result: dict[str, Any], geometry: Geometry | None, unit: str
) -> None:
    """Write modes as a universal file (.uff, .unv), as CSV, or else as JSON."""
    kind = out.suffix.lower()
    if kind not in (*UNIVERSAL, ".csv"):
        write_json(out, result)
        return
    found = ModesFile.model_validate(result)
    with removed_unless_finished(out):
        if kind == ".csv":
            write_table(out, found)
            return
        written = write_modes(out, found, geometry, unit)
    lines = len(found.modes or ()) - written
    if lines:
        note(f"{plural(lines, 'line')} of machines, which are no modes, left out of {out}.")
