"""Constant offsets of inputs and sensors that are fitted from the beginning, as effects.

A constant error of a force displaces a supported structure a little, but makes an unsupported
one drift away, so that no free run fits. A free decay is symmetric about its position of rest,
where a displacement sensor or a gyroscope seldom reads zero: without an offset of the sensor,
a one-sided stop or stiffness seems to be missing. Therefore each input of an unsupported
structure, and each sensor of displacement or velocity in a free decay, has an offset. It is
fitted from the beginning, as initial states are, and reported where it is significant.

The zero of an incremental encoder differs from record to record. Where records are off by
constants of either sign, sensors of displacement have an offset for each record.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit, initial_state_sds, refit, try_refit
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.candidates.library_fit import OFFSET
from slowtime.discrepancy.diagnosis import NamedEffect, Number
from slowtime.discrepancy.noise import has_rigid_motion
from slowtime.discrepancy.quoting import OF_SENSOR, numbers_of, quoted, unit_at
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind
from slowtime.dynamics.plant import Plant

SENSOR_OFFSET = "sensor_bias"
"""Kind of effect that is the offset of a sensor."""
BY_RECORD = "sensor_bias_by_record"
"""Kind of effect that is an offset of a sensor for each record."""
REPORTED_SDS = 3.3
"""[standard deviations] From zero, from which an offset is reported. Source: a two-sided
p-value of 1 in 1000."""


BLOCKS = 8
"""[1] Of a record, whose means tell how well the mean of its residual is known. Source: blocks
of an eighth of a record are longer than its memory; half and double change no answer of
docs/what_decides.md."""
DIFFERING_SDS = 4.0
"""[standard errors] From zero, either way, that means of two records must be. Source: one
record of noise in 200 (Student's t of seven degrees of freedom); a fit then has to tell."""


def with_offsets(
    description: Description,
    kinds: Mapping[str, Kind],
    *,
    decays: bool,
    by_record: Sequence[str] = (),
) -> Description:
    """Add the offsets that records of such a structure need, with a value of zero.

    Sensors `by_record` have another offset in each record.
    """
    common = _of_sensors(description, kinds) if decays else ()
    return dataclasses.replace(
        description,
        effects=(
            *description.effects,
            *_of_inputs(description, kinds),
            *(entry for entry in common if entry["sensor"] not in by_record),
            *({"effect": BY_RECORD, "sensor": name, "bias": 0.0} for name in by_record),
        ),
    )


def refit_with_offsets(
    description: Description,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    *,
    decays: bool,
) -> Fit:
    """Fit a model with its offsets, one for each record where the records demand it."""
    start = with_offsets(description, kinds, decays=decays)
    fit = refit(Plant.of(start, kinds=kinds), trials)
    channels = differing_sensors(fit, trials) if BY_RECORD in kinds else ()
    if not channels:
        return fit
    apart = with_offsets(description, kinds, decays=decays, by_record=channels)
    other = try_refit(Plant.of(apart, kinds=kinds), trials, noise=fit.noise)
    if other is None:
        return fit
    # Schwarz's criterion, by the scatter of what the better model leaves.
    price = len(channels) * len(trials) * np.log(fit.data)
    gain = (fit.cost - other.cost) / max(other.chi2_in_band, 1.0)
    return refit(other.plant, trials) if gain > price else fit


def differing_sensors(fit: Fit, trials: Sequence[Trial]) -> tuple[str, ...]:
    """List sensors of displacement that are off by constants of either sign."""
    given = fit.plant.description
    found = []
    for number, sensor in enumerate(given.sensors):
        if sensor.quantity != "displacement":
            continue
        # A law that is missing and not symmetric shifts all records the same way.
        left = [
            _standard_errors_off(residual[trial.used[:, number], number])
            for residual, trial in zip(fit.residual, trials, strict=True)
        ]
        if min(left) < -DIFFERING_SDS and max(left) > DIFFERING_SDS:
            found.append(sensor.channel)
    return tuple(found)


def _standard_errors_off(left: Float[np.ndarray, " time"]) -> float:
    """Mean of a residual, in standard errors by the scatter of the means of its blocks."""
    if len(left) < BLOCKS:
        return 0.0
    means = np.array([block.mean() for block in np.array_split(left, BLOCKS)])
    error = means.std(ddof=1) / np.sqrt(BLOCKS)
    return float(means.mean() / error) if error > 0 else 0.0


def _of_inputs(
    description: Description, kinds: Mapping[str, Kind]
) -> tuple[Mapping[str, Any], ...]:
    if OFFSET not in kinds or not has_rigid_motion(description):
        return ()
    has = {str(e.get("input")) for e in description.effects if e["effect"] == OFFSET}
    return tuple(
        {"effect": OFFSET, "input": entry.channel, "bias": 0.0}
        for entry in description.inputs
        if entry.channel not in has
    )


def _of_sensors(
    description: Description, kinds: Mapping[str, Kind]
) -> tuple[Mapping[str, Any], ...]:
    if SENSOR_OFFSET not in kinds:
        return ()
    has = {str(e.get("sensor")) for e in description.effects if e["effect"] == SENSOR_OFFSET}
    return tuple(
        {"effect": SENSOR_OFFSET, "sensor": sensor.channel, "bias": 0.0}
        for sensor in description.sensors
        if sensor.quantity in ("displacement", "velocity") and sensor.channel not in has
    )


def offsets(
    fit: Fit, trials: Sequence[Trial], given: Description, kinds: Mapping[str, Kind]
) -> list[NamedEffect]:
    """List the offsets added to the given model that differ significantly from zero."""
    found = []
    for number, effect in enumerate(fitted_effects(fit)):
        if number < len(given.effects):
            continue
        if effect.kind == BY_RECORD:
            found.append(_by_record(fit, trials, number, effect, kinds))
            continue
        if effect.kind not in (OFFSET, SENSOR_OFFSET):
            continue
        numbers = numbers_of(fit, number)
        if abs(numbers["bias"].value) <= REPORTED_SDS * numbers["bias"].sd:
            continue
        found.append(quoted(effect, numbers, kinds[effect.kind], 0.99))
    return found


def with_mean_offsets(fit: Fit) -> Fit:
    """Let offsets by record be those from their mean, which a record without one has."""
    values = fit.values.copy()
    states = [state.copy() for state in fit.states]
    names = fit.plant.state_names
    for number, effect in enumerate(fit.plant.effects):
        if effect.kind != BY_RECORD:
            continue
        at = names.index(("internal", f"{effect.kind} {number}.1"))
        mean = float(np.mean([state[at] for state in states if state.size]))
        values[fit.plant.parameters.index(("effect", number, "bias"))] += mean
        for state in states:
            if state.size:
                state[at] -= mean
    return dataclasses.replace(fit, values=values, states=tuple(states))


def _by_record(
    fit: Fit, trials: Sequence[Trial], number: int, effect: Effect, kinds: Mapping[str, Kind]
) -> NamedEffect:
    """Quote the offset of a sensor in each record."""
    kind = kinds[effect.kind]
    at = fit.plant.state_names.index(("internal", f"{effect.kind} {number}.1"))
    common = fit.values[fit.plant.parameters.index(("effect", number, "bias"))]
    unit = unit_at(fit.plant.description, effect.place, OF_SENSOR)
    spread = initial_state_sds(fit, trials)
    wide = np.sqrt(max(fit.chi2_in_band, 1.0))
    numbers = {
        f"record {i + 1}": Number(float(common + state[at]), float(wide * sd[at]), unit)
        for i, (state, sd) in enumerate(zip(fit.states, spread, strict=True))
    }
    told = ", ".join(f"{name} {one.text}" for name, one in numbers.items())
    return NamedEffect(
        effect=effect,
        family=kind.family,
        numbers=numbers,
        probability=0.99,
        rivals=(),
        sentence=f"{kind.words} at {effect.place}: {told}. {kind.sentence}",
    )
