"""Charts of a diagnosis."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.diagnosis import Diagnosis, Surface, Traces
from slowtime.dynamics.description import Sensor
from slowtime_schemas.files.diagnosis import DiagnosisFile
from slowtime_services.reports import Chart

from .labels import named, placed, rounded

MEASURED, NOMINAL, REFITTED, AUGMENTED = "#5b6770", "#b3541e", "#c99a2e", "#0b6fb8"
WINDOW_SAMPLES = 1200
"""Samples of a record that are shown where each is to be seen [1]."""
PICTURE_SAMPLES = 240
"""Samples of the one picture of the first page [1]: some periods, each to be seen in print."""
ENVELOPE_BINS = 600
"""Bins of a whole record, each drawn from its lowest to its highest sample [1]."""
FORCE_POINTS = 1500
"""Points of a recovered force that are drawn [1]."""
MAX_SENSORS = 6
"""Sensors whose runs are drawn [1]."""

Series = Float[np.ndarray, " time"]
Plain = dict[str, Any]


def gap_chart(document: DiagnosisFile) -> Chart:
    """Bars of the free-run error: as given, refitted, with each effect, adopted, the floor."""
    gap = document.gap
    names = ["as given", "refitted", *(f"with {named(s.effect)}" for s in gap.steps)]
    values = [gap.nominal, gap.refitted_nominal, *(s.nrmse for s in gap.steps)]
    colours = [NOMINAL, REFITTED, *[AUGMENTED] * len(gap.steps)]
    if gap.adopts_another:
        names.append("corrected model")
        values.append(gap.augmented)
        colours.append(AUGMENTED)
    shown = [100 * min(value, 1e4) for value in [*values, gap.noise_floor]]
    bars: Plain = {
        "type": "bar",
        "x": _distinct([*names, "noise alone"]),
        "y": shown,
        "text": [f"{value:.3g} %" for value in shown],
        "textposition": "outside",
        "cliponaxis": False,
        "marker": {"color": [*colours, MEASURED]},
    }
    wide = max(shown) > 50 * max(min(shown), 1e-9)
    judged = "records that were held out" if gap.on == "holdout" else "the last third"
    return Chart(
        [bars],
        {
            "xaxis": {"type": "category"},
            "yaxis": {
                "title": {"text": "error of the free run [%]"},
                "type": "log" if wide else "linear",
            },
        },
        f"Error of the free run on {judged}, over the standard deviation of the "
        "measured signal, averaged over sensors. Nothing better than the noise alone is "
        "possible.",
    )


def run_charts(diagnosis: Diagnosis, samples: int = WINDOW_SAMPLES) -> list[Chart]:
    """Measured against both models, around the largest motion of the first record."""
    if not diagnosis.traces or diagnosis.traces[0].of_force:
        return []
    traces = diagnosis.traces[0]
    charts = []
    for i, sensor in enumerate(diagnosis.nominal.sensors[:MAX_SENSORS]):
        part = _loudest(traces.measured[:, i], samples)
        lines = [
            _line(traces.times_s[part], traces.measured[part, i], "measured", MEASURED, 2.5),
            _line(traces.times_s[part], traces.nominal[part, i], "original model", NOMINAL),
            _line(
                traces.times_s[part], traces.augmented[part, i], "corrected model", AUGMENTED
            ),
        ]
        charts.append(
            Chart(
                lines,
                _axes("campaign time [s]", f"{sensor.channel} [{sensor.unit}]"),
                f"{_sensor_label(sensor)}, {np.ptp(traces.times_s[part]):.3g} s around its "
                "largest motion, measured and simulated. Each model ran free from the first "
                "samples on.",
            )
        )
    return charts


def residual_charts(diagnosis: Diagnosis) -> list[Chart]:
    """Draw the residual without and with the effects, in time and in frequency."""
    charts = []
    spectra = diagnosis.spectra
    for i, sensor in enumerate(diagnosis.nominal.sensors[:MAX_SENSORS]):
        if diagnosis.traces and not diagnosis.traces[0].of_force:
            charts.append(_left_in_time(diagnosis.traces[0], i, sensor))
        kept = spectra.frequency_hz > 0
        lines = [
            _line(spectra.frequency_hz[kept], _decibels(values[kept, i]), name, colour, width)
            for name, values, colour, width in (
                ("measured", spectra.measured, MEASURED, 1.0),
                ("left by the refitted model", spectra.before, REFITTED, 1.5),
                ("left by the corrected model", spectra.after, AUGMENTED, 1.5),
                ("noise", spectra.noise, "#7b2fa0", 1.5),
            )
        ]
        charts.append(
            Chart(
                lines,
                _axes("frequency [Hz]", f"{sensor.channel} [dB re ({sensor.unit})²/Hz]"),
                f"Density of {sensor.channel}, and of what the models leave of it: the noise, "
                "where nothing is missing any more.",
            )
        )
    return charts


def surface_chart(surface: Surface, law: str | None, coordinate: str) -> Chart:
    """Draw the force that was missing over the motion there, with the law if there is one."""
    stride = max(len(surface.force) // FORCE_POINTS, 1)
    e, v, force = surface.e[::stride], surface.v[::stride], surface.force[::stride]
    traces: list[Plain] = []
    for axis, motion in (("", e), ("2", v)):
        where: Plain = {"xaxis": f"x{axis}", "yaxis": f"y{axis}", "showlegend": not axis}
        traces.append(_cloud(motion, force, "as recovered", MEASURED, 3) | where)
        if surface.law is not None:
            named_law = law or "law"
            traces.append(
                _cloud(motion, surface.law[::stride], named_law, AUGMENTED, 4) | where
            )
    unit = "N m" if coordinate == "rad" else "N"
    title = {"title": {"text": f"force [{unit}]"}}
    motion_there = "elongation" if surface.place.kind == "element" else "displacement"
    layout = {
        "xaxis": {"title": {"text": f"{motion_there} [{coordinate}]"}, "domain": [0, 0.46]},
        "yaxis": title,
        "xaxis2": {
            "title": {"text": f"its rate [{coordinate}/s]"},
            "domain": [0.54, 1],
            "anchor": "y2",
        },
        "yaxis2": {"anchor": "x2"},
    }
    place = placed(surface.place.kind, surface.place.id)
    drawn = f" Blue: {law} at the same instants." if surface.law is not None and law else ""
    return Chart(
        traces,
        layout,
        f"Force that the refitted model lacks at {place}, as recovered from the sensors before "
        f"any effect was in, over the motion there.{drawn}",
    )


def _left_in_time(traces: Traces, i: int, sensor: Sensor) -> Chart:
    lines = []
    for name, run, colour in (
        ("refitted model", traces.refitted, REFITTED),
        ("corrected model", traces.augmented, AUGMENTED),
    ):
        times, left = _envelope(traces.times_s, traces.measured[:, i] - run[:, i])
        lines.append(_line(times, left, f"left by the {name}", colour))
    return Chart(
        lines,
        _axes("campaign time [s]", f"{sensor.channel} [{sensor.unit}]"),
        f"Measured {sensor.channel} minus the free run, over the whole record.",
    )


def _envelope(times: Series, values: Series) -> tuple[Series, Series]:
    """Thin a series, so that no extreme is lost: lowest and highest sample of each bin."""
    values = np.where(np.isfinite(values), values, np.nan)
    if len(values) <= 2 * ENVELOPE_BINS:
        return times, values
    size = len(values) // ENVELOPE_BINS
    cut = values[: size * ENVELOPE_BINS].reshape(ENVELOPE_BINS, size)
    safe = np.nan_to_num(cut, nan=0.0)
    both = np.sort(np.stack([safe.argmin(axis=1), safe.argmax(axis=1)], axis=1), axis=1)
    rows = (np.arange(ENVELOPE_BINS)[:, None] * size + both).ravel()
    return times[rows], values[rows]


def _loudest(values: Series, samples: int) -> slice:
    """Rows about the largest sample."""
    size = np.nan_to_num(np.abs(values - np.nanmean(values)), nan=0.0)
    first = int(np.clip(np.argmax(size) - samples // 3, 0, max(len(values) - samples, 0)))
    return slice(first, first + samples)


def _sensor_label(sensor: Sensor) -> str:
    return f"{sensor.quantity.capitalize()} of {sensor.node} ({sensor.channel})"


def _decibels(power: Series) -> Series:
    return np.asarray(10 * np.log10(np.maximum(power, 1e-300)))


def _line(x: Series, y: Series, name: str, colour: str, width: float = 1.5) -> Plain:
    return {
        "x": rounded(x),
        "y": rounded(y),
        "name": name,
        "mode": "lines",
        "line": {"color": colour, "width": width},
    }


def _cloud(x: Series, y: Series, name: str, colour: str, size: float) -> Plain:
    return {
        "x": rounded(x),
        "y": rounded(y),
        "name": name,
        "mode": "markers",
        "marker": {"color": colour, "size": size, "opacity": 0.6},
    }


def _axes(x: str, y: str) -> Mapping[str, Any]:
    return {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}}


def _distinct(names: Sequence[str]) -> list[str]:
    """Names of which no two are alike: bars of one name would stand in each other."""
    return [
        name if names.count(name) == 1 else f"{name} ({names[: i + 1].count(name)})"
        for i, name in enumerate(names)
    ]
