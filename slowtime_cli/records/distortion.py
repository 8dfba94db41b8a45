"""The verb `distortion`: nonlinear distortion of multisines, and damping of free decays."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from slowtime.identification.free_decay.amplitude_law import DecayLaw, decay_law
from slowtime.identification.free_decay.envelope import decay_envelope
from slowtime.identification.nonlinear_distortion import (
    Distortion,
    MeasuredResonance,
    distortion_of,
    find_period,
    fit_resonance,
    realisation_of,
    sort_by_level,
)
from slowtime_cli.shared.terminal import note, show
from slowtime_services.diagnose import read_any
from slowtime_services.files import find_column
from slowtime_services.reports import Chart, Section, write_page

Series = np.ndarray[Any, np.dtype[np.float64]]
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


def _columns(
    text: str, names: Sequence[str], rate_hz: float | None
) -> tuple[list[Series], float]:
    """Read channels of a record without gaps."""
    source = read_any(text, rate_hz=rate_hz)
    record = source.record
    if record.gaps:
        raise click.UsageError(
            f"{source.name} has gaps. Give a part without gaps, as FILE@FROM:TO."
        )
    found = []
    for name in names:
        column = np.asarray(record.samples[:, find_column(name, record.channels)], dtype=float)
        if not np.isfinite(column).all():
            raise click.UsageError(
                f"{source.name}: {name} has values that are not finite. Give a part without "
                "them, as FILE@FROM:TO."
            )
        found.append(column)
    return found, record.rate_hz


def _levels(
    records: Sequence[str],
    channels: tuple[str, str],
    period: int | None,
    transient_s: float,
    band: tuple[float, float] | None,
    near_hz: float | None,
    rate_hz: float | None,
) -> tuple[Plain, list[Chart]]:
    given = []
    for text in records:
        (u, y), rate = _columns(text, channels, rate_hz)
        skipped = round(transient_s * rate)
        if period is None:
            period = find_period(u[skipped:])
            note(f"The input repeats after {period} samples, {period / rate:g} s.")
        given.append(realisation_of(u, y, rate, period, skipped))
    found = [distortion_of(group, band) for group in sort_by_level(given)]
    modes = [fit_resonance(d.frequency_hz, d.response, _known_sd(d), near_hz) for d in found]
    levels = [_level(d, mode) for d, mode in zip(found, modes, strict=True)]
    document = {"sentence": _sentence(found, modes), "levels": levels}
    return document, [_response_chart(found)]


def _known_sd(found: Distortion) -> Series | None:
    for sd in (found.total_sd, found.noise_sd):
        if np.isfinite(sd).all():
            return np.asarray(sd)
    return None


def _level(found: Distortion, mode: MeasuredResonance | None) -> Plain:
    size = np.abs(found.response)
    return {
        "level": found.level,
        "realisations": found.realisations,
        "periods": found.periods,
        "noise": float(np.median(found.noise_sd / size)),
        "nonlinear": float(np.median(found.nonlinear_sd / size)),
        "p_value": found.p_value,
        "odd_lines": found.odd.amplitude if found.odd else math.nan,
        "odd_noise": found.odd.noise if found.odd else math.nan,
        "even_lines": found.even.amplitude if found.even else math.nan,
        "even_noise": found.even.noise if found.even else math.nan,
        "symmetry": found.symmetry,
        "frequency_hz": mode.frequency_hz if mode else math.nan,
        "frequency_sd_hz": mode.frequency_sd_hz if mode else math.nan,
        "damping": mode.damping if mode else math.nan,
        "damping_sd": mode.damping_sd if mode else math.nan,
        "lines_hz": found.frequency_hz.tolist(),
        "response_real": found.response.real.tolist(),
        "response_imag": found.response.imag.tolist(),
        "noise_sd": found.noise_sd.tolist(),
        "total_sd": found.total_sd.tolist(),
        "nonlinear_sd": found.nonlinear_sd.tolist(),
    }


SYMMETRIES = {
    "none": "No nonlinear distortion was found above the noise.",
    "odd": "The nonlinearity is odd (equal in both directions), such as "
    "a cubic spring or dry friction.",
    "even": "The nonlinearity is even (different in the two directions), such as a one-sided "
    "stop "
    "or a quadratic spring.",
    "odd and even": "The nonlinearity has odd and even parts.",
    "unknown": "The symmetry is not determined. Measure several periods of an odd multisine, "
    "with some odd lines left out or in several realisations.",
}


def _sentence(found: Sequence[Distortion], modes: Sequence[MeasuredResonance | None]) -> str:
    strongest = found[-1]
    said = [SYMMETRIES[strongest.symmetry]]
    first, last = modes[0], modes[-1]
    if len(found) > 1 and first is not None and last is not None:
        said.append(
            f"From level {found[0].level:.4g} to {strongest.level:.4g} the frequency goes "
            f"from {first.frequency_hz:.5g} ± {first.frequency_sd_hz:.2g} to "
            f"{last.frequency_hz:.5g} ± {last.frequency_sd_hz:.2g} Hz, the damping ratio "
            f"from {100 * first.damping:.3g} "
            f"± {100 * first.damping_sd:.2g} to {100 * last.damping:.3g} ± "
            f"{100 * last.damping_sd:.2g} %."
        )
    return " ".join(said)


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
        (y,), rate = _columns(text, (told,), rate_hz)
        law = decay_law(decay_envelope(y, rate, transient_s, band_hz=band, near_hz=near_hz))
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
