"""Diagnosis of a large model by a reduced one, told as one of the large model."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, prior_of, refit, try_refit
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.diagnosis import Diagnosis, Number
from slowtime.discrepancy.localization.ranking import linearise
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.channels import BASE_KINDS
from slowtime.dynamics.description import Beam, Description, Matrix, Spring, assemble
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.plant import Plant

from .basis import MODE_MARGIN, BandModes, band_limit_hz
from .constants import main_directions, tolerances_of
from .reduction import ReducedModel, constant_values, kept_points, reduce_model
from .screening import likeliest_parts

MOST_COORDINATES = 40
"""[coordinates] Of a model that is diagnosed as it is. Source: with all constants free, one
linearisation of 24 masses over 60 s at 100 Hz takes a second, and a search some hundreds."""
MOST_MODES = 60
"""[modes] Within the band of the inputs. Source: one linearisation takes a quarter of a second
with 19 and grows with their square; a search takes a hundred."""
NOTE = (
    "The model of {coordinates} coordinates was diagnosed in {few}: its modes in the band of "
    "the inputs, and static shapes. {constants} constants were varied in the {combinations} "
    "combinations that the records tell from noise, and a force was tried between all {pairs} "
    "pairs of points. A run of the whole model with this answer differs from one of the "
    "reduced model by {share:.2g} of what was measured at most."
)


def is_large(description: Description) -> bool:
    """Whether a model has too many coordinates to be diagnosed in all of them."""
    return bool(description.inputs) and len(description.dofs) > MOST_COORDINATES


def reasons_against(description: Description) -> str:
    """Say why a model cannot be reduced to a band; empty where it can."""
    if description.moved:
        return "points beside the base that inputs or supports move"
    if any(entry.kind not in (*BASE_KINDS, "force") for entry in description.inputs):
        return "inputs that are neither forces nor motion of the base"
    if any(one.quantity == "force" for one in description.sensors):
        return "sensors of force"
    if any(isinstance(part, Matrix) for part in description.elements):
        return "parts that are reduced already"
    if not all(isinstance(part, Spring | Beam) for part in description.elements):
        return "parts that are neither springs nor beams"
    return ""


def reduce_for(
    large: Description, trials: Sequence[Trial], kinds: Mapping[str, Kind], tell: Monitor
) -> ReducedModel:
    """Reduce a model to what its records show, with the places where something may be missing.

    Raises
    ------
    ValueError
        Where too many modes lie within the band of the inputs.
    """
    records = tuple(trials)
    tell("finding the modes within the band of the inputs", 0.02)
    modes, start, bare = _start(large, records, kinds)
    tell("combining the constants of the model", 0.03)
    solver = linearise(start, records)[0]
    whole = reduce_model(large, modes, main_directions(solver, bare.basis, large, ()))
    claimed = _with_constants(start, Plant.of(whole.small, kinds=kinds))
    tell("comparing a force between any two points", 0.04)
    # Held within tolerances, constants would leave what is no linear response to any change.
    fit = try_refit(claimed.plant, records)
    about_fit = None if fit is None else linearise(fit, records)[0]
    kept = likeliest_parts(linearise(claimed, records)[0], about_fit, large, whole.basis)
    own = {*kept.elements, *kept_points(large, kept)}
    found = reduce_model(large, modes, main_directions(solver, bare.basis, large, own), kept)
    if fit is None:
        return found
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    fitted = whole.constants_at(with_values(whole.small, values))
    return dataclasses.replace(found, fitted=fitted)


def fit_constants(reduced: ReducedModel, plant: Plant, trials: Sequence[Trial]) -> Fit:
    """Fit a plant of the reduced description from its constants as claimed, and as fitted."""
    # Where resonances are off by their widths, a fit may end far from the optimum: of two
    # starts the one that ends at less is taken.
    first = refit(plant, trials)
    if not reduced.fitted:
        return first
    values = reduced.fitted_values(plant)
    # From rest, the first steps would bend constants for what initial states are off by.
    still = try_refit(plant, trials, free=[], noise=first.noise, values=values, horizons=(1.0,))
    if still is None:
        return first
    other = try_refit(
        plant, trials, noise=first.noise, values=values, states=still.states, horizons=(1.0,)
    )
    if other is None or first.cost <= other.cost:
        return first
    # The noise was estimated from what the worse fit left.
    return refit(plant, trials, values=other.values, states=other.states, horizons=(1.0,))


def reduce_plainly(
    large: Description, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> ReducedModel:
    """Reduce a model to what its records show, with its sensors and inputs alone."""
    records = tuple(trials)
    modes, start, bare = _start(large, records, kinds)
    solver = linearise(start, records)[0]
    return reduce_model(large, modes, main_directions(solver, bare.basis, large, ()))


def _start(
    large: Description, records: tuple[Trial, ...], kinds: Mapping[str, Kind]
) -> tuple[BandModes, Fit, ReducedModel]:
    """Reduce a model with its constants as claimed, and fit initial states."""
    band_hz = band_limit_hz(records)
    modes = BandModes.of(assemble(large), band_hz)
    if modes.kept > MOST_MODES:
        raise ValueError(
            f"{modes.kept} modes of the model lie below {MODE_MARGIN:g} times {band_hz:.3g} "
            f"Hz, up to which inputs drive it; at most {MOST_MODES} are allowed. Filter and "
            "resample the records to a lower band, or run `slowtime model reduce` on the model."
        )
    bare = reduce_model(large, modes, {})
    start = refit(Plant.of(bare.small, kinds=kinds), records, free=[], horizons=(1.0,))
    return modes, start, bare


def _with_constants(start: Fit, plant: Plant) -> Fit:
    """Give a fit constants that may be off, at their claimed values."""
    return dataclasses.replace(start, plant=plant, prior=prior_of(plant), values=plant.values)


def enlarge(
    answer: Diagnosis, reduced: ReducedModel, trial: Trial, kinds: Mapping[str, Kind]
) -> Diagnosis:
    """Tell a diagnosis of a reduced model as one of the large model.

    Its traces are those of the large model, with what was found.
    """
    augmented = reduced.enlarged(answer.augmented)
    off = _truncation_share(answer.augmented, augmented, trial, kinds)
    told = NOTE.format(
        coordinates=len(reduced.large.dofs), few=len(reduced.small.dofs),
        constants=sum(len(one.constants) for one in reduced.directions.values()),
        combinations=sum(one.mixture.shape[1] for one in reduced.directions.values()),
        pairs=len(reduced.large.dofs) * (len(reduced.large.dofs) + 1) // 2, share=off,
    )  # fmt: skip
    return dataclasses.replace(
        answer,
        nominal=reduced.large,
        refitted=reduced.enlarged(answer.refitted),
        augmented=augmented,
        moved=_moved(answer.moved, reduced, answer.augmented),
        notes=(*answer.notes, told),
    )


def _truncation_share(
    small: Description, large: Description, trial: Trial, kinds: Mapping[str, Kind]
) -> float:
    """Difference of two models' readings over the scatter measured [1], at the worst sensor."""
    made = [
        plant.simulate(plant.values, trial.inputs, trial.rate_hz)
        for plant in (Plant.of(one, kinds=kinds) for one in (small, large))
    ]
    # At first, modes above the band ring from the jump out of rest.
    later = slice(len(trial.inputs) // 2, None)
    scatter = np.maximum(trial.measured[later].std(axis=0), np.finfo(float).tiny)
    return float((np.std((made[1] - made[0])[later], axis=0) / scatter).max())


def _moved(
    moved: Mapping[str, Number], reduced: ReducedModel, fitted: Description
) -> dict[str, Number]:
    """Name constants for combinations of them that left their tolerance."""
    found = {name: one for name, one in moved.items() if " direction " not in name}
    values, stated = reduced.constants_at(fitted), constant_values(reduced.large)
    tolerances = tolerances_of(reduced.large)
    for what, directions in reduced.directions.items():
        names = [n for n in moved if n.startswith(f"{what} {what} direction ")]
        if not names:
            continue
        pulls = [
            abs(values[one] / stated[one] - 1) / tolerances[what] if stated[one] else 0.0
            for one in directions.constants
        ]
        far = [i for i, pull in enumerate(pulls) if pull > LIMITS.moved_tolerances]
        for i in far or [int(np.argmax(pulls))]:
            name = directions.constants[i]
            sd = tolerances[what] * abs(stated[name])
            found[f"{name[0]} {name[1]}"] = Number(values[name], sd, _unit(reduced, name))
    return found


def _unit(reduced: ReducedModel, name: tuple[str, str]) -> str:
    return Plant.of(reduced.large).entries[name].unit
