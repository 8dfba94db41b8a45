"""Tables, JSON and reports of the modes of many channels."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Complex

from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.identification.automatic.estimation import MOST_DAMPING
from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.mode_shapes.criteria import mac, mpc
from slowtime.identification.modes import Mode
from slowtime.identification.options import Selection
from slowtime.identification.subspace.stabilisation import Stabilisation
from slowtime_cli.shared.report_flags import report_language, report_subject
from slowtime_cli.shared.terminal import show
from slowtime_services.modal import ENDING, read_modes, selection_text
from slowtime_services.modal.entries import mode_entry
from slowtime_services.reports import Chart, PoleChoice, Section, Table, Words, write_page
from slowtime_services.reports.kinds.mode_doubts import doubts_of
from slowtime_services.reports.kinds.modes import Compared, modes_page

from .mac_charts import mac_charts

ModelMode = tuple[float, Complex[np.ndarray, " channel"] | None]
"""Natural frequency [Hz], and the shape at the record's channels where all are in the model."""

COLUMNS = ("frequency [Hz]", "damping [%]", "kind", "collinearity", "quality", "mistrust")
COLUMNS_TOLD = (
    "± is one standard deviation. Collinearity is 1 for a shape whose points move in phase. "
    "Quality is the share of the model orders that could have shown the mode and did. Mistrust "
    "says why a mode is doubtful; it is empty for modes that can be used."
)
LINES_TOLD = "± is one standard deviation. Near a line, a mode cannot be told from it."
MAX_SHAPES = 12
"""Shapes that a report draws at most [1]."""
BINS_PER_DECADE = 250
"""Bins of a decade in which one pole of an order is drawn [1]: about a pixel each."""


@dataclasses.dataclass(frozen=True, slots=True)
class Captions:
    """What the charts of a report say of themselves.

    `of` names in the catalogue what the spectra are of: ambient records or responses.
    """

    of: Literal["ambient", "responses"] = "ambient"
    stabilisation: str = (
        "Poles of subspace models of rising order, each band by itself, over the first "
        "singular value; bars are one standard deviation. A mode is where poles stand above "
        "each other."
    )


AMBIENT = Captions()
"""Of records without measured inputs."""


def model_modes(description: Description, channels: Sequence[str]) -> list[ModelMode]:
    """Modes of a model, undamped, at the channels of a record."""
    structure = assemble(description)
    modes = undamped_modes(structure)
    nodes = {sensor.channel: sensor.node for sensor in description.sensors}
    places = [nodes.get(channel) for channel in channels]
    known = all(place in structure.names for place in places)
    rows = [structure.names.index(place) for place in places if place in structure.names]
    shapes = modes.shapes[rows].astype(complex) if known else None
    return [
        (float(hz), None if shapes is None else shapes[:, number])
        for number, hz in enumerate(modes.frequency_hz)
    ]


def read_model_modes(path: Path, channels: Sequence[str]) -> list[ModelMode]:
    """Modes of a universal file, at the channels of a record."""
    found = read_modes(path)
    shapes = found.at(tuple(channels))
    return [
        (mode.frequency_hz, None if shapes is None else shapes[row])
        for row, mode in enumerate(found.modes)
    ]


def nearest_mode(mode: Mode, models: Sequence[ModelMode]) -> tuple[int, float | None] | None:
    """Which mode of a model is meant: the one most alike in shape, else in frequency; its MAC.

    None for the line of a machine, and where nothing is within a factor of two.
    """
    if mode.kind != "structural":
        return None
    near = [k for k, (hz, _) in enumerate(models) if 0.5 < hz / mode.frequency_hz.value < 2.0]
    if not near:
        return None
    alike = {k: mac(mode.shape, shape) for k in near if (shape := models[k][1]) is not None}
    if alike and len(mode.shape) > 1:
        best = max(alike, key=lambda k: alike[k])
        return best, alike[best]
    away = [abs(np.log(models[k][0] / mode.frequency_hz.value)) for k in near]
    return near[int(np.argmin(away))], None


def as_json(
    mode: Mode, models: Sequence[ModelMode], span_s: tuple[float, float], *, method: str
) -> dict[str, Any]:
    """One mode of `modes.json`; a damping that was not sought is 0 and flagged `no_damping`."""
    body = mode_entry(
        mode.frequency_hz, mode.damping_ratio, mode.correlation, kind=mode.kind,
        method=method, span_s=span_s, flags=mode.flags, shape=(mode.shape, mode.shape_sd),
        quality=mode.quality,
    )  # fmt: skip
    meant = nearest_mode(mode, models)
    if meant is not None:
        number, alike = meant
        hz = models[number][0]
        body["model"] = {
            "mode": number + 1,
            "frequency_hz": hz,
            "difference": mode.frequency_hz.value / hz - 1.0,
            "mac": alike,
        }
    return body


def _damped(mode: Mode) -> bool:
    return bool(np.isfinite(mode.damping_ratio.value))


def _cells(mode: Mode) -> tuple[str, ...]:
    f, z = mode.frequency_hz, mode.damping_ratio
    damped = mode.kind == "structural" and _damped(mode)
    return (
        f"{f.value:.4f} ± {f.sd:.4f}",
        f"{100 * z.value:.3f} ± {100 * z.sd:.3f}" if damped else "",
        mode.kind,
        f"{mpc(mode.shape):.2f}" if len(mode.shape) > 1 else "",
        f"{mode.quality:.2f}",
        ", ".join(mode.flags),
    )


def _against_model(mode: Mode, models: Sequence[ModelMode]) -> tuple[str, ...]:
    meant = nearest_mode(mode, models)
    if meant is None:
        return "", "", ""
    number, alike = meant
    hz = models[number][0]
    return (
        f"{hz:.4f}",
        f"{100 * (mode.frequency_hz.value / hz - 1):+.2f}",
        "" if alike is None else f"{alike:.2f}",
    )


def _table(modes: Sequence[Mode], models: Sequence[ModelMode]) -> Table:
    headings, rows = list(COLUMNS), [list(_cells(mode)) for mode in modes]
    if models:
        headings += ["model [Hz]", "difference [%]", "MAC"]
        rows = [
            [*row, *_against_model(mode, models)] for row, mode in zip(rows, modes, strict=True)
        ]
    return Table(headings, rows)


def mode_table(result: ModalResult, models: Sequence[ModelMode], words: Words) -> Table:
    """Give the modes of a report, each with the reasons that its first page doubts it for."""
    table = _table(result.structural, models)
    place, kind = COLUMNS.index("mistrust"), COLUMNS.index("kind")
    rows = [
        [*row[:place], ", ".join(doubt.told for doubt in doubts), *row[place + 1 :]]
        for row, doubts in zip(table.rows, doubts_of(result, words), strict=True)
    ]
    rows = [[*row[:kind], *row[kind + 1 :]] for row in rows]
    headings = [heading for heading in table.headings if heading != "kind"]
    return Table(headings, rows, COLUMNS_TOLD)


def line_sections(result: ModalResult) -> Iterator[Section]:
    """Give the lines of machines a section of their own, where there are any."""
    lines = [_cells(mode) for mode in result.modes if mode.kind != "structural"]
    if lines:
        table = Table(COLUMNS[:1], [cells[:1] for cells in lines], LINES_TOLD)
        yield Section("Lines of machines", (), [table])


def show_modes(
    result: ModalResult, models: Sequence[ModelMode], title: str, *, method: str
) -> None:
    """Print a table for a person, lines of fields for a program."""
    if not result.modes:
        return
    table = _table(result.modes, models)
    plain = []
    for mode in result.modes:
        f, z = mode.frequency_hz, mode.damping_ratio
        plain.append(
            {
                "frequency_hz": f.value,
                "frequency_sd": f.sd,
                "damping_ratio": z.value if _damped(mode) else None,
                "damping_sd": z.sd if _damped(mode) else None,
                "snr_db": None,
                "method": method,
                "kind": mode.kind,
                "quality": mode.quality,
                "flags": ",".join(mode.flags),
            }
        )
    show(title, table.headings, table.rows, plain=plain)


def write_report(
    path: Path,
    name: str,
    channels: Sequence[str],
    result: ModalResult,
    models: Sequence[ModelMode],
    *,
    shapes: bool = True,
    extra: Sequence[Section] = (),
    captions: Captions = AMBIENT,
    selection: Selection | None = None,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Write table, `extra` sections, spectra, stabilisation diagram and shapes as one page.

    `about` holds rate, duration, start, structure and sketch, as `modes_page` takes them.

    Beside a page with a stabilisation diagram stands the file of the choice of modes.
    """
    structural = len(result.structural)
    language = report_language()
    words = Words(language)
    told = dict(about or {})
    told["structure"] = report_subject() or told.get("structure", "")
    meant = [(mode, nearest_mode(mode, models)) for mode in result.structural]
    told["compared"] = [
        Compared(mode.frequency_hz, models[one[0]][0], one[1]) for mode, one in meant if one
    ]
    first = modes_page(name, result, channels, words, **told)
    spectra = _spectra(result, _spectra_caption(result, captions, words), words)
    sections = [
        Section("Modes", result.notes, [mode_table(result, models, words)]),
        *line_sections(result),
        *extra,
    ]
    if len(result.stabilisation.order):
        chart = _stabilisation(result, captions.stabilisation)
        file = path.with_suffix(ENDING)
        text = selection_text(name, selection, result.modes)
        file.write_text(text, encoding="utf-8")
        sections.append(Section("Stabilisation", (), [PoleChoice(chart, ENDING, text)]))
    if len(channels) > 1 and structural and shapes:
        drawn = [_shapes(result, channels)]
        sections.append(Section("Shapes", (), [*drawn, *mac_charts(result, models)]))
    write_page(
        path, f"{words('kind.modes')}: {first.subject}", first.answer, sections,
        first=first, picture=spectra, heading="Spectra", language=language,
    )  # fmt: skip


def _spectra_caption(result: ModalResult, captions: Captions, words: Words) -> str:
    """Explain the lines of the spectra; those of machines only where one is drawn."""
    told = words(f"modes.picture_{captions.of}")
    if all(mode.kind == "structural" for mode in result.modes):
        return told
    return f"{told} {words('modes.picture_lines')}"


def _range(result: ModalResult) -> list[float]:
    """Range from zero to well beyond the highest mode; the reader may zoom out."""
    highest = float(result.spectrum_hz[-1])
    if result.modes:
        highest = min(highest, 1.4 * result.modes[-1].frequency_hz.value)
    return [0.0, highest]


def _spectra(result: ModalResult, caption: str, words: Words | None = None) -> Chart:
    words = words or Words()
    inside = result.spectrum_hz > 0
    traces: list[dict[str, Any]] = [
        {
            "x": result.spectrum_hz[inside].round(6).tolist(),
            "y": (10 * np.log10(np.maximum(values, 1e-300))).round(3).tolist(),
            "name": words("modes.singular_value", n=number + 1),
            "mode": "lines",
            "line": {"width": 1.5},
        }
        for number, values in enumerate(result.singular_values[inside].T[:4])
    ]
    return Chart(
        traces,
        {
            "xaxis": {
                "title": {"text": words("modes.axis_frequency")},
                "range": _range(result),
            },
            "yaxis": {"title": {"text": words("modes.axis_density")}},
            "shapes": [_mark(mode) for mode in result.modes],
        },
        caption,
    )


def _mark(mode: Mode) -> dict[str, Any]:
    hz = mode.frequency_hz.value
    dash = "solid" if mode.kind == "structural" else "dash"
    line = {"width": 1, "dash": dash, "color": "#b3541e"}
    return {"type": "line", "x0": hz, "x1": hz, "y0": 0, "y1": 1, "yref": "paper", "line": line}


def _stabilisation(result: ModalResult, caption: str) -> Chart:
    poles = result.stabilisation
    finite = np.isfinite(poles.frequency_hz) & (poles.damping_ratio > 0)
    modes_hz = np.array([mode.frequency_hz.value for mode in result.modes]).round(6)
    # On an axis of its own, whose range is that of what it shows; a click means a pole.
    ground = {"yaxis": "y2", "line": {"width": 1, "color": "#d9b48f"}, "hoverinfo": "skip"}
    traces = [{**trace, **ground} for trace in _spectra(result, "").data[:1]]
    for belongs, name, colour in ((False, "other pole", "#9aa5ad"), (True, "mode", "#0b6fb8")):
        chosen = finite & ((poles.mode >= 0) == belongs)
        if not belongs:
            chosen &= _other_drawn_poles(poles)
        sd = np.nan_to_num(poles.frequency_sd_hz[chosen], posinf=0.0)
        bars = {"type": "data", "array": sd.round(6).tolist(), "thickness": 1, "width": 0}
        traces.append(
            {
                "x": poles.frequency_hz[chosen].round(6).tolist(),
                "y": poles.order[chosen].tolist(),
                "error_x": bars if belongs else None,
                # All poles of a mode stand for it.
                "customdata": modes_hz[poles.mode[chosen]].tolist() if belongs else None,
                "name": name,
                "meta": name,  # for the choice of poles, whatever the language
                "mode": "markers",
                "marker": {"size": 5, "color": colour, "symbol": "cross" if belongs else "dot"},
            }
        )
    return Chart(
        traces,
        {
            "xaxis": {
                "title": {"text": "frequency [Hz]"},
                "type": "log",
                "range": _decades(result),
            },
            "yaxis": {"title": {"text": "model order"}},
            "margin": {"t": 24, "r": 64},  # room for the axis on the right
            "yaxis2": {
                "title": {"text": "density [dB]"},
                "overlaying": "y",
                "side": "right",
                "showgrid": False,
            },
        },
        caption,
    )


def _other_drawn_poles(poles: Stabilisation) -> Bool[np.ndarray, " pole"]:
    """Which other poles are drawn: damped like a mode, and one a place and order.

    Bands are half an octave wide, and each has as many poles as any other: on a linear axis
    low frequencies are a solid grey.
    """
    sound = np.isfinite(poles.frequency_hz) & (poles.frequency_hz > 0)
    sound &= (poles.damping_ratio > 0) & (poles.damping_ratio < MOST_DAMPING)
    sound &= poles.mode < 0
    place = np.full(len(sound), -1)
    place[sound] = np.floor(BINS_PER_DECADE * np.log10(poles.frequency_hz[sound]))
    drawn = np.zeros(len(sound), dtype=bool)
    kept = np.unique(np.stack([place, poles.order])[:, sound], axis=1, return_index=True)[1]
    drawn[np.flatnonzero(sound)[kept]] = True
    return drawn


def _decades(result: ModalResult) -> list[float]:
    """Decimal logarithms from below the lowest mode to beyond the highest."""
    lowest = float(result.spectrum_hz[result.spectrum_hz > 0][0])
    if result.modes:
        lowest = max(lowest, 0.5 * result.modes[0].frequency_hz.value)
    return [float(np.log10(lowest)), float(np.log10(_range(result)[1]))]


def _shapes(result: ModalResult, channels: Sequence[str]) -> Chart:
    traces = [
        {
            "x": list(channels),
            "y": mode.shape.real.round(5).tolist(),
            "error_y": {"type": "data", "array": mode.shape_sd.round(5).tolist()},
            "name": f"{mode.frequency_hz.value:.4g} Hz",
            "mode": "lines+markers",
            "visible": True if number < 3 else "legendonly",
        }
        for number, mode in enumerate(result.structural[:MAX_SHAPES])
    ]
    return Chart(
        traces,
        {
            "xaxis": {"title": {"text": "channel"}, "type": "category"},
            "yaxis": {"title": {"text": "real part, unit norm"}},
        },
        "Real parts of the mode shapes, in the units of the channels; bars are one standard "
        "deviation.",
        "The legend switches modes on and off.",
    )
