r"""Laws of the library ranked by how much they explain along recovered motions.

Each kind is fitted at each place where it may act, along the motion recovered there, and is
compared at the sensors, where the noise is known. With whitened lines of the residual
:math:`r`, of the constants' and initial states' columns :math:`B`, and of the force's own
:math:`c`,

.. math:: \min_{\theta, \beta} \; |r - c \, \theta - B \beta|^2
          + |(\beta - \beta_0) / \sigma|^2 .
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.augmentation import FitStart
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.localization import Localization, PlaceGroup, locate
from slowtime.discrepancy.noise import has_rigid_motion
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.workers import map_shared
from slowtime.dynamics.description import Description, OpenJoint, moves_with_base
from slowtime.dynamics.effects import Effect, Kind, Place, is_of_beam, simple_kinds

from .force_space import ForceSpace, ForceSpectra
from .parameter_scan import best_effect, best_within_tolerances, effect_forces, gain_of

PLACE_RATIO = 1.5
"""[1] Times what a free force at the best place leaves, above which a place is passed over.
Source: docs/what_decides.md, which has the cases where it decides."""
PLACE_OFFSET = 0.2
"""[noise variances] Added to that. Source: docs/what_decides.md: half and double change no
answer."""
MAX_STARTS = 40
"""[1] Candidates for which a start of the fit is computed. Source: docs/what_decides.md: half
and double change no answer."""
MAX_CONSTANT_FACTOR = 20.0
"""[1] By which a start may change a constant. Source: docs/what_decides.md: half and double
change no answer."""
OFFSET, GAIN = "input_bias", "input_gain"
"""Kinds that are no rivals of others where a structure floats: see `floating`."""
MISPLACED = "sensor_misplaced"
"""Kind of a sensor at another node."""
WEAK_SHARE = 0.1
"""[share of the best place's gain] Below which a place is passed over where several forces act.
Source: docs/what_decides.md: half and double change no answer."""
TWIN_RATIO = 2.0
"""[1] Times `PLACE_RATIO` for a place whose transfer is parallel to that of the best. Source:
docs/what_decides.md: half and double change no answer."""
TONAL_SHARE = 0.8
"""[share of the residual power] From which the residual is one line. Source:
docs/what_decides.md: half and double change no answer."""
TONAL_LINES = 4
"""[lines] On either side that belong to it. Source: main lobe of a rectangular window, with
margin."""
HOPELESS_RATIO = 5.0
"""[1] Times chi squared of the best law that a place must leave to be passed over. Source:
docs/what_decides.md: half and double change no answer."""


Label = tuple[str, Place]
"""Kind and place of an effect, whatever its numbers."""


def label_of(effect: Effect) -> Label:
    """Kind and place of an effect, without its parameters."""
    return effect.kind, effect.place


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A law at a place, with the parameters that explain most.

    Parameters
    ----------
    effect
        Kind, place and parameters.
    cost
        Chi squared [1] that it leaves along the force, deviations of the constants included.
    score
        Schwarz's criterion: minus half of that, minus half the log of the data for each
        parameter [nats].
    cost_without
        Chi squared [1] that is left there without any law: one that saves little of it is not
        fitted to free runs.
    start
        Where its fit to free runs begins, and over which horizons; the usual ones where not
        given.

    References
    ----------
    .. [1] G. Schwarz, "Estimating the dimension of a model", Ann. Stat. 6 (1978).
    """

    effect: Effect
    cost: float
    score: float
    cost_without: float
    start: FitStart | None = None


def library_candidates(
    fit: Fit,
    located: Localization,
    kinds: Mapping[str, Kind],
    among: Sequence[Kind] | None = None,
) -> list[Candidate]:
    """Fit every kind at every place that may explain the residual, by falling score.

    Kinds that contain others are left out, unless they are named in `among`.
    """
    data = sum(2 * t.residual.size for t in located.lines)
    found: list[Candidate] = []
    spaces: dict[Place, ForceSpace] = {}
    least = math.inf
    described = located.linear.description
    fits = simple_kinds(kinds) if among is None else among
    leaving = min(group.left for group in located.groups)
    most = max(group.score for group in located.groups)
    tones = [kind for kind in fits if kind.quadrature is not None and kind.where == "node"]
    one_line = bool(tones) and is_tonal(located)
    for group in located.groups:
        if leaving < LIMITS.several_forces_chi2 or most <= 0:
            # To one sensor all places are alike, except for the smoothness of their forces.
            alike = set(group.places) & set(located.groups[0].twins)
            worse = group.left > acceptable_chi2(leaving) * (TWIN_RATIO if alike else 1.0)
        else:
            worse = group.score < WEAK_SHARE * most
        worse = worse or unreachable_chi2(located, group) > HOPELESS_RATIO * least
        if worse and not one_line:
            continue
        for place in group.places:
            own = [k for k in (tones if worse else fits) if is_applicable(k, place, described)]
            if not own:
                continue
            space = spaces[place] = ForceSpace(fit, located, place)
            explored = map_shared(
                lambda kind, space=space: (  # type: ignore[misc]
                    best_effect(kind, space),
                    best_within_tolerances(kind, space),
                ),
                own,
            )
            for kind, both in zip(own, explored, strict=True):
                if both == (None, None):
                    continue
                effect, gain = max((one for one in both if one is not None), key=gain_of)
                least = min(least, space.cost_without - gain)
                cost = space.cost_without - gain
                numbers = sum(p.fitted for p in kind.parameters)
                score = -cost / 2 - numbers / 2 * math.log(data)
                found.append(Candidate(effect, cost, score, space.cost_without))
    found.sort(key=lambda c: -c.score)
    foremost = []
    for one in found[:MAX_STARTS]:
        space = spaces[one.effect.place]
        forces = space.lines_of(effect_forces(kinds[one.effect.kind], one.effect, space))
        foremost.append(dataclasses.replace(one, start=start_with_force(fit, forces, space)))
    return [*foremost, *found[MAX_STARTS:]]


def laws_left_by(
    fit: Fit,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    among: Sequence[Kind] | None = None,
) -> tuple[Fit, Localization, list[Candidate]]:
    """Give the fit within tolerances, where a force is missing from it, and laws of that."""
    held = refit_within_tolerances(fit, trials)
    located = locate(held, trials)
    return held, located, library_candidates(held, located, kinds, among)


def is_tonal(located: Localization) -> bool:
    """Whether nearly all of the residual power is one spectral line."""
    # A tone is tried at every place, as the likelihood of a force of any spectrum does not rank
    # places for it.
    loud = [
        np.maximum(np.sum(np.abs(one.residual) ** 2 / one.noise - 1, axis=1), 0.0)
        for one in located.lines
    ]
    best = int(np.argmax([excess.max() for excess in loud]))
    pitch = located.lines[best].frequency_hz[int(np.argmax(loud[best]))]
    inside = 0.0
    for one, excess in zip(located.lines, loud, strict=True):
        at = int(np.argmin(np.abs(one.frequency_hz - pitch)))
        inside += float(excess[max(at - TONAL_LINES, 0) : at + TONAL_LINES + 1].sum())
    return inside > TONAL_SHARE * sum(float(excess.sum()) for excess in loud)


def acceptable_chi2(least: float) -> float:
    """Mean square over the noise up to which a place is not passed over."""
    return PLACE_RATIO * max(least, 1.0) + PLACE_OFFSET


def start_with_force(fit: Fit, forces: list[ForceSpectra], space: ForceSpace) -> FitStart:
    """Solve for constants and initial states, given forces at a place."""
    return start_beside(fit, space.products(forces)[0][:, 0], space)


def start_beside(
    fit: Fit, taken: Float[np.ndarray, " nuisance"], space: ForceSpace
) -> FitStart:
    """Solve for constants and initial states, given the products of forces with them."""
    constants = space.constants_beside(taken)
    means = dict(zip(fit.prior.names, fit.prior.mean.tolist(), strict=True))
    for name, value in constants.items():
        if not 1 / MAX_CONSTANT_FACTOR < value / means[name] < MAX_CONSTANT_FACTOR:
            constants[name] = means[name]
    return FitStart(constants, space.states)


def mirrored_factor(
    labels: Sequence[Candidate], tried: Sequence[Candidate], kinds: Mapping[str, Kind]
) -> list[Candidate]:
    """Propose the factor of the input for that of a single sensor, and the reverse."""
    known = next((one for one in labels if kinds[one.effect.kind].is_factor), None)
    if known is None:
        return []
    factors = [one.effect for one in tried if kinds[one.effect.kind].is_factor]
    every = {one.place.kind: one for one in reversed(factors)}
    (by,) = known.effect.parameters.values()
    others = [one for where, one in every.items() if where != known.effect.place.kind]
    return [
        dataclasses.replace(
            known,
            effect=dataclasses.replace(
                one, parameters=dict.fromkeys(kinds[one.kind].names, by)
            ),
        )
        for one in others
    ]


def unreachable_chi2(located: Localization, group: PlaceGroup) -> float:
    """Chi squared that no force at the places of a group can explain."""
    total = 0.0
    for lines, force in zip(located.lines, group.explained.forces, strict=True):
        left = float(np.sum(np.abs(force.left) ** 2 / lines.noise))
        along = np.sum(force.transfer.conj() * force.left / lines.noise, axis=1)
        heard = force.signal > 0
        taken = np.abs(along[heard]) ** 2 / force.signal[heard]
        total += 2 * (left - float(taken.sum()))
    return total


def is_applicable(kind: Kind, place: Place, description: Description) -> bool:
    """Whether a kind may act at a place of a structure."""
    if kind.where != place.kind or is_of_beam(place, description):
        return False
    if kind.name == MISPLACED:
        return False  # see `wiring`
    if kind.is_coupling:
        return False  # no force along one motion: see `proposers.couplings`
    if kind.joins is not None and kind.joins != is_open(place, description):
        return False
    if kind.name == OFFSET:
        return False  # equivalent to a bias of sensors, or fitted anyway with rigid modes
    if kind.where == "base" and not moves_with_base(description):
        return False  # what it does to reduced substructures is not known
    if kind.name == GAIN and len(description.inputs) == 1 and has_rigid_motion(description):
        return False  # equivalent to all masses and dampers being smaller
    # Parameters per radian need angles.
    angular = any("/rad" in parameter.unit for parameter in kind.parameters)
    return not angular or description.unit_of_coordinate == "rad"


def is_open(place: Place, description: Description) -> bool:
    """Whether a place is between two points that nothing joins in the model."""
    joints = (one.id for one in description.elements if isinstance(one, OpenJoint))
    return place.kind == "element" and place.id in joints
