"""Fit of a force surface, for records that no law of the catalogue explains."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, FitAbandoned, FitControl, prior_of, refit
from slowtime.discrepancy.calibration.augmentation import augmented_start
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.library_fit import start_with_force
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.dynamics.effects import Effect, Kind, Place, force_along
from slowtime.dynamics.effects.library.measured_force import MEMORY_SCALES, MEMORY_TERMS, TERMS
from slowtime.dynamics.plant import Name, Plant
from slowtime.dynamics.work import metered

from .regression import Regression, choose_terms
from .scales import blocks_of, fixed_scales

KIND, WITH_MEMORY = "measured_force", "measured_force_with_memory"
MAX_WORK = 1.5e9
"""[units of work] That the fit of a surface may cost, beside the budget of the search
(`slowtime.dynamics.work`). Source: a decision: about a minute, as derivatives of a law of some
twenty coefficients, which are not counted, took nine times the counted steps in one profile."""
HORIZONS = (0.05, 0.15, 0.4)
"""[share of each record] Fitted one after the other, before the whole. Source: judgement; from
the regression on the recovered force, a free run keeps its phase for as long."""

Late = Callable[[], bool]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SurfaceFit:
    """A model with a measured force surface as its last effect.

    Parameters
    ----------
    place
        Element that the force acts in.
    fit
        Of the model, to whole records.
    free
        Names of the constants that were fitted.
    regression
        Terms that were chosen on the recovered force.
    finished
        Whether the fit came to its end within the budget.
    """

    place: Place
    fit: Fit
    free: tuple[Name, ...]
    regression: Regression
    finished: bool


def fit_force_surface(
    before: Fit,
    localized: Localization,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    *,
    max_work: float = MAX_WORK,
) -> SurfaceFit | None:
    """Fit a force surface at the likeliest element, with all constants, to the free run.

    Parameters
    ----------
    before
        Fit that the surface is added to.
    localized
        Where a force explains what that leaves.
    trials
        Records to fit.
    kinds
        Catalogue of effects by name.
    max_work
        Budget [units of work].

    Returns
    -------
    The fitted surface; None where no element is likely, no force is told from noise, or the
    free run diverges.
    """
    place = next(
        (p for group in localized.groups for p in group.places if p.kind == "element"), None
    )
    if place is None or KIND not in kinds:
        return None
    space = ForceSpace(before, localized, place)
    scales = fixed_scales(space.latents)
    if scales is None:
        return None
    found = _chosen_terms(kinds, scales, space)
    if found is None:
        return None
    forces = [force_along(found.kind, found.parameters, m.motion) for m in space.latents]
    start = start_with_force(before, space.lines_of([f[:, None] for f in forces]), space)
    # Coefficients stay zero in the description, as the mean of their prior.
    effect = Effect(found.kind.name, place, dict(found.scales))
    plant, values, states = augmented_start(before, effect, kinds, start)
    number = len(plant.effects) - 1
    for name, value in found.coefficients.items():
        values[plant.parameters.index(("effect", number, name))] = value
    free = _free_names(plant, found)
    with metered() as meter:
        fit, finished = fit_stages(
            plant, trials, before.noise, free, values, states, lambda: meter.spent > max_work
        )
    return None if fit is None else SurfaceFit(place, fit, free, found, finished)


def _chosen_terms(
    kinds: Mapping[str, Kind], scales: Mapping[str, float], space: ForceSpace
) -> Regression | None:
    """Choose terms; those without memory make a kind that has none, which runs faster."""
    groups = {
        group: tuple(name for name, _ in terms) for group, terms in (*TERMS, *MEMORY_TERMS)
    }
    found = choose_terms(kinds[WITH_MEMORY], scales, blocks_of(space.latents, groups), space)
    memory = {group for group, _ in MEMORY_TERMS}
    if found is None or any(block.group in memory for block in found.blocks):
        return found
    gone = {parameter.name for parameter in MEMORY_SCALES}
    kept = {name: value for name, value in found.scales.items() if name not in gone}
    return dataclasses.replace(found, kind=kinds[KIND], scales=kept)


def _free_names(plant: Plant, found: Regression) -> tuple[Name, ...]:
    """Names of the constants to fit: terms that were not chosen stay zero."""
    number = len(plant.effects) - 1
    return tuple(
        name
        for name in prior_of(plant).names
        if name[:2] != ("effect", number) or name[-1] in found.coefficients
    )


def fit_stages(
    plant: Plant,
    trials: Sequence[Trial],
    noise: Noise,
    free: Sequence[Name],
    values: np.ndarray,
    states: Sequence[np.ndarray],
    late: Late,
) -> tuple[Fit | None, bool]:
    """Fit growing parts of the records, and keep what was reached where the budget ends it.

    Parameters
    ----------
    plant, free
        The model, and the names of the constants that may move.
    trials
        Records to fit.
    noise
        Of the parts; that of the whole is estimated from what the surface leaves.
    values, states
        To start from.
    late
        Whether the budget is used up.

    Returns
    -------
    fit
        Of whole records; None where their free run diverges.
    finished
        Whether all stages came to their end.
    """
    for share in (*HORIZONS, 1.0):
        parts = [_head(trial, share) for trial in trials]
        try:
            fit = refit(
                plant, parts, noise=noise if share < 1 else None, free=free, values=values,
                states=states, horizons=(1.0,), control=FitControl(is_late=late),
            )  # fmt: skip
        except FitAbandoned:
            break
        except (FloatingPointError, np.linalg.LinAlgError):
            continue
        values, states = fit.values, fit.states
        if share == 1.0:
            return fit, True
    try:
        return refit(
            plant, trials, free=[], values=values, states=states, horizons=(1.0,)
        ), False
    except (FloatingPointError, np.linalg.LinAlgError):
        return None, False


def _head(trial: Trial, share: float) -> Trial:
    count = len(trial.outputs)
    return (
        trial if share >= 1 else trial.part(0, max(int(share * count), min(MIN_SAMPLES, count)))
    )
