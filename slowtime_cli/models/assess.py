"""The verb `assess`: members that have lost stiffness between two sets of modes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from slowtime.evolution.assessment import AssessmentSettings, plan_limits
from slowtime.evolution.assessment import assess as assess_states
from slowtime.evolution.structures import updatable_model
from slowtime_cli.shared.terminal import note, show
from slowtime_services.assessment import (
    Members,
    StateErrors,
    assessment_entry,
    limit_entries,
    members_of,
    planned_state,
    read_state,
    read_states,
)
from slowtime_services.matrices import MatrixModel, read_matrix_model
from slowtime_services.matrices.measured_files import read_modes_file
from slowtime_services.reports import Table

from .assessment_report import write_assessment

MEMBER_HEADINGS = ("set", "member", "kind", "probability", "loss [%]", "sd [%]")
MODE_HEADINGS = ("mode", "before [Hz]", "now [Hz]", "change [%]", "MAC")
LIMIT_HEADINGS = ("member", "kind", "smallest loss found [%]", "not told apart from")
SETTINGS = ("model_error", "temperature_sd", "false_alarm", "most")


def assess(model: Path, **given: Any) -> None:
    """Read, assess the two states or plan, and print."""
    read = read_matrix_model(model)
    members = members_of(read, ends=given["ends"])
    settings = AssessmentSettings(**{name: given[name] for name in SETTINGS})
    errors = StateErrors(given["frequency_error"], given["shape_error"])
    if given["now"] is None:
        _plan(read, members, settings, errors, given)
    else:
        _assess(read, members, settings, errors, given)


def _assess(
    read: MatrixModel,
    members: Members,
    settings: AssessmentSettings,
    errors: StateErrors,
    given: Mapping[str, Any],
) -> None:
    files = read_modes_file(given["before"]), read_modes_file(given["now"])
    before, now = read_states(read, *files, errors)
    structure = updatable_model(members.matrices, len(before.frequency_hz))
    found = assess_states(structure, before, now, settings)
    body = assessment_entry(found, members.kinds)
    body["modes"] = [
        one
        | {
            "before_hz": float(before.frequency_hz[one["before"]]),
            "now_hz": float(now.frequency_hz[one["now"]]),
        }
        for one in body["modes"]
    ]
    rows, modes = _member_rows(body["sets"]), _mode_rows(body["modes"])
    if given["report"] is not None:
        tables = (Table(MEMBER_HEADINGS, rows), Table(MODE_HEADINGS, modes))
        write_assessment(given["report"], read, body, tables)
    if given["as_json"]:
        click.echo(json.dumps(body, indent=2))
        return
    if rows:
        plain = [{"set": k + 1} | one for k, some in enumerate(body["sets"]) for one in some]
        show("Members", MEMBER_HEADINGS, rows, plain=plain)
    show("Modes in both states", MODE_HEADINGS, modes, plain=body["modes"])
    note(found.sentence)
    if body["common_change"]["sd"] is not None:
        value, sd = found.common_change
        note(f"Common change of all stiffness: {100 * value:+.1f} ± {100 * sd:.1f} %.")


def _plan(
    read: MatrixModel,
    members: Members,
    settings: AssessmentSettings,
    errors: StateErrors,
    given: Mapping[str, Any],
) -> None:
    file = None if given["before"] is None else read_modes_file(given["before"])
    count = given["modes"] if file is None else len(file.modes or ())
    structure = updatable_model(members.matrices, count)
    if file is None:
        expected = planned_state(
            read,
            structure,
            count,
            frequency_sd=given["frequency_sd"],
            shape_sd=given["shape_sd"],
        )
    else:
        expected = read_state(read, file, errors)
    limits = plan_limits(structure, expected, settings, power=given["power"])
    entries = limit_entries(limits, members.kinds)
    body = {"power": given["power"], "false_alarm": settings.false_alarm, "limits": entries}
    if given["as_json"]:
        click.echo(json.dumps(body, indent=2))
        return
    rows = [
        (
            one["name"],
            one["kind"],
            "none" if one["loss"] is None else f"{100 * one['loss']:.1f}",
            ", ".join(one["alike"]),
        )
        for one in entries
    ]
    plain = [one | {"alike": ", ".join(one["alike"])} for one in entries]
    show("Smallest losses", LIMIT_HEADINGS, rows, plain=plain)
    note(
        f"These losses are found with {given['power']:.0%} probability, at "
        f"{settings.false_alarm:.0%} false alarms in {len(expected.frequency_hz)} modes."
    )


def _member_rows(sets: Sequence[Sequence[Mapping[str, Any]]]) -> list[tuple[str, ...]]:
    return [
        (
            str(number),
            one["name"],
            one["kind"],
            f"{one['probability']:.2f}",
            f"{100 * one['loss']:.1f}",
            f"{100 * one['sd']:.1f}",
        )
        for number, some in enumerate(sets, start=1)
        for one in some
    ]


def _mode_rows(modes: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    return [
        (
            str(one["before"] + 1),
            f"{one['before_hz']:.5g}",
            f"{one['now_hz']:.5g}",
            f"{100 * (one['now_hz'] / one['before_hz'] - 1):+.2f}",
            "" if one["mac"] is None else f"{one['mac']:.3f}",
        )
        for one in modes
    ]
