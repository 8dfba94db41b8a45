"""Fit of a force surface, for records that no law of the catalogue explains."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.special import chdtri

from slowtime.discrepancy.calibration import (
    Fit,
    FitControl,
    attempt,
    prior_of,
    shooting_fit,
    try_refit,
)
from slowtime.discrepancy.calibration.augmentation import augmented_start
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.library_fit import start_with_force
from slowtime.discrepancy.estimation.model_evidence import misfit
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.discrepancy.time_limit import budget_share, leave_out
from slowtime.dynamics.effects import Effect, Kind, Place, force_along
from slowtime.dynamics.effects.library.measured_force import MEMORY_SCALES, MEMORY_TERMS, TERMS
from slowtime.dynamics.plant import Name, Plant
from slowtime.dynamics.work import WorkMeter, metered

from .regression import Regression
from .scales import fixed_scales
from .shape import ANY_SHAPE, AUTO, FREE, SurfaceDemand, SurfaceShape
from .shape_choice import MAX_LOSS, ShapedRegression, choose_shape

KIND, WITH_MEMORY = "measured_force", "measured_force_with_memory"
MAX_WORK = 4e8
"""[units of work] That the fit of a surface may cost, beside the budget of the search
(`slowtime.dynamics.work`). Source: a decision: some twenty seconds, as derivatives of a law of
some twenty coefficients are not counted. With 1.5e9 the surface of one hysteretic rig took
twice as long, and its free run left as much."""
HORIZONS = (0.05, 0.15, 0.4)
"""[share of each record] Fitted one after the other before the whole, where the free run of the
recovered force loses its phase in the whole. Source: docs/what_decides.md: half and double
change no answer."""

MAX_LEFT = 0.1
"""[share of the variance of the motion] That a surface may leave before parts or segments are
fitted first. Source: a third of the amplitude, as a run out of phase leaves."""

MIN_P_VALUE = 1e-3
"""[probability] Of what the demanded shape leaves beyond a surface of any shape, were it right,
below which it is given up. Source: rarer than the diagnoses in which it is demanded."""

Late = Callable[[], bool]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SurfaceFit:
    """A model with a measured force surface as its last effect.

    Parameters
    ----------
    shaped
        Terms that were chosen on the recovered force, the shape of the surface, and demands
        that the records contradict.
    """

    place: Place
    fit: Fit
    free: tuple[Name, ...]
    finished: bool
    shaped: ShapedRegression

    @property
    def shape(self) -> SurfaceShape:
        """Shape of the surface."""
        return self.shaped.shape

    @property
    def regression(self) -> Regression:
        """Terms that were chosen on the recovered force."""
        return self.shaped.terms


def fit_force_surface(
    before: Fit,
    localized: Localization,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    *,
    max_work: float = MAX_WORK,
    demand: SurfaceDemand = AUTO,
    flat: bool = False,
) -> SurfaceFit | None:
    """Fit a force surface at the likeliest element, with all constants, to the free run.

    The budget `max_work` [units of work] is that of a diagnosis without a shorter time limit,
    which gets its share of it; as much again where that fit ends in a wrong minimum, or leaves
    more than noise with the shape that was demanded or chosen. A `flat` surface begins without
    the force instead of with the recovered one. None where no element is likely, no force is
    told from noise, or the free run diverges.
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
    max_work *= budget_share()
    shaped = _chosen_terms(kinds, scales, space, demand)
    if shaped is None:
        return None
    if flat:
        return _from_no_force(shaped, before, place, trials, kinds, max_work)
    found = _fit_terms(shaped, before, space, trials, kinds, max_work)
    if shaped.shape == FREE:
        return found
    if found is not None and _is_at_the_noise(found.fit):
        return found
    if leave_out("a force surface of any shape beside that of the chosen shape"):
        return found
    free = _chosen_terms(kinds, scales, space, ANY_SHAPE)
    assert free is not None
    other = _fit_terms(free, before, space, trials, kinds, max_work)
    return _better_of(found, other, shaped, trials, demanded=not demand.is_any)


def _better_of(
    found: SurfaceFit | None,
    other: SurfaceFit | None,
    shaped: ShapedRegression,
    trials: Sequence[Trial],
    *,
    demanded: bool,
) -> SurfaceFit | None:
    """Give up a shape where the free run of a surface without it fits far better."""
    if other is None:
        return found
    loss = np.inf
    if found is not None:
        costs = [
            misfit(one.fit, other.fit.noise, trials) + one.fit.prior.cost(one.fit.free)
            for one in (found, other)
        ]
        loss = (costs[0] - costs[1]) / max(other.fit.chi2_in_band, 1.0) / 2
        more = max(len(other.free) - len(found.free), 1)
        if loss <= max(MAX_LOSS, float(chdtri(more, MIN_P_VALUE)) / 2):
            return found
    # That the records contradict a shape is told where somebody demanded it.
    if not demanded:
        return other
    refused = (*shaped.refused, (shaped.shape.words, loss))
    return dataclasses.replace(other, shaped=dataclasses.replace(other.shaped, refused=refused))


def _fit_terms(
    shaped: ShapedRegression,
    before: Fit,
    space: ForceSpace,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    max_work: float,
) -> SurfaceFit | None:
    """Fit a surface of chosen terms, with all constants; None where its free run diverges."""
    terms = shaped.terms
    # Leading terms are fitted first. Many small ones are there only because the recovered
    # motion is not exact, and with them a free run may diverge before they are fitted.
    led = _fit_from_force(shaped, terms.leading, before, space, trials, kinds, max_work)
    if terms.leading.keys() == terms.coefficients.keys():
        return led
    if led is None or _share_left(led.fit, trials) > MAX_LEFT:
        whole = _fit_from_force(
            shaped, terms.coefficients, before, space, trials, kinds, max_work
        )
    elif _is_at_the_noise(led.fit) or leave_out("small terms of the force surface"):
        return led
    else:
        whole = _fit_further(led, trials, max_work)
    fits = [one for one in (led, whole) if one is not None]
    return min(fits, key=lambda one: _share_left(one.fit, trials), default=None)


def _fit_from_force(
    shaped: ShapedRegression,
    coefficients: Mapping[str, float],
    before: Fit,
    space: ForceSpace,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    max_work: float,
) -> SurfaceFit | None:
    """Fit some coefficients, from their values on the recovered force."""
    found, place = dataclasses.replace(shaped.terms, coefficients=coefficients), space.place
    forces = [force_along(found.kind, found.parameters, m.motion) for m in space.latents]
    start = start_with_force(before, space.lines_of([f[:, None] for f in forces]), space)
    # Coefficients stay zero in the description, as the mean of their prior.
    effect = Effect(found.kind.name, place, dict(found.scales))
    plant, values, states = augmented_start(before, effect, kinds, start)
    number = len(plant.effects) - 1
    for name, value in coefficients.items():
        values[plant.parameters.index(("effect", number, name))] = value
    free = _free_names(plant, found)
    with metered() as meter:
        late, later = _late(meter, max_work), _late(meter, 2 * max_work)
        fit, finished = fit_stages(plant, trials, before.noise, free, values, states, late)
        lost = fit is None or (finished and _share_left(fit, trials) > MAX_LEFT)
        if lost and not leave_out("a force surface by segments of the records"):
            other = _from_segments(plant, trials, before.noise, free, values, later)
            if other is not None and (
                fit is None or _share_left(other, trials) < _share_left(fit, trials)
            ):
                fit, finished = other, True
    return None if fit is None else SurfaceFit(place, fit, free, finished, shaped)


def _fit_further(
    led: SurfaceFit, trials: Sequence[Trial], max_work: float
) -> SurfaceFit | None:
    """Fit all coefficients, from where the leading ones ended."""
    fit = led.fit
    free = _free_names(fit.plant, led.regression)
    with metered() as meter:
        whole, finished = fit_stages(
            fit.plant, trials, fit.noise, free, fit.values, fit.states,
            _late(meter, max_work),
        )  # fmt: skip
    return (
        None
        if whole is None
        else dataclasses.replace(led, fit=whole, free=free, finished=finished)
    )


def _is_at_the_noise(fit: Fit) -> bool:
    """Whether a fit leaves no more than noise, within three standard deviations."""
    return fit.chi2_in_band < 1 + 3 * fit.in_band_sd


def _chosen_terms(
    kinds: Mapping[str, Kind],
    scales: Mapping[str, float],
    space: ForceSpace,
    demand: SurfaceDemand,
) -> ShapedRegression | None:
    """Choose shape and terms; without terms of memory, the kind that has none runs faster."""
    groups = {
        group: tuple(name for name, _ in terms) for group, terms in (*TERMS, *MEMORY_TERMS)
    }
    found = choose_shape(kinds[WITH_MEMORY], scales, groups, space, demand)
    memory = {group for group, _ in MEMORY_TERMS}
    if found is None or any(block.group in memory for block in found.terms.blocks):
        return found
    gone = {parameter.name for parameter in MEMORY_SCALES}
    kept = {name: value for name, value in found.terms.scales.items() if name not in gone}
    terms = dataclasses.replace(found.terms, kind=kinds[KIND], scales=kept)
    return dataclasses.replace(found, terms=terms)


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

    Gives the fit of whole records, None where their free run diverges, and whether all stages
    came to their end. The noise of the whole is estimated from what the surface leaves.
    """
    reached = [(values, states)]
    in_phase = _share_of_run(plant, trials, values, states) < MAX_LEFT
    for share in (1.0,) if in_phase else (*HORIZONS, 1.0):
        parts = [_head(trial, share) for trial in trials]
        fit = try_refit(
            plant, parts, noise=noise if share < 1 else None, free=free,
            values=reached[-1][0], states=reached[-1][1], horizons=(1.0,),
            control=FitControl(is_late=late, keeps_best=True),
        )  # fmt: skip
        if fit is None:
            continue
        if share == 1.0:
            return fit, not late()
        reached.append((fit.values, fit.states))
        if late():
            break
    # What fits the beginning of a record best may run away later.
    values, states = min(reached, key=lambda point: _share_of_run(plant, trials, *point))
    fit = try_refit(plant, trials, free=[], values=values, states=states, horizons=(1.0,))
    return fit, False


def _share_of_run(
    plant: Plant, trials: Sequence[Trial], values: np.ndarray, states: Sequence[np.ndarray]
) -> float:
    """Largest share of the variance of a record that a free run leaves (infinite: diverged)."""
    shares = []
    for trial, state in zip(trials, states, strict=True):
        run = plant.simulate(
            values, trial.inputs, trial.rate_hz, state0=state if state.size else None,
            start_s=trial.start_s,
        )  # fmt: skip
        with np.errstate(over="ignore", invalid="ignore"):
            left = float(np.var(trial.measured - run, axis=0).sum())
        shares.append(left / float(np.var(trial.measured, axis=0).sum()))
    return max(shares) if np.isfinite(shares).all() else np.inf


def _share_left(fit: Fit, trials: Sequence[Trial]) -> float:
    """Share of the variance of the motion that a fit leaves."""
    left = sum(float(np.var(residual, axis=0).sum()) for residual in fit.residual)
    return left / sum(float(np.var(trial.measured, axis=0).sum()) for trial in trials)


def _from_segments(
    plant: Plant,
    trials: Sequence[Trial],
    noise: Noise,
    free: Sequence[Name],
    values: np.ndarray,
    late: Late,
) -> Fit | None:
    """Fit segments of a few periods first, then whole records (multiple shooting)."""
    # A stop that is harder than the spring changes the frequency so much that free runs over
    # growing parts of a record lose their phase. Over a few periods they do not.
    control = FitControl(is_late=late)
    shot = attempt(shooting_fit, plant, trials, noise, values, control, free)
    if shot is None:
        return None
    cut, states = shot
    return try_refit(
        plant, trials, free=free, values=cut.values, states=states, horizons=(1.0,),
        control=control,
    )  # fmt: skip


def _from_no_force(
    shaped: ShapedRegression,
    before: Fit,
    place: Place,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    max_work: float,
) -> SurfaceFit | None:
    """Fit whole records from the model without the force, its surface flat."""
    # The recovered force may give more energy than the structure loses, so that runs with it
    # grow without bound.
    found = shaped.terms
    effect = Effect(found.kind.name, place, dict(found.scales))
    plant, values, states = augmented_start(before, effect, kinds)
    free = _free_names(plant, found)
    with metered() as meter:
        late = _late(meter, max_work)
        fit = try_refit(
            plant, trials, free=free, values=values, states=states, horizons=(1.0,),
            control=FitControl(is_late=late, keeps_best=True),
        )  # fmt: skip
        finished = not late()
    return None if fit is None else SurfaceFit(place, fit, free, finished, shaped)


def _late(meter: WorkMeter, max_work: float) -> Late:
    """Say when a fit ends: by its own budget, or by the time limit of the diagnosis."""
    return lambda: meter.spent > max_work or leave_out("convergence of the force surface")


def _head(trial: Trial, share: float) -> Trial:
    count = len(trial.outputs)
    return (
        trial if share >= 1 else trial.part(0, max(int(share * count), min(MIN_SAMPLES, count)))
    )
