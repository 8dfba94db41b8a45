"""Names the elements that have changed: "j2", or "j1 or j4" where data cannot tell."""

import dataclasses
import math
from collections.abc import Sequence

from slowtime.evolution.structures import ChangedParts, NamedChanges
from twin_server.registration.structure import MASS

RIVAL = 0.2
"""Of the probability of the best hypothesis, from which another is one to be reckoned with."""

TOLD = 0.9
"""Probability of a hypothesis from which it has no rivals."""


@dataclasses.dataclass(frozen=True, slots=True)
class SuspectGroup:
    """One or more parameters of which one has changed.

    Parameters
    ----------
    word
        The parameter; or several, with "or", of which it is one.
    sizes
        In words, by how much each of them would have.
    """

    word: str
    sizes: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """Describe the suspect in a sentence.

        Examples
        --------
        >>> SuspectGroup("j2", ("j2 has lost 8 % ± 1 % of its stiffness",)).sentence
        'j2 has lost 8 % ± 1 % of its stiffness.'
        """
        if len(self.sizes) == 1:
            return f"{self.sizes[0]}."
        return f"{self.word} has changed; the readings do not show which: either " + (
            ", or ".join(self.sizes) + "."
        )


def suspects_of(named: NamedChanges) -> tuple[SuspectGroup, ...]:
    """Return the changed parameters: first those that all likely hypotheses share."""
    place = {name: i for i, name in enumerate(named.inclusion)}
    rivals = _rivals(named.hypotheses)
    shared = set.intersection(*(set(one.names) for one in rivals))
    found = [
        SuspectGroup(name, (_size(rivals[0], name),))
        for name in sorted(shared, key=place.__getitem__)
    ]
    # In a fixed order, so that the text does not change while the probabilities vary.
    rivals.sort(key=lambda one: [place[name] for name in one.names])
    rest = [[name for name in one.names if name not in shared] for one in rivals]
    if len(rivals) > 1 and all(rest):
        word = " or ".join(" and ".join(names) for names in rest)
        sizes = tuple(
            " and ".join(_size(one, name) for name in names)
            for one, names in zip(rivals, rest, strict=True)
        )
        found.append(SuspectGroup(word, sizes))
    return tuple(found)


def size(name: str, change: float, sd: float) -> str:
    """Describe the size of a change.

    Parameters
    ----------
    name
        Name of an element, or of a mass with the suffix ``.mass``.
    change
        Relative change of its stiffness or mass [1].
    sd
        Standard deviation of the change [1].

    Returns
    -------
    A clause without full stop.

    Examples
    --------
    >>> size("j2", -0.08, 0.01)
    'j2 has lost 8 % ± 1 % of its stiffness'
    >>> size("m1.mass", 0.124, 0.004)
    'm1 has gained 12.4 % ± 0.4 % of its mass'
    """
    places = min(max(0, -math.floor(math.log10(100.0 * sd) + 1e-9)), 3) if sd > 0.0 else 1
    what = f"{100 * abs(change):.{places}f} % ± {100 * sd:.{places}f} %"
    verb = "lost" if change < 0.0 else "gained"
    owner, of = (
        (name.removesuffix(MASS), "mass") if name.endswith(MASS) else (name, "stiffness")
    )
    return f"{owner} has {verb} {what} of its {of}"


def _rivals(hypotheses: Sequence[ChangedParts]) -> list[ChangedParts]:
    """Hypotheses of weight; not those that only add to another one of them."""
    best = hypotheses[0]
    if best.probability >= TOLD:
        return [best]
    likely = [one for one in hypotheses if one.probability >= RIVAL * best.probability]
    return [one for one in likely if not any(set(two.names) < set(one.names) for two in likely)]


def _size(hypothesis: ChangedParts, name: str) -> str:
    at = hypothesis.names.index(name)
    return size(name, float(hypothesis.change[at]), float(hypothesis.sd[at]))
