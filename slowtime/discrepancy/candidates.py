r"""Where a force was found, in; which laws would make it, by how much they explain, out.

Each kind is tried at each place that it can sit on, along the motion recovered there, and is
compared where the noise is known: at the sensors. With whitened lines of the residual
:math:`r`, of the constants' and initial states' columns :math:`B`, and of the force's own
:math:`c`,

.. math:: \min_{\theta, \beta} \; |r - c \, \theta - B \beta|^2
          + |(\beta - \beta_0) / \sigma|^2 .
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from slowtime.dynamics.effects import Effect, Kind

from .locate import Group, Located
from .refit import Fit
from .shapes import best_of, gained, retuned
from .space import Space

MORE, LITTLE = 1.5, 0.2
"""Times what a free force at the best place leaves, and over the noise, from which a place is
passed over."""
HOPELESS = 5.0
"""Times the chi squared of the best law that a place must leave, to be passed over."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A law at a place, with the parameters that explain most.

    Parameters
    ----------
    cost
        Chi squared that it leaves, with what the constants' tolerance takes.
    score
        Half of that, and half a log of the data for each parameter, below zero.
    bare
        Chi squared without it.
    """

    effect: Effect
    cost: float
    score: float
    bare: float


def candidates(fit: Fit, located: Located, kinds: Mapping[str, Kind]) -> list[Candidate]:
    """Try every kind at every place, each with its own best shape; the best first."""
    data = sum(2 * t.residual.size for t in located.lines)
    found: list[Candidate] = []
    least = math.inf
    fits = [kind for kind in kinds.values() if _fits(kind, located)]
    leaving = min(group.left for group in located.groups)
    for group in located.groups:
        if group.left > MORE * leaving + LITTLE or elsewhere(located, group) > HOPELESS * least:
            continue
        for place in group.places:
            own = [kind for kind in fits if kind.where == place.kind]
            if not own:
                continue
            space = Space(fit, located, place)
            for kind in own:
                both = (best_of(kind, space), retuned(kind, space))
                if both == (None, None):
                    continue
                effect, gain = max((one for one in both if one is not None), key=gained)
                least = min(least, space.bare - gain)
                cost = space.bare - gain
                numbers = sum(p.fitted for p in kind.parameters)
                score = -cost / 2 - numbers / 2 * math.log(data)
                found.append(Candidate(effect, cost, score, space.bare))
    return sorted(found, key=lambda c: -c.score)


def elsewhere(located: Located, group: Group) -> float:
    """Chi squared that no force at a place can take away, whatever its course."""
    total = 0.0
    for lines, force in zip(located.lines, group.explained.forces, strict=True):
        left = float(np.sum(np.abs(force.left) ** 2 / lines.noise))
        along = np.sum(force.transfer.conj() * force.left / lines.noise, axis=1)
        heard = force.signal > 0
        taken = np.abs(along[heard]) ** 2 / force.signal[heard]
        total += 2 * (left - float(taken.sum()))
    return total


def _fits(kind: Kind, located: Located) -> bool:
    """Whether a kind can be at all: what is per radian acts on angles."""
    angular = any("/rad" in parameter.unit for parameter in kind.parameters)
    return not angular or located.linear.description.unit_of_coordinate == "rad"
