"""The verb `fmu`: a model as a unit that other simulation programs run."""

from collections.abc import Sequence
from pathlib import Path

import click

from slowtime_cli.shared.terminal import note, plural, removed_unless_finished
from slowtime_services.functional_mockup import write_fmu
from slowtime_services.functional_mockup.co_simulated_model import UnitVariable
from slowtime_services.matrices import read_any_description


def fmu(model: Path, out: Path, step_s: float) -> None:
    """Read a model of either version, and write the unit."""
    description = read_any_description(model, note=note)
    with removed_unless_finished(out):
        found = write_fmu(description, out, step_s=step_s)
    click.echo(
        f"{out}: {plural(len(found.inputs), 'input')}, {plural(len(found.outputs), 'output')}, "
        f"{plural(len(found.parameters), 'parameter')}"
    )
    for title, variables in (
        ("inputs", found.inputs),
        ("outputs", found.outputs),
        ("parameters", found.parameters),
    ):
        _list(title, variables)
    note("The Python of the program that runs the unit must be able to import slowtime.")


def _list(title: str, variables: Sequence[UnitVariable]) -> None:
    if variables:
        click.echo(f"{title}: " + ", ".join(f"{one.name} [{one.unit}]" for one in variables))
