"""The JSON document of a diagnosis."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from slowtime.discrepancy.diagnosis import (
    Diagnosis,
    Experiment,
    Gap,
    NamedEffect,
    Number,
    Rival,
    When,
)
from slowtime.dynamics.description import Input, Sensor
from slowtime.dynamics.effects import Place
from slowtime_schemas.files import diagnosis as file
from slowtime_schemas.files.diagnosis import DiagnosisFile
from slowtime_services.files import Record

HUGE = 1e300


def document_of(
    diagnosis: Diagnosis,
    *,
    records: Sequence[str] = (),
    holdout: Sequence[str] = (),
    notes: Sequence[str] = (),
    measured: Sequence[Record] = (),
    ended: file.SearchEnd | None = None,
) -> DiagnosisFile:
    """Convert a diagnosis to its file model.

    Parameters
    ----------
    records, holdout
        Names of what was learnt from and judged by.
    notes
        What to add to the diagnosis' own.
    measured
        All records, whose times are told where they state them.
    ended
        What ended the search, where it is known better than by the diagnosis itself.
    """
    if ended is None and diagnosis.exhausted:
        ended = file.SearchEnd(by="budget", used_s=diagnosis.seconds)
    experiment = diagnosis.experiment
    return DiagnosisFile(
        verdict=diagnosis.verdict,
        sentence=diagnosis.sentence,
        effects=tuple(_effect(named) for named in diagnosis.effects),
        undecided=tuple(_rival(rival) for rival in diagnosis.undecided),
        where=tuple(
            file.SuspectPlace(
                kind=s.place.kind, id=s.place.id, score=_finite(s.score),
                p_value=_share(s.p_value), share=_finite(s.share),
            )
            for s in diagnosis.where
        ),
        when=_when(diagnosis.when),
        gap=_gap(diagnosis.gap),
        residual_white=bool(diagnosis.residual_white),
        white_p_value=_share(diagnosis.white_p_value),
        chi2_per_datum=_finite(diagnosis.chi2_per_datum),
        nothing_probability=_share(diagnosis.nothing_probability),
        experiment=experiment.sentence if experiment else None,
        experiment_request=_request(experiment) if experiment else None,
        moved=tuple(
            file.MovedConstant(name=name, **_number(n).model_dump())
            for name, n in diagnosis.moved.items()
        ),
        findings=tuple(
            file.ChannelFinding(
                fault=f.fault, channel=f.channel, share=_share(f.share), spans_s=f.spans_s,
                sentence=f.sentence,
            )
            for f in diagnosis.findings
        ),
        notes=(*notes, *diagnosis.notes),
        model=diagnosis.nominal.name,
        records=tuple(records),
        holdout=tuple(holdout),
        measured_s=_spans_s(measured),
        ended=ended,
        seconds=diagnosis.seconds,
    )  # fmt: skip


def _spans_s(records: Sequence[Record]) -> tuple[file.Span, ...]:
    """Begin and end of each record that states its time."""
    return tuple(
        (record.start_ns / 1e9, record.start_ns / 1e9 + record.duration_s)
        for record in records
        if record.start_ns is not None
    )


def _effect(named: NamedEffect) -> file.FoundEffect:
    return file.FoundEffect(
        effect=named.effect.kind,
        family=named.family,
        where=_place(named.effect.place),
        parameters=_parameters(named.effect.parameters, named.numbers),
        probability=_share(named.probability),
        alternatives=tuple(_rival(rival) for rival in named.rivals),
        sentence=named.sentence,
    )


def _parameters(
    chosen: Mapping[str, float], numbers: Mapping[str, Number]
) -> dict[str, file.Estimated]:
    """Return estimated parameters; discrete choices, such as a side or a span, with sd 0."""
    plain = {
        name: file.Estimated(value=value, sd=0.0)
        for name, value in chosen.items()
        if math.isfinite(value)
    }
    return plain | {name: _number(n) for name, n in numbers.items() if math.isfinite(n.value)}


def _number(number: Number) -> file.Estimated:
    return file.Estimated(value=number.value, sd=_finite(abs(number.sd)), unit=number.unit)


def _rival(rival: Rival) -> file.Rival:
    return file.Rival(
        effect=rival.effect, where=_place(rival.place), probability=_share(rival.probability)
    )


def _place(place: Place) -> file.Where:
    return file.Where(kind=place.kind, id=place.id)


def _when(when: When) -> file.WhenSeen:
    return file.WhenSeen(
        times_s=when.times_s,
        bands_hz=when.bands_hz,
        amplitude=when.amplitude,
        linear=when.linear,
        steady=when.steady,
    )


def _gap(gap: Gap) -> file.GapShown:
    return file.GapShown(
        nominal=_finite(gap.nominal),
        refitted_nominal=_finite(gap.refitted_nominal),
        steps=tuple(
            file.GapStep(effect=s.effect, where=_place(s.place), nrmse=_finite(s.nrmse))
            for s in gap.steps
        ),
        augmented=_finite(gap.augmented),
        noise_floor=_finite(gap.noise_floor),
        worst_sensor=_finite(gap.worst),
        on=gap.on,
    )


def _request(experiment: Experiment) -> dict[str, Any]:
    """Convert an experiment to its file model; unchanged settings are left out."""
    request: dict[str, Any] = {}
    if experiment.level != 1.0:
        request["level_factor"] = experiment.level
    if experiment.band_hz is not None:
        request["band_hz"] = list(experiment.band_hz)
    if experiment.excitation is not None:
        request["excitation"] = experiment.excitation
    if experiment.start_s is not None:
        request["start_s"] = experiment.start_s
    if experiment.add_sensors:
        request["add_sensors"] = [_entry(sensor) for sensor in experiment.add_sensors]
    if experiment.add_inputs:
        request["add_inputs"] = [_entry(force) for force in experiment.add_inputs]
    return request


def _entry(channel: Input | Sensor) -> dict[str, Any]:
    """Write a channel as a model file has it."""
    return {k: v for k, v in dataclasses.asdict(channel).items() if v is not None}


def _finite(value: float) -> float:
    """Replace infinity, which JSON lacks, by `HUGE`."""
    return float(value) if math.isfinite(value) else HUGE


def _share(value: float) -> float:
    return min(max(float(value), 0.0), 1.0) if math.isfinite(value) else 0.0
