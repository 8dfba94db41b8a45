"""The trials of a campaign, in the model's channels and units, from records."""

import dataclasses
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.discrepancy.records import MIN_SAMPLES, Campaign, Trial
from slowtime.dynamics.description import Description, Input, Sensor
from slowtime.dynamics.units import UNITS
from slowtime_services.files import Record, RecordError
from slowtime_services.files.times.time_axis import unit_scale

from .channel_roles import Roles, evaluate
from .sources import Source

ABSOLUTE_S = 1e8
"""Times beyond this [s] are counted from 1970, not from the beginning of a campaign."""

Series = Float[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class GatheredCampaign:
    """A campaign, the record that each trial to learn from comes from, and notes."""

    campaign: Campaign
    origins: tuple[str, ...]
    notes: tuple[str, ...]


def campaign_of(
    description: Description,
    records: Sequence[Source],
    holdout: Sequence[Source] = (),
    roles: Roles | None = None,
) -> tuple[Campaign, tuple[str, ...]]:
    """Bring records into the channels and units of a model.

    A record with missing samples, or in which an input is not finite for a while, becomes
    several trials, none of which spans such a hole.

    Parameters
    ----------
    roles
        What to read for a channel of the model that the records call otherwise.

    Returns
    -------
    The campaign, and what a person should know of how it was read.
    """
    gathered = gather(description, records, holdout, roles)
    return gathered.campaign, gathered.notes


def gather(
    description: Description,
    records: Sequence[Source],
    holdout: Sequence[Source] = (),
    roles: Roles | None = None,
) -> GatheredCampaign:
    """Build a campaign as `campaign_of` does, and return the record of each trial."""
    roles = {} if roles is None else roles
    _refuse_unknown(roles, description)
    notes: list[str] = []
    starts = _starts([*records, *holdout], notes)
    taken = [
        tuple(_heard_of(_trials(description, source, start, roles, notes), source, notes))
        for source, start in zip([*records, *holdout], starts, strict=True)
    ]
    learnt = tuple(itertools.chain.from_iterable(taken[: len(records)]))
    _refuse_unheard(description, learnt, records, roles)
    judged = tuple(itertools.chain.from_iterable(taken[len(records) :]))
    _refuse_known(learnt, judged)
    origins = [s.name for s, trials in zip(records, taken, strict=False) for _ in trials]
    if not judged:
        _refuse_short(learnt, origins)
    campaign = Campaign(description=description, trials=learnt, holdout=judged)
    return GatheredCampaign(campaign, tuple(origins), tuple(notes))


def _heard_of(trials: Iterable[Trial], source: Source, notes: list[str]) -> Iterator[Trial]:
    """Leave out trials without a finite sample of any sensor."""
    for trial in trials:
        if trial.used.any():
            yield trial
        else:
            first, last = trial.times_s[[0, -1]]
            notes.append(
                f"{source.name} has no finite reading of any sensor from {first:g} to "
                f"{last:g} s: it is left out."
            )


def _refuse_short(trials: Sequence[Trial], origins: Sequence[str]) -> None:
    for trial, name in zip(trials, origins, strict=True):
        if len(trial.outputs) < 3 * MIN_SAMPLES:
            holed = list(origins).count(name) > 1
            why = ", because its clock or inputs have gaps" if holed else ""
            raise RecordError(
                f"{name} has {len(trial.outputs)} consecutive samples without a gap{why}. "
                "Without --holdout the last third is held back for validation, which "
                f"takes at least {3 * MIN_SAMPLES} samples. Give a longer record, or a "
                "separate validation record with --holdout."
            )


def _refuse_known(learnt: Sequence[Trial], judged: Sequence[Trial]) -> None:
    """Refuse to judge by samples that are learnt from."""
    for one, other in itertools.product(judged, learnt):
        if _holds(one.outputs, other.outputs):
            raise RecordError(
                "A held-out record, or a part of it, is also used for fitting, so its "
                "error would prove nothing. Hold out another record, or another part of "
                "it with FILE@FROM:TO."
            )


def _holds(one: Float[np.ndarray, "_ s"], other: Float[np.ndarray, "_ s"]) -> bool:
    """Whether the beginning of one record occurs in the other."""
    for few, many in ((one[:MIN_SAMPLES], other), (other[:MIN_SAMPLES], one)):
        if not np.ptp(few, axis=0).any():
            continue
        for row in np.flatnonzero((many[: len(many) - len(few) + 1] == few[0]).all(axis=1)):
            if np.array_equal(many[row : row + len(few)], few):
                return True
    return False


def _refuse_unknown(roles: Roles, description: Description) -> None:
    known = [entry.channel for entry in description.inputs]
    known += [entry.channel for entry in description.sensors]
    for channel in roles:
        if channel not in known:
            raise RecordError(
                f"--channel maps {channel!r}, which is not a channel of the model. The "
                "model has: "
                f"{', '.join(known)}."
            )


def _starts(sources: Sequence[Source], notes: list[str]) -> list[float]:
    """Campaign time at which each record begins [s]; 0 if none states its start."""
    told = [_start(source.record) for source in sources]
    absolute = [start for start in told if start is not None and start > ABSOLUTE_S]
    origin = min(absolute, default=0.0)
    if absolute:
        notes.append("Campaign time is counted from the beginning of the first record.")
    undated = [s.name for s, start in zip(sources, told, strict=True) if start is None]
    if undated and len(undated) < len(sources):
        says = (
            "does not say when it begins" if len(undated) == 1 else "do not say when they begin"
        )
        notes.append(f"{', '.join(undated)} {says}: taken to be time 0.")
    return [0.0 if start is None else start - origin * (start > ABSOLUTE_S) for start in told]


def _start(record: Record) -> float | None:
    if record.start_ns is not None:
        return record.start_ns * 1e-9
    for name, clock in record.aux.items():
        if np.shape(clock) == (len(record.samples),) and np.ndim(clock) == 1:
            return float(clock[0]) * unit_scale(name, "", clock)[0]
    return None


def _trials(
    description: Description, source: Source, start_s: float, roles: Roles, notes: list[str]
) -> Iterator[Trial]:
    """Cut one record at its holes."""
    record = source.record
    notes.extend(f"{source.name}: {text}" for text in record.notes)
    count = len(record.samples)
    driven = [_column(description, entry, source, roles, notes) for entry in description.inputs]
    heard = [
        _sensor_series(description, entry, source, roles, notes)
        for entry in description.sensors
    ]
    inputs = np.stack(driven, axis=1) if driven else np.zeros((count, 0))
    outputs = np.stack([column for column, _ in heard], axis=1)
    use = np.stack([np.full(count, there) for _, there in heard], axis=1)
    known = np.asarray(np.isfinite(inputs).all(axis=1))
    if not known.any():
        name = next(
            e.channel for e, c in zip(description.inputs, driven, strict=True)
            if not np.isfinite(c).any()
        )  # fmt: skip
        raise RecordError(
            f"{source.name}: input {name!r} has no finite values. The excitation must be "
            "measured; if it was not, remove this input from the model."
        )
    pieces = list(_pieces(record, known))
    kept = [piece for piece in pieces if piece[1] - piece[0] >= MIN_SAMPLES]
    if not kept:
        longest = max(last - first for first, last, _ in pieces)
        raise RecordError(
            f"{source.name} needs {MIN_SAMPLES} consecutive samples without a gap and has "
            f"at most {longest}. Give a longer record, or one without gaps."
        )
    if len(pieces) > 1:
        lost = count - sum(last - first for first, last, _ in kept)
        dropped = f"; {lost} samples between are left out" if lost else ""
        parts = f"{len(kept)} records, each with a start of its own" if len(kept) > 1 else "one"
        notes.append(
            f"{source.name} has gaps in its clock or inputs: read as {parts}{dropped}."
        )
    for first, last, late in kept:
        yield Trial(
            inputs=inputs[first:last],
            outputs=outputs[first:last],
            rate_hz=record.rate_hz,
            start_s=start_s + (first + late) / record.rate_hz,
            use=use[first:last],
        )


def _pieces(record: Record, known: Bool[np.ndarray, " time"]) -> Iterator[tuple[int, int, int]]:
    """First row, row after the last, and samples missing before, of parts without a hole."""
    cuts = {gap.row: gap.missing for gap in record.gaps}
    edges = np.flatnonzero(np.diff(known.astype(int))) + 1
    rows = sorted({0, len(known), *cuts, *edges.tolist()})
    for first, last in itertools.pairwise(rows):
        late = sum(missing for row, missing in cuts.items() if row <= first)
        if known[first]:
            yield first, last, late


def _sensor_series(
    description: Description, sensor: Sensor, source: Source, roles: Roles, notes: list[str]
) -> tuple[Series, bool]:
    """Read a sensor, and whether the record has it at all."""
    if sensor.channel in roles or _find(sensor.channel, source.record) is not None:
        return _column(description, sensor, source, roles, notes), True
    notes.append(
        f"{source.name} has no channel {sensor.channel!r}; it is compared on the other "
        "channels only."
    )
    return np.zeros(len(source.record.samples)), False


def _column(
    description: Description,
    entry: Input | Sensor,
    source: Source,
    roles: Roles,
    notes: list[str],
) -> Series:
    """Read a channel, in the model's unit."""
    record = source.record
    if entry.channel in roles:
        return evaluate(roles[entry.channel], record, source.name)
    column = _find(entry.channel, record)
    if column is None:
        raise _no_channel(source, entry.channel, "inputs")
    samples = np.asarray(record.samples[:, column], dtype=float)
    return samples * _between(description, entry, record.units[column], source.name, notes)


def _find(channel: str, record: Record) -> int | None:
    if channel in record.channels:
        return record.channels.index(channel)
    folded = [name.casefold() for name in record.channels]
    alike = folded.count(channel.casefold()) == 1
    return folded.index(channel.casefold()) if alike else None


def _no_channel(source: Source, channel: str, kind: str) -> RecordError:
    return RecordError(
        f"{source.name} has no channel called {channel!r}, which is among the model's {kind}. "
        f"It has: {', '.join(source.record.channels)}. Map it with --channel "
        f"{channel}=NAME; if it was not measured, remove it from the model's {kind}."
    )


def _between(
    description: Description, entry: Input | Sensor, unit: str, file: str, notes: list[str]
) -> float:
    """From the unit that a record gives a channel, where it does, to the model's."""
    quantity = entry.quantity
    if not unit or unit == entry.unit:
        return 1.0
    known = UNITS[description.unit_of_coordinate, quantity]
    if unit not in known:
        raise RecordError(
            f"{file} has {entry.channel} in {unit}, the model in {entry.unit}: these "
            f"cannot be converted into each other. Allowed: {', '.join(known)}. Correct "
            "the wrong unit, or map the channel with --channel."
        )
    notes.append(f"{file}: {entry.channel} converted from {unit} to the model's {entry.unit}.")
    return known[unit] / known[entry.unit]


def _refuse_unheard(
    description: Description, trials: Sequence[Trial], sources: Sequence[Source], roles: Roles
) -> None:
    for i, sensor in enumerate(description.sensors):
        channel = sensor.channel
        if any(trial.used[:, i].any() for trial in trials):
            continue
        if channel in roles or any(_find(channel, s.record) is not None for s in sources):
            raise RecordError(
                f"{channel!r} has no finite sample in any record used for fitting. Give a "
                "record that has some, or remove the channel from the model's sensors."
            )
        found = sorted({name for source in sources for name in source.record.channels})
        said = [text for source in sources for text in source.record.notes]
        number = re.compile(rf"{re.escape(channel)}_[0-9]+")
        if any(number.fullmatch(name) for name in found):
            said.append(f"If {channel!r} heads several columns, they were numbered.")
        raise RecordError(
            f"No record to learn from has a channel called {channel!r}, which is among the "
            f"model's sensors. There are: {', '.join(found)}. {' '.join([*said, 'Say'])} which "
            f"it is with --channel {channel}=NAME; if it was not measured, take it out."
        )
