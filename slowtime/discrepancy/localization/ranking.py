"""Ranking of all places by the likelihood of an unknown force there."""

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.workers import map_shared
from slowtime.dynamics.description import Matrix
from slowtime.dynamics.effects import Place, SensorChange

from .gain_probability import gain_probability
from .latent_force import ROUNDS, Explanation, LatentForceSolver, PlaceEstimate
from .linear_response import ForceSource, LinearModel
from .noise_update import noise_log_likelihood, update_noise
from .perturbed_reference import LinearConstants, PerturbedReference
from .places import Localization, PlaceGroup
from .spectral_lines import OuterMotion, TrialLines, trial_lines

BAND_MARGIN = 1.5
"""[1] Times the frequency above which the structure is silent up to which lines are used.
Source: docs/what_decides.md: half and double change no answer."""

SAME_TRANSFER = 1e-9
"""[1] One minus the squared cosine between whole transfers, below which two places are one
to the sensors. Source: well above rounding errors (1e-16)."""

PARALLEL_TRANSFER = 1e-6
"""[1] One minus the cosine between transfers at every line, below which two places differ by
the spectrum of their force only. Source: well above rounding errors (1e-16)."""

PROBED_LINE = 64
"""[lines] Of which one is looked at first. Source: transfers that differ do so nearly
everywhere."""

NOISE_UPDATES = 2
"""[1] Times the noise is estimated again from what the best place leaves. Source:
docs/what_decides.md: half and double change no answer."""

REFINED_PLACES = 5
"""[places] That are refined to convergence. Source: docs/what_decides.md: half and double
change no answer."""
MOST_PLACES = 20
"""[places] That are ranked; the likeliest by one linearisation, where there are more. Source:
those of a chain of four masses; a bound on computing time."""
RELINEARISED_PLACES = 20
"""[places] That are linearised about the motion with a force there before they are ranked.
Source: those of a chain of four masses."""
LINEARISATION_PRODUCTS = 1e9
"""[products] Of columns with each other, in all linearisations about a place; of fewer places,
though not less than `REFINED_PLACES`, where each takes more. Source: a bound on computing time;
20 places of nine masses."""
MANY_COORDINATES = 26
"""[coordinates] Of a reduced model, from which on fewer places are refined, in fewer rounds.
Source: a bound on computing time; reduced models of 200 masses have 30 to 40, and one round
takes a second."""
RANKING_ROUNDS = 2
"""[1] Linearisations that decide which places these are. Source: docs/what_decides.md: half and
double change no answer."""


def locate(
    fit: Fit, trials: Sequence[Trial], among: Sequence[Place] | None = None
) -> Localization:
    """Rank all places by the likelihood of one unknown force there.

    The force is random, of any strength in every band of every trial; constants may move within
    their tolerance, and the noise is estimated again from what the likeliest force leaves.
    Linear effects of the reference take part in the responses; others are kept as in its run.
    """
    first, runs, outer = linearise(fit, tuple(trials))
    records, linear = tuple(trials), first.linear
    solver, order = _rank_families(fit, records, first, _families(first, among))
    none = _likelihood_without_force(*dict.fromkeys((first, solver)))
    groups = _groups(fit, solver, order, none)
    return Localization(
        groups=groups,
        linear=linear,
        trials=records,
        lines=solver.trials,
        runs=runs,
        outer=outer,
        outputs=fit.outputs,
        nominal={name: float(fit.prior.mean[i]) for i, name in linear_names(fit)},
        tolerance={name: float(fit.prior.sd[i]) for i, name in linear_names(fit)},
        log_likelihood=none + max(groups[0].score, 0.0),
    )


def likeliest_places(fit: Fit, trials: Sequence[Trial], most: int) -> list[Place]:
    """Give the first places by one linearisation and the noise of the fit, one of a family."""
    solver, _, _ = linearise(fit, tuple(trials))
    order, _ = _sort_by_likelihood(solver, _equivalent_sources(solver), 0, 1)
    return [family[0].place for family in order[:most]]


def linearise(
    fit: Fit, records: tuple[Trial, ...]
) -> tuple[
    LatentForceSolver,
    tuple[Float[np.ndarray, "order time dof"], ...],
    tuple[OuterMotion, ...],
]:
    """Linearise about the run of a reference; give its motion and that of the outside, too."""
    linear = LinearModel.of_plant(fit.plant, fit.values)
    moved = [_motion(fit, trial, i) for i, trial in enumerate(records)]
    runs, outer = tuple(one for one, _ in moved), tuple(one for _, one in moved)
    lines = tuple(
        trial_lines(
            linear,
            trial,
            residual,
            run,
            fit.noise,
            i,
            BAND_MARGIN * fit.silent_above_hz,
            outer[i],
        )
        for i, (trial, residual, run) in enumerate(
            zip(records, _clock_corrected(fit, records), runs, strict=True)
        )
    )
    return LatentForceSolver(linear, _linear_constants(fit, linear), lines), runs, outer


def _families(
    solver: LatentForceSolver, among: Sequence[Place] | None
) -> list[list[ForceSource]]:
    """List sources of force, those together whose transfers are proportional."""
    families = _equivalent_sources(solver)
    if among is None:
        return families
    return [f for f in families if any(source.place in among for source in f)]


def _rank_families(
    fit: Fit,
    records: tuple[Trial, ...],
    solver: LatentForceSolver,
    families: list[list[ForceSource]],
) -> tuple[LatentForceSolver, list[tuple[list[ForceSource], Explanation]]]:
    """Rank all families, update the noise from what the best leaves, and refine the best."""
    order = families
    keen = _relinearised_places(solver)
    many = _is_reduced(solver)
    refined, rounds = (2, RANKING_ROUNDS) if many else (REFINED_PLACES, ROUNDS)
    if len(order) > min(keen, MOST_PLACES):
        order, _ = _sort_by_likelihood(solver, order, 0, 1)
        order = order[:MOST_PLACES]
    order, _ = _sort_by_likelihood(solver, order, keen, RANKING_ROUNDS)
    updates = min(NOISE_UPDATES, 1) if many else NOISE_UPDATES
    for _ in range(updates if len(solver.linear.description.sensors) > 1 else 0):
        order, best = _sort_by_likelihood(solver, order, 1, rounds)
        quiet = update_noise(fit, records, solver.trials, best.explained)
        solver = LatentForceSolver(solver.linear, solver.known, quiet)
        order, _ = _sort_by_likelihood(solver, order, refined, RANKING_ROUNDS)
    explained = map_shared(
        lambda i: solver.explain(order[i][0], rounds=rounds if i < refined else 1),
        range(len(order)),
        _shared(solver, order),
    )
    found = list(zip(order, explained, strict=True))
    return solver, sorted(found, key=lambda pair: -pair[1].likelihood)


def _relinearised_places(solver: LatentForceSolver) -> int:
    """Give the number of places that are linearised about the motion with a force there."""
    columns = [white.columns.shape for white in solver.white]
    products = sum(lines * sensors * count**2 for lines, sensors, count in columns)
    most = int(LINEARISATION_PRODUCTS / products)
    least = 2 if _is_reduced(solver) else REFINED_PLACES
    return min(max(most, least), RELINEARISED_PLACES)


def _is_reduced(solver: LatentForceSolver) -> bool:
    """Whether a model of many coordinates was reduced, so that a round takes long."""
    reduced = any(isinstance(part, Matrix) for part in solver.linear.description.elements)
    return reduced and solver.linear.structure.dofs >= MANY_COORDINATES


def _likelihood_without_force(*solvers: LatentForceSolver) -> float:
    """Log likelihood without any force, under the better of several estimates of the noise."""
    return max(
        solver.iterate(None, rounds=ROUNDS).likelihood + noise_log_likelihood(solver.trials)
        for solver in solvers
    )


def _groups(
    fit: Fit,
    solver: LatentForceSolver,
    order: list[tuple[list[ForceSource], Explanation]],
    none: float,
) -> tuple[PlaceGroup, ...]:
    constant = noise_log_likelihood(solver.trials)
    bands = sum(trial.bands for trial in solver.trials)
    families = [family for family, _ in order]
    groups = []
    parallel = _parallel_places(families, solver.tuned[0])
    for (family, found), twins in zip(order, parallel, strict=True):
        score = found.likelihood + constant - none
        groups.append(
            PlaceGroup(
                places=tuple(source.place for source in family),
                score=score,
                p_value=gain_probability(score, bands, len(families)),
                share=_explained_share(solver.trials, found),
                left=_remaining_power(solver.trials, found),
                constants=_constant_changes(fit, found),
                explained=found,
                twins=twins,
            )
        )
    return tuple(groups)


def _sort_by_likelihood(
    solver: LatentForceSolver, families: list[list[ForceSource]], keen: int, rounds: int
) -> tuple[list[list[ForceSource]], PlaceEstimate]:
    """Sort families by likelihood, the first `keen` by all rounds; give the likeliest, too."""
    made: dict[int, PlaceEstimate] = {}
    asked = [(family[0].place, rounds if i < keen else 1) for i, family in enumerate(families)]

    def likelihood(number: int) -> float:
        source = families[number][0]
        made[number] = solver.iterate(source, rounds=asked[number][1])
        return made[number].likelihood

    known = solver.likelihoods
    open_ones = [i for i, one in enumerate(asked) if one not in known]
    found = map_shared(likelihood, open_ones)
    known.update(zip([asked[i] for i in open_ones], found, strict=True))
    order = sorted(range(len(families)), key=lambda i: -known[asked[i]])
    if order[0] not in made:  # estimated before, or by another process
        likelihood(order[0])
    return [families[i] for i in order], made[order[0]]


def _shared(
    solver: LatentForceSolver, families: Sequence[Sequence[ForceSource]]
) -> tuple[object, ...]:
    """List what estimates refer to: they are large, and the same objects in all."""
    sources = (source for family in families for source in family)
    return (solver, solver.linear, solver.known, *solver.trials, *sources)


def _motion(
    fit: Fit, trial: Trial, number: int
) -> tuple[Float[np.ndarray, "order time dof"], OuterMotion]:
    run = fit.plant.run(
        fit.values,
        trial.inputs,
        trial.rate_hz,
        state0=fit.states[number],
        start_s=trial.start_s,
    )
    dofs = len(fit.plant.matrices.names)
    inner = [
        run.states[:, :dofs], run.states[:, dofs : 2 * dofs], run.rates[:, dofs : 2 * dofs]
    ]  # fmt: skip
    supports = np.zeros((3, len(run.times), len(run.supports)))
    for k, series in enumerate(run.supports.values()):
        supports[:, :, k] = series
    return np.stack(inner), OuterMotion(run.base, supports)


def _clock_corrected(
    fit: Fit, trials: tuple[Trial, ...]
) -> list[Float[np.ndarray, "time sensor"]]:
    """Residual of each trial; where a clock was found wrong, as a right one tells it."""
    values = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    channels = [sensor.channel for sensor in fit.plant.description.sensors]
    found = [residual.copy() for residual in fit.residual]
    for number, effect in enumerate(fit.plant.effects):
        kind = fit.plant.kinds[effect.kind]
        if not isinstance(kind.action, SensorChange) or kind.action.undo is None:
            continue
        own = np.array([values["effect", number, name] for name in kind.names])
        at = channels.index(effect.place.id)
        for trial, residual in zip(trials, found, strict=True):
            times = trial.start_s + np.arange(len(residual)) / trial.rate_hz
            residual[:, at] = kind.action.undo(residual[:, at], times, own)
    return found


def linear_names(fit: Fit) -> list[tuple[int, tuple[str, str]]]:
    """Free constants of the linear part, with their places among the free ones."""
    return [
        (i, (name[0], str(name[1])))
        for i, name in enumerate(fit.prior.names)
        if name[0] != "effect"
    ]


def _linear_constants(fit: Fit, linear: LinearModel) -> LinearConstants:
    chosen = linear_names(fit)
    index = [i for i, _ in chosen]
    now, mean, sd = fit.free[index], fit.prior.mean[index], fit.prior.sd[index]
    return LinearConstants.of(
        linear, tuple(name for _, name in chosen), (now - mean) / now, sd / now
    )


def _constant_changes(fit: Fit, found: Explanation) -> dict[tuple[str, str], float]:
    return {
        name: float(fit.free[i] * (1 + change) / fit.prior.mean[i] - 1)
        for (i, name), change in zip(linear_names(fit), found.constants, strict=True)
    }


def _equivalent_sources(solver: LatentForceSolver) -> list[list[ForceSource]]:
    """Group sources whose transfers are proportional."""
    families: list[tuple[np.ndarray, list[ForceSource]]] = []
    tuned = solver.tuned[0]
    for source in solver.linear.sources():
        seen = (tuned.transfer(source) / np.sqrt(tuned.trial.noise)).ravel()
        size = np.linalg.norm(seen)
        if size == 0:
            continue
        seen = seen / size
        for direction, family in families:
            if 1 - abs(np.vdot(direction, seen)) ** 2 < SAME_TRANSFER:
                family.append(source)
                break
        else:
            families.append((seen, [source]))
    return [family for _, family in families]


def _parallel_places(
    families: list[list[ForceSource]], tuned: PerturbedReference
) -> list[tuple[Place, ...]]:
    """Places of other families whose transfer is parallel at every line, of each family."""
    root = np.sqrt(tuned.trial.noise)
    units = [tuned.transfer(family[0]) / root for family in families]
    norms = [np.linalg.norm(unit, axis=1) for unit in units]
    few = slice(None, None, PROBED_LINE)

    def are_parallel(i: int, j: int) -> bool:
        for lines in (few, slice(None)):
            both = norms[i][lines] * norms[j][lines]
            along = np.einsum("fs,fs->f", units[i][lines].conj(), units[j][lines])
            if np.any(both - np.abs(along) > PARALLEL_TRANSFER * both):
                return False
        return True

    found: list[list[Place]] = [[] for _ in families]
    for i, j in itertools.combinations(range(len(families)), 2):
        if are_parallel(i, j):
            found[i].extend(source.place for source in families[j])
            found[j].extend(source.place for source in families[i])
    return [tuple(places) for places in found]


def _explained_share(trials: tuple[TrialLines, ...], found: Explanation) -> float:
    """Share of the power beyond noise that the force explains."""
    before = after = 0.0
    for trial, force in zip(trials, found.forces, strict=True):
        heard = _recorded_sensors(trial)
        before += float(np.sum((np.abs(force.left) ** 2 / trial.noise - 1)[:, heard]))
        after += float(np.sum((force.noise_power() / trial.noise - 1)[:, heard]))
    return float(np.clip(1 - after / before, 0, 1)) if before > 0 else 0.0


def _recorded_sensors(trial: TrialLines) -> Bool[np.ndarray, " sensor"]:
    """Mask of the sensors with any used sample."""
    if trial.gaps is None:
        return np.ones(trial.noise.shape[1], dtype=bool)
    return np.asarray(~trial.gaps.all(axis=0))


def _remaining_power(trials: tuple[TrialLines, ...], found: Explanation) -> float:
    """Mean expected power of the residual over the noise, of sensors with used samples."""
    power = [
        (f.noise_power() / t.noise)[:, _recorded_sensors(t)].mean()
        for t, f in zip(trials, found.forces, strict=True)
        if _recorded_sensors(t).any()
    ]
    return float(np.mean(power)) if power else 1.0
