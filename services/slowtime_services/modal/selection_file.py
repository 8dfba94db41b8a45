"""Files of a person's choice of modes: read, and written beside reports."""

import pathlib
from collections.abc import Sequence

from slowtime.identification.modes import Mode
from slowtime.identification.options import Action, Edit, Selection
from slowtime_schemas.files.selection import SelectionEdit, SelectionFile

ENDING = ".selection.yaml"
"""Ending of the file beside a report."""

HOW = """\
# Modes of {name}. Add edits below, then give this file to: slowtime identify ... --select FILE
# With automatic: false, only modes that are kept, merged or split below are reported.
"""

EXAMPLES = """\
# Frequencies [Hz] and orders are those of the stabilisation diagram; order may be left out.
# - drop: 4.18
# - keep: 6.51
#   order: 24
# - merge: [3.64, 3.67]
# - split: 5.36
#   into: [5.33, 5.39]
"""


class SelectionFileError(ValueError):
    """A file of chosen modes that cannot be used; the text names line and cure."""


def read_selection(path: pathlib.Path) -> Selection:
    """Read a person's choice of modes.

    Parameters
    ----------
    path
        YAML or JSON that begins with ``slowtime_selection: 1``.

    Returns
    -------
    The edits.

    Raises
    ------
    SelectionFileError
        Where the file is none; OSError where it cannot be opened.
    """
    # Here, as identification without such a file needs no library that reads YAML.
    from slowtime_services.problem_files.checked_file import parse_checked, read_text

    text = read_text(path, SelectionFileError)
    found, _ = parse_checked(text, path.name, SelectionFile, "selection", SelectionFileError)
    return Selection(
        edits=tuple(_edit(one) for one in found.edits or ()), automatic=found.automatic
    )


def selection_text(name: str, selection: Selection | None, modes: Sequence[Mode]) -> str:
    """Text of the file of the choice that led to some modes; edits are added at its end.

    Parameters
    ----------
    name
        Of the record.
    selection
        Edits so far; None for the automatic choice.
    modes
        Modes that were found, as comments.
    """
    chosen = selection or Selection()
    lines = ["slowtime_selection: 1", f"automatic: {str(chosen.automatic).lower()}"]
    lines += ["edits:", *EXAMPLES.splitlines()]
    for edit in chosen.edits:
        many = edit.action == "merge"
        at = f"[{', '.join(map(repr, edit.at_hz))}]" if many else repr(edit.at_hz[0])
        lines.append(f"- {edit.action}: {at}")
        if edit.into_hz:
            lines.append(f"  into: [{', '.join(map(repr, edit.into_hz))}]")
        if edit.order is not None:
            lines.append(f"  order: {edit.order}")
    lines.append("# Modes of this choice: frequency [Hz], damping [%], quality, flags")
    for mode in modes:
        flags = " ".join([mode.kind, *mode.flags])
        lines.append(
            f"#   {mode.frequency_hz.value:<10.5g} {100 * mode.damping_ratio.value:<8.3f} "
            f"{mode.quality:.2f}  {flags}"
        )
    return HOW.format(name=name.replace("\n", " ")) + "\n".join(lines) + "\n"


def _edit(one: SelectionEdit) -> Edit:
    named: dict[Action, tuple[float, ...] | None] = {
        "keep": None if one.keep is None else (one.keep,),
        "drop": None if one.drop is None else (one.drop,),
        "merge": one.merge,
        "split": None if one.split is None else (one.split,),
    }
    action, at_hz = next((name, at) for name, at in named.items() if at is not None)
    return Edit(action=action, at_hz=at_hz, into_hz=one.into or (), order=one.order)
