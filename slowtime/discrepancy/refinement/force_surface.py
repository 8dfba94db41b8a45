"""Force surface fitted where no law explains the records: the gap closes without a name."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit, FitControl
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.library_fit import start_with_force
from slowtime.discrepancy.estimation.candidate_fit import (
    GROWING_HORIZONS,
    FitSchedule,
    FittedCandidate,
    fit_candidate,
)
from slowtime.discrepancy.linear_algebra import solve_semidefinite
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.localization.places import LatentForce
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import Effect, Kind, Place, force_along
from slowtime.dynamics.work import metered

KIND = "measured_force"
MARGIN = 1.02
"""[1] Times the largest motion that was recovered, to which the surface reaches. Source: a
decision; beyond it keeps its value at the edge."""
MEMORY_SHARES = (0.03, 0.15, 0.5)
"""[share of the largest elongation] Paths over which memory fades. Source: presliding of dry
joints to yielding of springs; the best on the recovered force is taken."""
MAX_WORK = 1.0e10
"""[units of work] That the fit of a surface may cost, beside the budget of the search
(`slowtime.dynamics.work`). Source: a decision: under a minute of the reference machine."""
RIDGE = 1e-6
"""[share of the mean square] Of the terms that is added, as the motion does not tell all of
them apart. Source: judgement."""


def fit_force_surface(
    before: Fit,
    localized: Localization,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> FittedCandidate | None:
    """Fit a force surface at the likeliest element, with all constants, to the free run.

    Parameters
    ----------
    before
        Fit that the surface is added to.
    localized
        Where a force explains what that leaves.

    Returns
    -------
    The fitted surface; None where no element is likely, or no fit comes to an end.
    """
    place = next(
        (p for group in localized.groups for p in group.places if p.kind == "element"), None
    )
    if place is None or KIND not in kinds:
        return None
    latents = [localized.latent(place, i) for i in range(len(localized.trials))]
    effect = _along(kinds[KIND], place, latents)
    if effect is None:
        return None
    space = ForceSpace(before, localized, place)
    forces = [
        force_along(kinds[KIND], effect.parameters, one.motion)[:, None] for one in latents
    ]
    start = start_with_force(before, space.lines_of(forces), space)
    with metered() as meter:
        return fit_candidate(
            before, effect, trials, kinds, before.noise,
            control=FitControl(is_late=lambda: meter.spent > MAX_WORK),
            schedule=FitSchedule(start=start, horizons=GROWING_HORIZONS),
        )  # fmt: skip


def _along(kind: Kind, place: Place, latents: Sequence[LatentForce]) -> Effect | None:
    """Regress the recovered force on the terms of the surface along the recovered motion."""
    reach = MARGIN * max(float(np.abs(one.motion.e).max()) for one in latents)
    speed = MARGIN * max(float(np.abs(one.motion.v).max()) for one in latents)
    force = np.concatenate([one.force for one in latents])
    if not (reach > 0 and speed > 0 and np.isfinite(force).all()):
        return None
    names = [p.name for p in kind.parameters if p.fitted]
    found: list[tuple[float, dict[str, float]]] = []
    for share in MEMORY_SHARES:
        scales = {"memory_m": share * reach, "e0_m": reach, "v0_m_per_s": speed}
        columns = np.stack(
            [
                np.concatenate(
                    [force_along(kind, scales | {name: 1.0}, one.motion) for one in latents]
                )
                for name in names
            ],
            axis=1,
        )
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                weights = _ridge(columns, force)
            except np.linalg.LinAlgError:
                continue
        left = float(np.mean((force - columns @ weights) ** 2))
        if not np.isfinite(left):
            continue
        found.append((left, scales | dict(zip(names, weights.tolist(), strict=True))))
    if not found:
        return None
    return Effect(kind.name, place, min(found, key=lambda one: one[0])[1])


def _ridge(
    terms: Float[np.ndarray, "time term"], force: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " term"]:
    normal = terms.T @ terms
    normal += RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal))
    return solve_semidefinite(normal, terms.T @ force)
