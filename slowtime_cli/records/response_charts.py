"""Charts of measured frequency responses, their fit and coherence, for reports."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from slowtime.identification.modal_fit.assembly import ModalTest
from slowtime_services.reports import Chart, Section

from .mode_tables import Captions

MOST_PAIRS = 24
"""Pairs of output and input that are drawn at most [1]."""

MOST_POINTS = 3000
"""Points of a curve [1]; of more, every so many is drawn."""

COLOURS = ("#0b6fb8", "#b3541e", "#2f7d32", "#7a3e9d", "#8a6d00", "#00797a")


CAPTIONS = Captions(
    of="responses",
    stabilisation="Poles of rising model order, by pLSCF of the frequency responses or, in "
    "continuous records, by subspaces too, over the first of these functions; bars "
    "are one standard deviation. A mode is where poles stand above each other.",
)


def response_sections(
    found: ModalTest, outputs: Sequence[tuple[str, str]], inputs: Sequence[tuple[str, str]]
) -> list[Section]:
    """Frequency responses with their fit, and coherences, as sections of a report."""
    response = found.response
    step = max(1, len(response.frequency_hz) // MOST_POINTS)
    hz = response.frequency_hz[::step].round(6).tolist()
    curves: list[dict[str, Any]] = []
    pairs = [(o, i) for o in range(len(outputs)) for i in range(len(inputs))][:MOST_PAIRS]
    for number, (o, i) in enumerate(pairs):
        name = f"{outputs[o][0]} / {inputs[i][0]}"
        colour = COLOURS[number % len(COLOURS)]
        shown: Any = True if number < 2 else "legendonly"
        own = {"x": hz, "visible": shown, "legendgroup": name}
        measured = _decibels(response.response[::step, o, i])
        curves.append(
            {**own, "y": measured, "name": name, "mode": "markers",
             "marker": {"size": 3, "color": colour}}
        )  # fmt: skip
        if found.fitted is not None:
            fitted = _decibels(found.fitted[::step, o, i])
            curves.append(
                {**own, "y": fitted, "name": f"{name}, fit", "mode": "lines",
                 "line": {"width": 1.5, "color": colour}}
            )  # fmt: skip
    charts = [
        Chart(
            curves,
            _layout("output over input [dB]"),
            "Measured frequency responses (points) and those of the identified modes (lines).",
            "The legend switches pairs on and off.",
        )
    ]
    if np.isfinite(response.coherence).all():
        charts.append(_coherence(found, outputs, step))
    return [Section("Frequency responses", (), charts)]


def _coherence(found: ModalTest, outputs: Sequence[tuple[str, str]], step: int) -> Chart:
    hz = found.response.frequency_hz[::step].round(6).tolist()
    curves = [
        {
            "x": hz,
            "y": found.response.coherence[::step, o].round(5).tolist(),
            "name": name,
            "mode": "lines",
            "line": {"width": 1},
        }
        for o, (name, _) in enumerate(outputs)
    ]
    layout = _layout("multiple coherence")
    layout["yaxis"]["range"] = [0, 1.02]
    return Chart(
        curves,
        layout,
        f"Share of each output that the inputs explain, from {found.response.averages} "
        "averages.",
    )


def _decibels(values: np.ndarray[Any, Any]) -> list[float]:
    size = np.maximum(np.abs(values), 1e-300)
    return [float(value) for value in (20 * np.log10(size)).round(3)]


def _layout(title: str) -> dict[str, Any]:
    return {
        "xaxis": {"title": {"text": "frequency [Hz]"}},
        "yaxis": {"title": {"text": title}},
    }
