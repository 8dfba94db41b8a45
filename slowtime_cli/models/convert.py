"""The verb `convert`: a mesh of Nastran, Abaqus or CalculiX as a model file with a frame."""

from pathlib import Path

import click

from slowtime_cli.shared.terminal import note
from slowtime_services.matrices.meshes import convert_mesh, frame_text


def convert(mesh: Path, out: Path, unit: str, parameters: bool) -> None:
    """Read, convert and write."""
    found = convert_mesh(mesh, unit=unit, parameters=parameters)
    frame = found.file.frame
    assert frame is not None
    out.write_text(frame_text(found.file), encoding="utf-8")
    for text in found.notes:
        note(text)
    click.echo(
        f"{out}: {len(frame.nodes)} nodes, {len(frame.elements)} elements, "
        f"{len(frame.masses)} masses, {len(frame.supports)} supports"
    )
