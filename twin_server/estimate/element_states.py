"""Converts the epochs of a twin of elements to states, details and notices."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool
from pydantic_core import to_json

from slowtime_schemas.messages import Features
from slowtime_schemas.messages import Mode as MessageMode
from twin_server.history import states as st
from twin_server.history.details import ASSESSMENT, Detail
from twin_server.history.states import States
from twin_server.registration.structure import MASS, ElementModel
from twin_server.registration.twin import Registration

from .alarms import Estimates, follow_alarms
from .assessed_members import follow_assessments
from .checkpoint import Checkpoint
from .columns import without_covariates
from .covariates import messages
from .elements import EpochEstimate, TrackedEpochs, told_shape, track_epochs, units_of
from .elements.memory import ChangeSuspicion, ElementMemory
from .notices import Notice
from .renewals import follow_renewals

QUANTILE = 1.959963984540054
"""Half of a 95 % interval, in standard deviations."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ElementEstimates:
    """Estimates of some features of one twin: a state and a detail for each."""

    states: States
    details: list[Detail]
    checkpoint: Checkpoint
    notices: list[Notice]


def estimate_elements(
    registration: Registration,
    checkpoint: Checkpoint,
    features: Sequence[Features],
    missing_before: Sequence[int],
    covered: Sequence[float],
) -> ElementEstimates:
    """Estimate the next states of a twin of elements."""
    model = registration.structure()
    assert checkpoint.elements is not None
    found = track_epochs(
        checkpoint.elements,
        model,
        features,
        registration.learn_epochs,
        registration.covariates,
        covered,
        registration.assessment,
    )
    states = _states(registration, found.readings, missing_before)
    st.note_coverage(states, covered)
    parameters = _by_parameter(model.free, found.readings)
    notices = _of_covariates(registration, found, features)
    notices += [_lesson(found, row, count) for row, count in found.lessons]
    new = (states["reasons"] & st.MEASURED_BEFORE) == 0
    if registration.assessment is None:
        confirm = registration.confirm_readings
        suspicions, changed = _suspected(found.memory.suspicions, found.readings, new, confirm)
    else:
        suspicions, changed = follow_assessments(found.memory.suspicions, found.readings)
    memory = dataclasses.replace(found.memory, suspicions=suspicions)
    memory, doubted = _doubted_units(memory, features, model)
    checkpoint, watched = follow_alarms(registration, checkpoint, states, parameters)
    checkpoint, renewed = follow_renewals(checkpoint, features)
    notices += [*changed, *watched]
    notices = sorted([*renewed, *doubted, *notices], key=lambda notice: notice.row)
    return ElementEstimates(
        states,
        [
            _detail(reading, model, registration.covariates is not None)
            for reading in found.readings
        ],
        dataclasses.replace(checkpoint, elements=memory),
        notices,
    )


def _states(
    registration: Registration, readings: Sequence[EpochEstimate], missing_before: Sequence[int]
) -> States:
    """Fill the rows: frequency and damping are those of one mode of the model."""
    states = st.blank(len(readings))
    states["missing_before"] = missing_before
    for row, reading in enumerate(readings):
        message = reading.features
        states["sequence"][row], states["t_ns"][row] = message.sequence, message.t_ns
        states["slow_time"][row], states["reasons"][row] = message.slow_time, reading.reasons
        truth = message.truth or {}
        states["truth"][row] = [truth.get(name, np.nan) for name in st.ESTIMATES]
        mode = _leading(reading, registration.mode)
        if mode is not None:
            states["frequency_hz"][row] = _numbers(
                mode.frequency_hz.value, mode.frequency_hz.sd
            )
            states["damping_ratio"][row] = _numbers(
                mode.damping_ratio.value, mode.damping_ratio.sd
            )
    return states


def _leading(reading: EpochEstimate, number: int) -> MessageMode | None:
    """Find the mode of that number in the model; while learning, in the epoch."""
    modes = reading.features.modes
    if reading.reasons & st.BEGINNING:
        return modes[reading.seen[number].place] if number < len(reading.seen) else None
    places = [place for place, mode in reading.pairs.items() if mode == number]
    return modes[places[0]] if places else None


def _by_parameter(
    names: Sequence[str], readings: Sequence[EpochEstimate]
) -> Mapping[str, Estimates]:
    table = np.full((len(readings), len(names), 4), np.nan)
    for row, reading in enumerate(readings):
        if reading.changes is not None:
            table[row] = reading.changes
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}


def _detail(reading: EpochEstimate, model: ElementModel, freed: bool) -> Detail:
    names, features = model.free, reading.features
    changes = np.full((len(names), 3), np.nan)
    elements, ratios = {}, {}
    if reading.changes is not None and reading.ratio is not None:
        changes = reading.changes[:, [0, 2, 3]]
        elements = {
            name: _named(row) for name, row in zip(names, reading.changes.tolist(), strict=True)
        }
        ratios = dict(zip(names, reading.ratio.tolist(), strict=True))
    body = {
        "elements": elements,
        "posterior_to_prior": ratios,
        "suspects": [suspect.word for suspect in reading.suspects],
        **({} if reading.assessed is None else {ASSESSMENT: reading.assessed}),
        "channels": features.channels,
        "modes": [
            told
            for place, mode in enumerate(features.modes)
            if (told := _mode(mode, reading.pairs.get(place), features, model)) is not None
        ],
        "truth": _truth(features, names, freed),
    }
    return Detail(np.ascontiguousarray(changes).tobytes(), to_json(body))


def _truth(features: Features, names: Sequence[str], freed: bool) -> dict[str, float] | None:
    """Return the true values that a simulation states for the estimated quantities."""
    if features.truth is None:
        return None
    keys = {f"node.{n}" if n.endswith(MASS) else f"element.{n}": n for n in names}
    keys |= {name: name for name in st.ESTIMATES}
    truth = without_covariates(features.truth) if freed else features.truth
    return {keys[key]: value for key, value in truth.items() if key in keys}


def _mode(
    mode: MessageMode, number: int | None, features: Features, model: ElementModel
) -> dict[str, object] | None:
    """One mode as the twin took it in; None where a number leaves the range of floats."""
    frequency = _numbers(mode.frequency_hz.value, mode.frequency_hz.sd)
    damping = _numbers(mode.damping_ratio.value, mode.damping_ratio.sd)
    if not np.isfinite(frequency).all():
        return None
    return {
        "identity": mode.identity,
        "model_mode": number,
        "frequency_hz": _named(frequency),
        "damping_ratio": _named(damping) if np.isfinite(damping).all() else None,
        "kind": mode.kind,
        "shape": told_shape(mode, features, model),
    }


def _numbers(value: float, sd: float) -> tuple[float, float, float, float]:
    """Value, sd, lo and hi; all NaN where one of them is no number."""
    half = QUANTILE * sd
    numbers = value, sd, value - half, value + half
    return numbers if np.isfinite(numbers).all() else (np.nan,) * 4


def _named(numbers: Sequence[float]) -> dict[str, float]:
    return dict(zip(("value", "sd", "lo", "hi"), numbers, strict=True))


def _lesson(found: TrackedEpochs, row: int, count: int) -> Notice:
    if not count:
        return Notice(
            row,
            "nominal_not_learnt",
            "warning",
            "None of the modes of the first epochs matches a mode of the model, so "
            "learning starts again. Compare the frequencies and sensor channels of the "
            "model with those of the edge agent.",
            {},
        )
    modes = found.memory.baselines
    said = ", ".join(f"{one.frequency_hz:.4g} Hz (mode {one.mode + 1})" for one in modes)
    return Notice(
        row,
        "nominal_learnt",
        "info",
        f"The structure has been learnt from {count} of its modes: {said}. The model is "
        "moved there.",
        {f"mode_{one.mode + 1}_hz": one.frequency_hz for one in modes},
    )


def _doubted_units(
    memory: ElementMemory, features: Sequence[Features], model: ElementModel
) -> tuple[ElementMemory, list[Notice]]:
    """Make the notice of channels with doubtful units, if they have changed."""
    notices = []
    for row, message in enumerate(features):
        if all(mode.shape is None for mode in message.modes):
            continue
        doubts = units_of(message, model).doubts
        if doubts and doubts != memory.unit_doubts:
            details = {
                "units": dict(zip(message.channels, message.units, strict=True)),
                "doubts": list(doubts),
            }
            said = " ".join(doubts)
            notices.append(Notice(row, "units_in_doubt", "warning", said, details))
        memory = dataclasses.replace(memory, unit_doubts=doubts)
    return memory, notices


def _of_covariates(
    registration: Registration, found: TrackedEpochs, features: Sequence[Features]
) -> list[Notice]:
    """Make notices of learnt normal behaviour and of changes that covariates do not explain."""
    wanted = registration.covariates
    if wanted is None:
        return []
    notices = [
        messages.learnt(row, one.condition, wanted, one.mode)
        for row, count in found.lessons
        for one in found.memory.baselines
        if count and one.condition is not None
    ]
    return notices + [
        messages.entered(row, verdict, registration, mode, features[row].slow_time_unit)
        for row, mode, verdict in found.verdicts
    ]


def _suspected(
    suspicions: Sequence[ChangeSuspicion],
    readings: Sequence[EpochEstimate],
    new: Bool[np.ndarray, " time"],
    confirm: int,
) -> tuple[tuple[ChangeSuspicion, ...], list[Notice]]:
    """Confirm suspected elements: several readings in a row must suspect the same."""
    held = {one.word: one for one in suspicions}
    notices = []
    for row, reading in enumerate(readings):
        if reading.changes is None or not new[row]:
            continue
        seen = {suspect.word: suspect for suspect in reading.suspects}
        for word in (*held, *(word for word in seen if word not in held)):
            before = held.get(word, ChangeSuspicion(word))
            against = before.against + 1 if (word in seen) != before.holds else 0
            held[word] = dataclasses.replace(before, against=against)
            if against >= confirm:
                held[word] = ChangeSuspicion(word, not before.holds)
                notices.append(_changed(row, reading, word, holds=not before.holds))
        held = {word: one for word, one in held.items() if one.holds or one.against}
    return tuple(held.values()), notices


def _changed(row: int, reading: EpochEstimate, word: str, *, holds: bool) -> Notice:
    if not holds:
        message = f"{word}: no change is seen any more."
        return Notice(row, "element_restored", "info", message, {"suspect": word})
    (suspect,) = (one for one in reading.suspects if one.word == word)
    details = {"suspect": word, "sizes": list(suspect.sizes)}
    return Notice(row, "element_changed", "warning", suspect.sentence, details)
