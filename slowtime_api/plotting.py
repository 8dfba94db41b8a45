"""Figures of the Python interface, by matplotlib."""

from pathlib import Path
from typing import Any

from .optional import optional

Figure = Any
"""A `matplotlib.figure.Figure`; matplotlib is an extra."""


def new_figure(panels: int) -> tuple[Figure, list[Any]]:
    """Make a figure with panels below each other.

    Parameters
    ----------
    panels
        Number of panels.

    Returns
    -------
    Figure and its axes, from top to bottom.
    """
    pyplot = optional("matplotlib.pyplot")
    figure, axes = pyplot.subplots(
        panels, 1, figsize=(8.0, 3.0 * panels), layout="constrained", squeeze=False
    )
    return figure, list(axes[:, 0])


def save(figure: Figure, path: str | Path | None) -> Figure:
    """Write a figure where a path is given, and return it.

    Parameters
    ----------
    figure
        Figure.
    path
        File to write; None for none.

    Returns
    -------
    The same figure.

    Raises
    ------
    IsADirectoryError
        If the path is a folder.
    """
    if path is not None:
        if Path(path).is_dir():
            raise IsADirectoryError(
                f"{path} is a folder. Give a file, such as {path}/plot.png."
            )
        figure.savefig(Path(path), dpi=150)
    return figure
