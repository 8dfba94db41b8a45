r"""Laws at elements whose constants a fit moved to make up for them.

Where sensors are few, the motion at an element is uncertain, and so are laws fitted along it.
Constants that a fit moves to make up for a law are evidence, too: the force that they add at an
element, :math:`\Delta k \, e + \Delta c \, v`, is the linear part of the law's force along the
motion of the fit (equivalent linearisation). That gives each law its strength, and free runs
rank them.

References
----------
.. [1] T. K. Caughey, "Equivalent linearization techniques", J. Acoust. Soc. Am. 35 (1963).
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.augmentation import FitStart, free_run_chi2
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.workers import map_shared
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Hidden,
    Kind,
    Law,
    Motion,
    Place,
    force_along,
    simple_kinds,
)
from slowtime.dynamics.plant import Name

from .library_fit import Candidate, is_applicable, label_of
from .parameter_scan import concatenate_motions, is_possible, scale_to_strength

MIN_COSINE_SQUARED = 0.9
"""[1] Between what moved constants add and the linear part of a law, from which the law may be
what moved them. Source: docs/what_decides.md: half and double change no answer."""
MAX_SHAPES = 12
"""[1] Shapes of each law that are run freely. Source: docs/what_decides.md: half and double
change no answer."""
MAX_ELEMENTS = 2
"""[1] Elements that are looked at, those with the most moved constants first. Source:
docs/what_decides.md: half and double change no answer."""
MAX_LAWS = 4
"""[1] Laws that are proposed where constants leave nothing. Source: docs/decisions/0024."""
MAX_OTHER_CONSTANTS = 4
"""[1] Changes of other constants that are proposed beside them. Source: docs/decisions/0024."""
CONSTANTS = {"stiffness_loss": ("stiffness", -1.0), "viscous_damping": ("damping", 1.0)}
"""Kinds that change a constant of an element, which, and in which direction."""


def equivalent_laws(
    bent: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> list[Candidate]:
    """Propose laws at elements with moved constants, the best free run first."""
    pulls = sorted(bent.pulls.items(), key=lambda pair: -abs(pair[1]))
    springs = _springs(bent)
    moved = (name[1] for name, pull in pulls if _is_moved(name, pull) and name[1] in springs)
    elements = list(dict.fromkeys(moved))
    if not elements:
        return []
    data = bent.data
    runs = list(bent.motions(trials))
    found: list[Candidate] = []
    for element in elements[:MAX_ELEMENTS]:
        place = Place("element", str(element))
        motions = [run[place] for run in runs]
        start = _fit_start(bent, place)
        described = bent.plant.description
        able = [kind for kind in simple_kinds(kinds) if is_applicable(kind, place, described)]

        def nearest_law(
            kind: Kind, place: Place = place, motions: list[Motion] = motions,
            start: FitStart = start,
        ) -> tuple[float, int, Effect] | None:  # fmt: skip
            laws = enumerate(_proportional_laws(bent, kind, place, motions))
            return min(
                ((free_run_chi2(bent, law, start, trials, kinds), i, law) for i, law in laws),
                default=None,
            )

        for kind, nearest in zip(able, map_shared(nearest_law, able), strict=True):
            if nearest is None or not math.isfinite(nearest[0]):
                continue
            numbers = sum(p.fitted for p in kind.parameters)
            score = -nearest[0] / 2 - numbers / 2 * math.log(data)
            found.append(Candidate(nearest[2], nearest[0], score, math.inf, start))
    return sorted(found, key=lambda one: -one.score)


def instead_of_constants(
    bent: Fit, labels: Sequence[Candidate], trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> list[Candidate]:
    """Propose further laws for which moved constants may stand."""
    done = {label_of(one.effect) for one in labels}
    every = equivalent_laws(bent, trials, kinds)
    others = [one for one in every if label_of(one.effect) not in done][:MAX_LAWS]
    done |= {label_of(one.effect) for one in others}
    named = {one.effect.kind for one in [*labels, *others]}
    beside = [one for one in _other_constants(bent, kinds) if one.effect.kind in named]
    others += [one for one in beside if label_of(one.effect) not in done][:MAX_OTHER_CONSTANTS]
    # A fit whose constants explain everything leaves no residual to rank laws by. Until they
    # are refitted, they count as good as the best candidate.
    if not labels:
        return others
    best = labels[0]
    return [
        dataclasses.replace(one, cost=best.cost, cost_without=best.cost_without)
        for one in others
    ]


def _other_constants(bent: Fit, kinds: Mapping[str, Kind]) -> Iterator[Candidate]:
    """Propose a change of each constant; few sensors do not determine which of them changed."""
    springs = _springs(bent)
    for name, _ in sorted(bent.pulls.items(), key=lambda pair: -abs(pair[1])):
        if name[1] not in springs:
            continue
        for kind, (what, sign) in CONSTANTS.items():
            if name[0] == what and kind in kinds:
                place = Place("element", str(name[1]))
                effect = Effect(
                    kind, place, {kinds[kind].names[0]: sign * _change_of_constant(bent, name)}
                )
                start = _fit_start(bent, place)
                yield Candidate(effect, bent.cost, -math.inf, bent.cost, start)


def _springs(fit: Fit) -> frozenset[str]:
    """Names of the elements that laws may sit on."""
    elements = fit.plant.description.elements
    return frozenset(element.id for element in elements if isinstance(element, Spring))


def _is_moved(name: tuple[object, ...], pull: float) -> bool:
    return name[0] in ("stiffness", "damping") and abs(pull) > LIMITS.moved_tolerances


def is_single_changed_constant(fit: Fit, effect: Effect) -> bool:
    """Whether one constant alone is far off, and an effect is its change."""
    # A single constant far off is no sign of a tolerance stated too small.
    off = [
        name for name, pull in fit.constant_pulls.items() if abs(pull) > LIMITS.moved_tolerances
    ]
    if (
        len(off) != 1
        or abs(fit.constant_pulls[off[0]]) < LIMITS.alone_tolerances
        or effect.kind not in CONSTANTS
    ):
        return False
    return off[0] == (CONSTANTS[effect.kind][0], effect.place.id)


def _fit_start(bent: Fit, place: Place) -> FitStart:
    """Start with the constants of an element at their prior means, and all else as fitted."""
    constants = {
        name: float(bent.prior.mean[at] if name[1] == place.id else bent.free[at])
        for at, name in enumerate(bent.prior.names)
        if name[0] != "effect"
    }
    names = bent.plant.state_names
    states = [dict(zip(names, state.tolist(), strict=False)) for state in bent.states]
    return FitStart(constants, states)  # type: ignore[arg-type]


def _proportional_laws(
    bent: Fit, kind: Kind, place: Place, motions: list[Motion]
) -> Iterator[Effect]:
    """Scale a law, in each shape, so that its linear part is what the constants add."""
    action = kind.action
    if kind.strength is None or kind.quadrature is not None:
        return
    if not isinstance(action, Law | Friction | Hidden):
        return
    motions = sorted(motions, key=lambda motion: float(motion.times[0]))
    whole = concatenate_motions(motions)
    linear = np.stack([whole.e, whole.v], axis=1)
    added = linear @ np.array(
        [_added_by_constant(bent, what, place) for what in ("stiffness", "damping")]
    )
    fits: list[tuple[float, dict[str, float]]] = []
    for shape in kind.shapes(whole):
        unit = dict(shape) | {kind.strength: 1.0}
        force = np.concatenate([force_along(kind, unit, m) for m in motions])
        if not np.all(np.isfinite(force)):
            continue
        part = linear @ np.linalg.lstsq(linear, force, rcond=None)[0]
        along, size = float(part @ added), float(part @ part)
        if size > 0 and along**2 > MIN_COSINE_SQUARED * size * float(added @ added):
            fits.append((along**2 / size, scale_to_strength(kind, unit, along / size)))
    for _, parameters in sorted(fits, key=lambda one: -one[0])[:MAX_SHAPES]:
        if is_possible(kind, parameters, bent.plant.description, place):
            yield Effect(kind.name, place, parameters)


def _added_by_constant(bent: Fit, what: str, place: Place) -> float:
    """Change of a constant that left its tolerance; 0 for others."""
    name = (what, place.id)
    if name not in bent.prior.names or not _is_moved(name, bent.pulls[name]):
        return 0.0
    return _change_of_constant(bent, name)


def _change_of_constant(bent: Fit, name: Name) -> float:
    at = bent.prior.names.index(name)
    return float(bent.free[at] - bent.prior.mean[at])
