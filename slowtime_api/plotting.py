"""Figures of the Python interface, by matplotlib."""

from pathlib import Path
from typing import Any

from .optional import optional

Axes = Any
"""A `matplotlib.axes.Axes`, or a list of them; matplotlib is an extra."""


def new_figure(panels: int = 1) -> list[Axes]:
    """Make a figure with panels below each other.

    Parameters
    ----------
    panels
        Number of panels.

    Returns
    -------
    Axes of the panels, from top to bottom; ``axes[0].figure`` is the figure.
    """
    pyplot = optional("matplotlib.pyplot")
    _, axes = pyplot.subplots(
        panels, 1, figsize=(8.0, 3.0 * panels), layout="constrained", squeeze=False
    )
    return list(axes[:, 0])


def save(axes: Axes, path: str | Path | None) -> Axes:
    """Write the figure of axes where a path is given, and return the axes.

    Parameters
    ----------
    axes
        Axes, or a list of axes of one figure.
    path
        File to write; None for none.

    Returns
    -------
    The same axes.

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
        first = axes[0] if isinstance(axes, list) else axes
        first.figure.savefig(Path(path), dpi=150)
    return axes
