"""The HTML report of a diagnosis."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime_schemas.files.diagnosis import DiagnosisFile, FoundEffect, Rival
from slowtime_services.reports import Chart, Section, Table, Words, write_page

from .charts import PICTURE_SAMPLES, gap_chart, residual_charts, run_charts, surface_chart
from .constants import changes_of
from .first_pages import diagnosis_page
from .force_charts import force_charts
from .labels import meaning_of, named, number, placed, rare


def write_report(
    path: Path,
    diagnosis: Diagnosis,
    document: DiagnosisFile,
    *,
    structure: str = "",
    language: str = "en",
) -> None:
    """Write the report, such as ``report.html``; it needs nothing but a browser.

    `structure` names what it is about; the model's own name where empty.
    """
    words = Words(language)
    first = diagnosis_page(diagnosis, document, words, structure=structure)
    title = f"{words('kind.diagnosis')}: {first.subject}"
    runs = [
        _in_words(one, diagnosis, words) for one in run_charts(diagnosis, PICTURE_SAMPLES)[:1]
    ]
    gap = gap_chart(document)
    write_page(
        path, title, document.sentence,
        list(_sections(diagnosis, document, [gap] if runs else [])),
        first=first, picture=runs[0] if runs else gap, heading="" if runs else "The gap",
        language=language,
    )  # fmt: skip


def _in_words(chart: Chart, diagnosis: Diagnosis, words: Words) -> Chart:
    """Write the lines, axis and caption of the first sensor's runs in a language."""
    lines = ("measured", "nominal", "augmented")
    data = [
        {**line, "name": words(f"diagnosis.line_{name}")}
        for line, name in zip(chart.data, lines, strict=True)
    ]
    sensor, times_s = diagnosis.nominal.sensors[0], chart.data[0]["x"]
    layout = {**chart.layout, "xaxis": {"title": {"text": words("diagnosis.axis_time")}}}
    span = words.number(times_s[-1] - times_s[0])
    told = words("diagnosis.picture", channel=sensor.channel, unit=sensor.unit, span=span)
    return Chart(data, layout, told)


def _sections(
    diagnosis: Diagnosis, document: DiagnosisFile, gap: Sequence[Chart]
) -> Iterator[Section]:
    yield Section("The gap", [document.sentence], gap)
    yield from _effects(document)
    yield from _undecided(document)
    # A sensor at fault has no force on the structure.
    if diagnosis.surface is not None and document.verdict != "sensor_fault":
        law = named(document.effects[0].effect) if document.effects else None
        chart = surface_chart(diagnosis.surface, law, diagnosis.nominal.unit_of_coordinate)
        yield Section("The force recovered", (), [chart])
    if diagnosis.measured_force is not None:
        charts = force_charts(diagnosis.measured_force, diagnosis.nominal.unit_of_coordinate)
        yield Section("The measured force surface", (), charts)
    yield Section("Measured and simulated motion", (), run_charts(diagnosis))
    yield Section("What is left", _whiteness(document), residual_charts(diagnosis))
    yield _where(document)
    yield _constants(diagnosis, document)
    if document.findings:
        rows = [(f.channel, f.fault, f"{100 * f.share:.2g} %") for f in document.findings]
        table = Table(("channel", "fault", "share of its samples"), rows, names=("channel",))
        yield Section("Channels", [f.sentence for f in document.findings], [table])
    yield _account(document)


def _effects(document: DiagnosisFile) -> Iterator[Section]:
    if not document.effects:
        return
    rows, rivals = [], []
    for effect in document.effects:
        place = placed(effect.where.kind, effect.where.id)
        numbers = ", ".join(
            f"{meaning_of(effect.effect, name, n.unit)} = {number(n)}"
            for name, n in effect.parameters.items()
            if n.sd > 0
        )
        rows.append((named(effect.effect), effect.family, place, numbers, _chance(effect)))
        rivals += [
            (
                named(r.effect),
                placed(r.where.kind, r.where.id),
                named(effect.effect),
                _chance(r),
            )
            for r in effect.alternatives
        ]
    headings = ("effect", "family", "where", "parameters", "probability")
    tables = [Table(headings, rows, "± is one standard deviation.")]
    if rivals:
        tables.append(
            Table(("rival", "where", "instead of", "probability"), rivals, "Alternatives.")
        )
    yield Section("What is missing", [e.sentence for e in document.effects], tables)


def _undecided(document: DiagnosisFile) -> Iterator[Section]:
    words = [document.experiment] if document.experiment else []
    rows = [
        (named(r.effect), placed(r.where.kind, r.where.id), _chance(r))
        for r in document.undecided
    ]
    tables = [Table(("effect", "where", "probability"), rows)] if rows else []
    if words or tables:
        yield Section("What cannot be decided", words, tables)


def _whiteness(document: DiagnosisFile) -> list[str]:
    """Write whether the residual is noise."""
    over = document.chi2_per_datum
    if document.residual_white:
        word = "The residual of the corrected model cannot be distinguished from sensor noise"
    else:
        word = "The residual of the corrected model exceeds the sensor noise"
    return [
        f"{word}: its mean square is {over:.3g} times that of the noise (1 is the best there "
        f"is); the chance of so much or more, were it noise, is {rare(document.white_p_value)}."
    ]


def _where(document: DiagnosisFile) -> Section:
    rows = [
        (
            placed(place.kind, place.id), Words().number(place.score, 4), rare(place.p_value),
            f"{100 * place.share:.3g} %",
        )
        for place in document.where
    ]  # fmt: skip
    headings = (
        "place",
        "gain of log likelihood [nat]",
        "p-value if nothing is missing",
        "share of the residual explained",
    )
    told = (
        "By how much one unknown force at a place raises the log likelihood of what the "
        "refitted model leaves."
    )
    when = document.when
    words = []
    if when.bands_hz:
        bands = ", ".join(f"between {low:.4g} and {high:.4g} Hz" for low, high in when.bands_hz)
        words.append(f"What the model leaves unexplained stands out {bands}.")
    if when.times_s:
        spans = ", ".join(f"{first:.4g} to {last:.4g} s" for first, last in when.times_s[:12])
        words.append(f"What the model leaves unexplained stands out at campaign times {spans}.")
    if when.amplitude and document.verdict != "sensor_fault":
        words.append(when.amplitude)
    if when.linear is not None and document.verdict != "sensor_fault":
        kind = "grows in proportion to" if when.linear else "is not proportional to"
        words.append(f"What the model leaves unexplained {kind} the motion.")
    if when.steady is not None:
        kind = "acts alike throughout" if when.steady else "changes over"
        words.append(f"What the model leaves unexplained {kind} the campaign.")
    return Section("Where and when", words, [Table(headings, rows, told)])


def _constants(diagnosis: Diagnosis, document: DiagnosisFile) -> Section:
    """Set all constants of the three models side by side."""
    refitted, augmented = (
        changes_of(diagnosis.nominal, model)
        for model in (diagnosis.refitted, diagnosis.augmented)
    )
    rows = [
        (
            last.label, f"{last.given:.6g}", f"{first.fitted:.6g}", f"{last.fitted:.6g}",
            _signed_percent(last.share) if last.given else "",
        )
        for first, last in zip(refitted, augmented, strict=True)
    ]  # fmt: skip
    words = [
        f"{moved.name} is outside its tolerance: {moved.value:.5g} ± {moved.sd:.2g} "
        f"{moved.unit}."
        for moved in document.moved
    ]
    headings = ("constant", "as given", "refitted", "corrected", "change")
    return Section("Constants", words, [Table(headings, rows)])


def _signed_percent(share: float) -> str:
    """Write a change in percent; one that rounds to nothing has no sign."""
    text = f"{100 * share:+.2f} %"
    return text[1:] if float(text[:-2]) == 0.0 else text


def _account(document: DiagnosisFile) -> Section:
    words = [f"Fitted to {', '.join(document.records)}."] if document.records else []
    if document.holdout:
        words.append(
            f"Validated on {', '.join(document.holdout)}, which was not used for fitting."
        )
    words.append(f"{document.seconds:.1f} s of computing.")
    return Section("Records and settings", [*words, *document.notes])


def _chance(told: FoundEffect | Rival) -> str:
    return f"{told.probability:.3f}"
