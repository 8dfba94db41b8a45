"""Diagnosis of a history as a document, ``report.json``, and as a page, ``report.html``."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.dynamics.effects import Place
from slowtime.history_diagnosis import EffectCurve, HistoryReport, diagnose_history
from slowtime_schemas.files.slow_diagnosis import SlowDiagnosisFile
from slowtime_services.reports import Chart, Section, Table, Words, write_page

from .charts import AUGMENTED, MEASURED, NOMINAL
from .first_pages import history_page
from .history_table import TabulatedHistory
from .labels import named

_MOST_POINTS = 2_000
"""[readings] Of a chart. Source: a bound on the size of the page."""

_SCALES = {"stiffness_change": (100.0, "%"), "frequency_ratio": (100.0, "%"),
           "frequency_hz": (1.0, "Hz")}  # fmt: skip
_TITLES = {"stiffness_change": "stiffness change", "frequency_ratio": "frequency change",
           "frequency_hz": "frequency"}  # fmt: skip


def diagnose_with_document(
    history: TabulatedHistory, *, progress: Callable[[str, float], None] | None = None
) -> tuple[HistoryReport, dict[str, Any]]:
    """Diagnose a history, and return the report and its document.

    Parameters
    ----------
    history
        Of one twin or table.
    progress
        Called with the stage and the share that is done.

    Raises
    ------
    ValueError
        If there are too few epochs; the text says what to do.
    """
    began = time.monotonic()
    report = diagnose_history(
        history.time,
        history.value,
        history.sd,
        history.covariates,
        quantity=history.quantity,
        time_unit=history.time_unit,
        progress=progress,
    )
    document = history_document(
        report,
        of=history.of,
        quantity=history.quantity,
        time_unit=history.time_unit,
        seconds=time.monotonic() - began,
    )
    return report, document


def history_document(
    report: HistoryReport, *, of: str, quantity: str, time_unit: str, seconds: float
) -> dict[str, Any]:
    """Return the document of a report; parameters that are not finite are left out.

    Parameters
    ----------
    report
        Of the diagnosis.
    of
        Name of the twin or table.
    quantity, time_unit
        Of the history.
    seconds
        Time that the diagnosis took.
    """
    gap = report.gap
    document = {
        "slowtime_slow_diagnosis": 1,
        "clock": "slow",
        "of": of,
        "quantity": quantity,
        "slow_time_unit": time_unit,
        "verdict": report.verdict,
        "sentence": report.sentence,
        "effects": [_effect(effect) for effect in report.effects],
        "undecided": list(dict.fromkeys(rival.effect for rival in report.undecided)),
        "experiment": None if report.experiment is None else report.experiment.sentence,
        "nothing_probability": report.nothing_probability,
        "gap": {
            "measure": "scatter",
            "nominal": gap.nominal,
            "augmented": gap.augmented,
            "nominal_step": gap.nominal_step,
            "augmented_step": gap.augmented_step,
            "noise_floor": gap.noise_floor,
        },
        "residual_white": bool(report.residual_white),
        "white_p_value": report.white_p_value,
        "noise_factor": report.noise_factor,
        "outliers": list(report.outliers),
        "ignored_covariates": list(report.ignored),
        "readings": len(report.plot_series.time),
        "since": float(report.plot_series.time[0]),
        "until": float(report.plot_series.time[-1]),
        "seconds": seconds,
    }
    return SlowDiagnosisFile.model_validate_json(json.dumps(document)).model_dump(mode="json")


def write_history_results(
    folder: Path,
    report: HistoryReport,
    document: dict[str, Any],
    *,
    page: Path | None = None,
    structure: str = "",
    language: str = "en",
) -> None:
    """Write ``report.json`` and ``report.html``, replacing earlier ones.

    Parameters
    ----------
    folder
        Made if it does not exist.
    report, document
        Of `diagnose_with_document`.
    page
        Another file for the report, besides; .pdf or .html.
    structure
        Name of the structure; that of the history where empty.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    words = Words(language)
    first = history_page(document, words, structure=structure)
    title = f"{words('kind.diagnosis')}: {first.subject}"
    for path in (folder / "report.html", page):
        if path is not None:
            write_page(
                path, title, document["sentence"], list(_sections(report, document)),
                first=first, picture=_history(report, document),
                heading="The history, and what was expected", language=language,
            )  # fmt: skip


def covariate_of(place: Place) -> str | None:
    """Return the covariate that an effect follows; None for time and faults of sensors."""
    return place.id if place.kind == "covariate" else None


def _effect(named: NamedEffect) -> dict[str, Any]:
    return {
        "effect": named.effect.kind,
        "family": named.family,
        "covariate": covariate_of(named.effect.place),
        "parameters": {
            name: {"value": n.value, "sd": n.sd, "unit": n.unit}
            for name, n in named.numbers.items()
            if np.isfinite([n.value, n.sd]).all()
        },
        "probability": named.probability,
        "alternatives": [
            {
                "effect": rival.effect,
                "covariate": covariate_of(rival.place),
                "probability": rival.probability,
            }
            for rival in named.rivals
        ],
        "sentence": named.sentence,
    }


def parameters_text(named: NamedEffect) -> str:
    """Write the parameters of an effect in one line, for a table."""
    return ", ".join(
        f"{name} {n.value:.4g} ± {n.sd:.2g} {n.unit}".rstrip()
        for name, n in named.numbers.items()
    )


def _sections(report: HistoryReport, document: dict[str, Any]) -> Iterator[Section]:
    yield Section("The gap", [document["sentence"]], [_gap(report)])
    if report.effects:
        rows = [
            (
                named(e.effect.kind), e.family,
                covariate_of(e.effect.place) or "slow time", parameters_text(e),
                f"{e.probability:.3f}",
            )
            for e in report.effects
        ]  # fmt: skip
        headings = ("effect", "family", "follows", "parameters", "probability")
        words = [e.sentence for e in report.effects]
        yield Section("What is missing", words, [Table(headings, rows)])
    if report.experiment:
        yield Section("Experiment that would decide", [report.experiment.sentence])
    curves = [
        _curve(named(one.effect.kind), curve)
        for one, curve in zip(report.effects, report.curves, strict=True)
        if curve is not None
    ]
    if curves:
        yield Section("What each effect does", (), curves)
    rest = (
        "cannot be told from noise without memory" if report.residual_white
        else "has a memory that is not explained"
    )  # fmt: skip
    noise = f"Stated standard deviations are to be multiplied by {report.noise_factor:.3g}."
    outliers = f"{len(report.outliers)} of {document['readings']} readings were not used."
    yield Section("What is left", [f"What is left {rest}.", noise, outliers])


def _gap(report: HistoryReport) -> Chart:
    gap = report.gap
    names = ["as it was", "with the effects", "noise alone"]
    shown = [100 * value for value in (gap.nominal, gap.augmented, gap.noise_floor)]
    bars = {
        "type": "bar", "x": names, "y": shown, "text": [f"{v:.3g} %" for v in shown],
        "textposition": "outside", "cliponaxis": False,
        "marker": {"color": [NOMINAL, AUGMENTED, MEASURED]},
    }  # fmt: skip
    return Chart(
        [bars],
        {"yaxis": {"title": {"text": "scatter that is left [%]"}, "rangemode": "tozero"}},
        "Scatter of what is left of the readings, over the scatter of the readings.",
    )


def _history(report: HistoryReport, document: dict[str, Any]) -> Chart:
    series = report.plot_series
    scale, unit = _SCALES[document["quantity"]]
    step = max(1, len(series.time) // _MOST_POINTS)
    time = series.time[::step]

    def line(values: Float[np.ndarray, " time"], name: str, colour: str) -> dict[str, Any]:
        return {
            "type": "scatter", "mode": "lines", "name": name, "x": time.tolist(),
            "y": _json_numbers(scale * values[::step]), "line": {"color": colour, "width": 1.4},
        }  # fmt: skip

    read = {
        "type": "scatter", "mode": "markers", "name": "read", "x": time.tolist(),
        "y": _json_numbers(scale * series.value[::step]),
        "marker": {"color": MEASURED, "size": 4},
    }  # fmt: skip
    along = {"title": {"text": f"slow time [{document['slow_time_unit']}]"}}
    up = {"title": {"text": f"{_TITLES[document['quantity']]} [{unit}]"}}
    return Chart(
        [
            read,
            line(series.nominal, "expected as it was", NOMINAL),
            line(series.augmented, "expected with the effects", AUGMENTED),
        ],
        {"xaxis": along, "yaxis": up},
        "Readings, and what either model expected of each from all before it.",
    )


def _curve(law_name: str, curve: EffectCurve) -> Chart:
    step = max(1, len(curve.points_x) // _MOST_POINTS)
    band = {
        "type": "scatter", "mode": "lines", "name": "95 % band", "fill": "toself",
        "x": [*curve.x.tolist(), *curve.x[::-1].tolist()],
        "y": _json_numbers(np.concatenate([curve.lo, curve.hi[::-1]])),
        "line": {"width": 0}, "fillcolor": "rgba(11,111,184,0.25)",
    }  # fmt: skip
    law = {
        "type": "scatter", "mode": "lines", "name": law_name,
        "x": curve.x.tolist(), "y": _json_numbers(curve.value), "line": {"color": AUGMENTED},
    }  # fmt: skip
    points = {
        "type": "scatter", "mode": "markers", "name": "readings, all else taken away",
        "x": _json_numbers(curve.points_x[::step]), "y": _json_numbers(curve.points[::step]),
        "marker": {"color": MEASURED, "size": 3},
    }  # fmt: skip
    layout = {
        "xaxis": {"title": {"text": curve.label}},
        "yaxis": {"title": {"text": f"change [{curve.unit}]"}},
    }
    return Chart([points, band, law], layout, f"{law_name}, against {curve.label}.")


def _json_numbers(values: Float[np.ndarray, " point"]) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]
