"""The verb `distortion`: nonlinear distortion of multisines, and damping of free decays."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.identification.nonlinear_distortion import Distortion
from slowtime_api.decays import DecayLaw, fit_decay
from slowtime_api.responses.distortions import distortion as distortion_of_signals
from slowtime_api.signals import Signals
from slowtime_cli.shared.terminal import note, show
from slowtime_services.diagnose import read_any
from slowtime_services.files import find_column
from slowtime_services.reports import Chart, Section, write_page

Plain = dict[str, Any]


def distortion(
    records: Sequence[str],
    given: str | None,
    told: str,
    period: int | None,
    transient_s: float,
    band: tuple[float, float] | None,
    near_hz: float | None,
    decay: bool,
    rate_hz: float | None,
    out: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Analyse periodic records or free decays, and print the results.

    Parameters
    ----------
    records
        Files, each with an optional part, ``FILE@FROM:TO``.
    given, told
        Channels of the input and of the output.
    period
        Length of a period [samples]; None where it is to be found.
    transient_s
        Time at the beginning of each record that is left out [s].
    band
        Least and largest frequency to analyse [Hz]; None for all that are excited.
    near_hz
        Frequency near which the resonance is fitted [Hz]; None for the highest peak.
    decay
        Whether the records are free decays.
    rate_hz
        Sampling rate of records that do not state theirs [Hz].
    out, plot
        JSON file and HTML page to write.
    as_json
        Whether to print JSON instead of tables.

    Raises
    ------
    ValueError
        Where a record cannot be analysed; it says why and what to do.
    """
    if decay:
        document, charts = _decays(records, told, transient_s, rate_hz, band, near_hz)
    else:
        assert given is not None
        document, charts = _levels(
            records, (given, told), period, transient_s, band, near_hz, rate_hz
        )
    text = json.dumps(_finite(document), indent=2)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
    if plot is not None:
        write_page(plot, "Distortion", document["sentence"], [Section("", (), charts)])
    if as_json:
        click.echo(text)
        return
    rows = document["decays" if decay else "levels"]
    plain = [{key: row[key] for key in row if not isinstance(row[key], list)} for row in rows]
    if plain:
        columns = list(plain[0])
        show("", columns, [[_short(v) for v in row.values()] for row in plain], plain=plain)
    click.echo(document["sentence"])


def _signals(text: str, names: Sequence[str], rate_hz: float | None) -> Signals:
    """Read channels of a record without gaps."""
    source = read_any(text, rate_hz=rate_hz)
    record = source.record
    if record.gaps:
        raise click.UsageError(
            f"{source.name} has gaps. Give a part without gaps, as FILE@FROM:TO."
        )
    columns = [find_column(name, record.channels) for name in names]
    for name, column in zip(names, columns, strict=True):
        if not np.isfinite(np.asarray(record.samples[:, column], dtype=float)).all():
            raise click.UsageError(
                f"{source.name}: {name} has values that are not finite. Give a part without "
                "them, as FILE@FROM:TO."
            )
    return Signals.from_record(record)[[record.channels[column] for column in columns]]


def _levels(
    records: Sequence[str],
    channels: tuple[str, str],
    period: int | None,
    transient_s: float,
    band: tuple[float, float] | None,
    near_hz: float | None,
    rate_hz: float | None,
) -> tuple[Plain, list[Chart]]:
    signals = [_signals(text, channels, rate_hz) for text in records]
    found = distortion_of_signals(
        signals, *channels, period=period, transient_s=transient_s, band_hz=band,
        near_hz=near_hz,
    )  # fmt: skip
    if period is None:
        rate = signals[0].rate_hz
        note(f"The input repeats after {found.period} samples, {found.period / rate:g} s.")
    lines = [
        row
        | {
            "lines_hz": one.frequency_hz.tolist(),
            "response_real": one.response.real.tolist(),
            "response_imag": one.response.imag.tolist(),
            "noise_sd": one.noise_sd.tolist(),
            "total_sd": one.total_sd.tolist(),
            "nonlinear_sd": one.nonlinear_sd.tolist(),
        }
        for row, one in zip(found.rows(), found.levels, strict=True)
    ]
    document = {"sentence": found.sentence, "levels": lines}
    return document, [_response_chart(found.levels)]


def _response_chart(found: Sequence[Distortion]) -> Chart:
    lines: list[Plain] = []
    for one in found:
        name = f"level {one.level:.3g}"
        for part, values in (
            ("response", np.abs(one.response)),
            ("noise", one.noise_sd),
            ("distortion", one.nonlinear_sd),
        ):
            if np.isfinite(values).any():
                decibels = 20 * np.log10(np.maximum(values, np.finfo(float).tiny))
                lines.append(
                    {
                        "type": "scattergl",
                        "mode": "lines" if part == "response" else "markers",
                        "marker": {"size": 3},
                        "x": one.frequency_hz.tolist(),
                        "y": np.maximum(decibels, -400).tolist(),
                        "name": f"{part}, {name}",
                    }
                )
    layout: Plain = {
        "xaxis": {"title": {"text": "frequency [Hz]"}},
        "yaxis": {"title": {"text": "output over input [dB]"}},
    }
    return Chart(
        lines, layout, "Best linear approximation, its noise, and its nonlinear distortion."
    )


def _decays(
    records: Sequence[str],
    told: str,
    transient_s: float,
    rate_hz: float | None,
    band: tuple[float, float] | None,
    near_hz: float | None,
) -> tuple[Plain, list[Chart]]:
    rows, sentences, lines = [], [], []
    for text in records:
        signals = _signals(text, (told,), rate_hz)
        law = fit_decay(signals, band_hz=band, near_hz=near_hz, start_s=transient_s)
        rows.append(_decay(text, law))
        sentences.append(f"{text}: {law.sentence}")
        for name, values in (("damping [%]", 100 * law.damping), ("Hz", law.frequency_hz)):
            lines.append(
                {
                    "type": "scatter",
                    "x": law.amplitude.tolist(),
                    "y": values.tolist(),
                    "name": f"{text}: {name}",
                }
            )
    layout: Plain = {"xaxis": {"title": {"text": f"amplitude of {told}"}}}
    chart = Chart(lines, layout, "Damping ratio and frequency against amplitude.")
    return {"sentence": " ".join(sentences), "decays": rows}, [chart]


def _decay(text: str, law: DecayLaw) -> Plain:
    return {
        "record": text,
        "terms": " + ".join(law.terms),
        "stiffness": law.stiffness,
        "one_number": law.one_number,
        "beats": law.beats,
        "largest": float(law.amplitude[0]),
        "smallest": float(law.amplitude[-1]),
        "frequency_hz_at_largest": float(law.frequency_hz[0]),
        "frequency_hz_at_smallest": float(law.frequency_hz[-1]),
        "damping_at_largest": float(law.damping[0]),
        "damping_at_smallest": float(law.damping[-1]),
        "per_half_cycle": law.coefficients[0],
        "per_half_cycle_sd": law.coefficients_sd[0],
        "viscous": law.coefficients[1],
        "viscous_sd": law.coefficients_sd[1],
        "quadratic": law.coefficients[2],
        "quadratic_sd": law.coefficients_sd[2],
        "residual": law.residual,
        "amplitude": law.amplitude.tolist(),
        "frequency_hz": law.frequency_hz.tolist(),
        "frequency_sd_hz": law.frequency_sd_hz.tolist(),
        "damping": law.damping.tolist(),
        "damping_sd": law.damping_sd.tolist(),
    }


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _finite(value: Any) -> Any:
    """Replace what JSON has no number for by null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
