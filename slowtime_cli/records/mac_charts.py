"""Charts of the modal assurance criterion of shapes, for reports."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex

from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.mode_shapes.criteria import mac_matrix
from slowtime_services.reports import Chart


def mac_charts(
    result: ModalResult,
    models: Sequence[tuple[float, Complex[np.ndarray, " channel"] | None]],
) -> list[Chart]:
    """MAC of the shapes with each other, and with those of a model where it has shapes.

    Parameters
    ----------
    result
        Modes with shapes over all channels.
    models
        Frequencies [Hz] and shapes of a model.

    Returns
    -------
    No chart of a single mode.
    """
    modes = result.structural
    shapes = np.stack([mode.shape for mode in modes], axis=1)
    names = [f"{mode.frequency_hz.value:.4g} Hz" for mode in modes]
    charts = []
    if len(modes) > 1:
        charts.append(
            _chart(
                mac_matrix(shapes, shapes), names, names, "mode",
                "MAC of the shapes with each other. A large value beside the diagonal: the "
                "channels do not tell the two modes apart, or both are one.",
            )
        )  # fmt: skip
    known = [(hz, shape) for hz, shape in models if shape is not None]
    if known and modes:
        of_model = np.stack([shape for _, shape in known], axis=1)
        charts.append(
            _chart(
                mac_matrix(shapes, of_model), names, [f"{hz:.4g} Hz" for hz, _ in known],
                "mode of the model", "MAC of the shapes with those of the model.",
            )
        )  # fmt: skip
    return charts


def _chart(
    values: np.ndarray, rows: Sequence[str], columns: Sequence[str], across: str, words: str
) -> Chart:
    # Cells are numbered: two modes may have one name.
    trace: dict[str, Any] = {
        "type": "heatmap",
        "z": values.round(3).tolist(),
        "zmin": 0,
        "zmax": 1,
        "colorscale": "Blues",
        "reversescale": True,
        "text": [[f"{value:.2f}" for value in row] for row in values],
        "texttemplate": "%{text}",
        "colorbar": {"title": {"text": "MAC"}},
    }
    return Chart(
        [trace],
        {
            "xaxis": {"title": {"text": across}, **_ticks(columns)},
            "yaxis": {"title": {"text": "mode"}, "autorange": "reversed", **_ticks(rows)},
        },
        words,
    )


def _ticks(names: Sequence[str]) -> dict[str, Any]:
    return {"tickvals": list(range(len(names))), "ticktext": list(names)}
