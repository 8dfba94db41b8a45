"""What was found and refitted, in; labels with which one might have begun instead, out."""

import itertools
from collections.abc import Iterator, Mapping

from slowtime.dynamics.effects import Effect, Kind

from .candidates import Candidate, label_of
from .found import Found
from .naming import Named, refit_all
from .refit import Fit
from .watch import Watch

ANEW, DOWN = 2, 6
"""Labels that were refitted, and labels further down, with which one begins again."""


def beginnings(
    found: Found, before: Fit, kinds: Mapping[str, Kind], tell: Watch
) -> Iterator[Named]:
    """Give the second that was found, the next best that were refitted, and what came after.

    Parameters
    ----------
    before
        The fit that the first was added to.
    """

    def refitted(label: Candidate) -> list[Named]:
        return refit_all(before, [label], found.trials, kinds, tick)

    def tick(effect: Effect, _: int) -> bool:
        tell(f"refitting {effect.kind} at {effect.place}", 0.85)
        return tell.hurries

    first, *rest = found.named
    second = [answer.effect for answer in found.answers[1:2]]
    known = {label_of(one.effect): one for one in rest}
    for effect in second:
        if label_of(effect) in known:
            yield known.pop(label_of(effect))
        else:
            own = [c for c in found.tried if label_of(c.effect) == label_of(effect)]
            label = own[0] if own else Candidate(effect, 0.0, 0.0, 0.0)
            yield from refitted(label)
    kin = kinds[first.effect.kind].family
    apart = (
        one
        for one in known.values()
        if (kinds[one.effect.kind].family, one.effect.place) != (kin, first.effect.place)
    )
    yield from itertools.islice(apart, ANEW)
    seen = (*(one.effect for one in found.named), *second)
    done = {label_of(effect) for effect in seen}
    down = [c for c in found.tried if label_of(c.effect) not in done][:DOWN]
    for label in down:
        for named in refitted(label):
            if named.fit.cost < first.fit.cost:
                yield named
