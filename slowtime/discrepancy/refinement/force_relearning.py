"""Refit of a law whose place still shows a residual force, started from that force.

The fit of a free run may end in a local minimum. With the law included, the simulated motion
is nearly right, and a residual force at its place is what the law lacks. The sum of both
forces is the true one: the law is fitted to that sum along the motion, and its free run
starts from there.
"""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.optimize
from jaxtyping import Float

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, Fit, FitControl, try_refit
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.parameter_scan import concatenate_motions
from slowtime.discrepancy.estimation.candidate_fit import COARSE_HORIZONS
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind, Law, Motion, force_along

MIN_OTHER_REST_RATIO = 3.0
"""[1] Times what a force at the place of a law leaves, that a force anywhere else must leave.
Source: docs/what_decides.md: half and double change no answer."""
MAX_SAMPLES = 20_000
"""[samples] Of force and motion, to which a law is fitted. Source: a bound on computing
time."""
START_FACTORS = (1.0, 0.5, 2.0)
"""[1] On each parameter of a law, with which its fit to a force starts. Source:
docs/what_decides.md: half and double change no answer."""

MIN_LOG_POWER_GAIN = 0.1
"""[nats] By which the power of the residual of a sensor must fall, on average. Source:
docs/what_decides.md: half and double change no answer."""

Series = Float[np.ndarray, " time"]


def relearn_force(
    hypothesis: Hypothesis,
    before: Fit,
    located: Localization,
    kinds: Mapping[str, Kind],
    tell: Monitor,
) -> Hypothesis:
    """Fit a law again from the force recovered at its place; kept where it leaves less."""
    last, trials = hypothesis.last, hypothesis.trials
    whole = hypothesis.last_fits_whole_records and hypothesis.holds is None
    number = _incomplete_law(hypothesis, located, kinds)
    if number is None or not whole or last.chi2_in_band < WRONG_MODEL_CHI2 or tell.is_late:
        return hypothesis
    own = len(last.plant.effects) - len(hypothesis.effects)
    effect = fitted_effects(before)[own + number]
    tell(f"learning {effect.kind} at {effect.place} from its force", 0.5)
    force, motion = _recovered(before, effect, located, trials, kinds)
    learnt = law_of(kinds[effect.kind], effect, force, motion)
    begun = before.values.copy()
    for name, value in learnt.items():
        begun[last.plant.parameters.index(("effect", own + number, name))] = value
    names = last.plant.state_names
    space = ForceSpace(before, located, effect.place)
    states = [np.array([one.get(n, 0.0) for n in names]) for one in space.states]
    again = try_refit(
        last.plant, trials, values=begun, states=states, horizons=COARSE_HORIZONS,
        control=FitControl(is_late=lambda: tell.is_late),
    )  # fmt: skip
    least = unexplained_by(last) - MIN_LOG_POWER_GAIN * sum(r.shape[1] for r in last.residual)
    if again is None or unexplained_by(again) > least:
        return hypothesis
    return hypothesis.with_last(again, kinds)


def _incomplete_law(
    hypothesis: Hypothesis, located: Localization, kinds: Mapping[str, Kind]
) -> int | None:
    """Say which law it is, where a force at its place is all that is missing."""
    best, *others = located.groups
    if best.left > LIMITS.several_forces_chi2 or any(
        one.left < MIN_OTHER_REST_RATIO * best.left for one in others
    ):
        return None
    actions = [kinds[answer.effect.kind].action for answer in hypothesis.effects]
    there = [
        number
        for number, (answer, action) in enumerate(zip(hypothesis.effects, actions, strict=True))
        if answer.effect.place == best.places[0]
        and isinstance(action, Law)
        and not action.rates  # a force of the motion of the moment
    ]
    return there[-1] if there and best.places[0].kind == "element" else None


def _recovered(
    fit: Fit,
    effect: Effect,
    located: Localization,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> tuple[Series, Motion]:
    """Give the force of a law and what it lacks, and the motion that goes with both."""
    forces, motions = [], []
    for number, (trial, state) in enumerate(zip(trials, fit.states, strict=True)):
        run = fit.plant.states(
            fit.values, trial.inputs, trial.rate_hz,
            state0=state if state.size else None, start_s=trial.start_s,
        )[effect.place]  # fmt: skip
        latent = located.latent(effect.place, number)
        own = force_along(kinds[effect.kind], effect.parameters, run)
        forces.append(own + latent.force)
        motions.append(latent.motion)
    order = np.argsort([motion.times[0] for motion in motions], kind="stable")
    return np.concatenate([forces[i] for i in order]), concatenate_motions(motions)


def law_of(kind: Kind, effect: Effect, force: Series, motion: Motion) -> dict[str, float]:
    """Fit the parameters of a law to a force, beside a spring, a damper and a constant.

    Parameters at 0 stay there. None are given where one of them would not be allowed.

    Examples
    --------
    See `tests/slowtime/discrepancy/refinement/test_force_relearning.py`.
    """
    step = -(-len(force) // MAX_SAMPLES)
    some = Motion(
        e=motion.e[::step], v=motion.v[::step], a=motion.a[::step], times=motion.times[::step]
    )
    told = force[::step]
    fitted = [p.name for p in kind.parameters if p.fitted and effect.parameters[p.name] != 0]
    first = np.array([effect.parameters[name] for name in fitted])
    linear = np.stack([some.e, some.v, np.ones(len(told))], axis=1)
    basis = np.linalg.qr(linear / np.maximum(np.linalg.norm(linear, axis=0), 1e-300))[0]

    def numbers(factors: Float[np.ndarray, " number"]) -> dict[str, float]:
        return dict(zip(fitted, (first * np.exp(factors)).tolist(), strict=True))

    def left(factors: Float[np.ndarray, " number"]) -> Series:
        own = {**effect.parameters, **numbers(factors)}
        rest = told - force_along(kind, own, some)
        return np.asarray(rest - basis @ (basis.T @ rest))

    best = np.zeros(len(fitted))
    least = float(np.sum(left(best) ** 2))
    for number, factor in itertools.product(range(len(fitted)), START_FACTORS):
        start = np.zeros(len(fitted))
        start[number] = np.log(factor)
        found = scipy.optimize.least_squares(left, start, max_nfev=60, x_scale=0.1)
        if 2 * found.cost < least:
            best, least = found.x, float(2 * found.cost)
    learnt = numbers(best)
    fine = all(kind.parameter(name).refuses(value) is None for name, value in learnt.items())
    return learnt if fine else {}
