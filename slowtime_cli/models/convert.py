"""The verb `convert`: a mesh of Nastran, Abaqus or CalculiX as a model file with a frame."""

from pathlib import Path
from typing import Literal

import click

from slowtime_api.finite_elements.conversion import convert as convert_mesh
from slowtime_cli.shared.terminal import note


def convert(mesh: Path, out: Path, unit: Literal["m", "mm", "in"], parameters: bool) -> None:
    """Read, convert and write."""
    found = convert_mesh(mesh, unit=unit, parameters=parameters)
    found.save(out)
    for text in found.notes:
        note(text)
    frame = found.frame
    click.echo(
        f"{out}: {len(frame.nodes)} nodes, {len(frame.elements)} elements, "
        f"{len(frame.masses)} masses, {len(frame.supports)} supports"
    )
