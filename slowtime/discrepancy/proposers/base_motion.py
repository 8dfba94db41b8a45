"""Recognition of an unmeasured motion of the base."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, refit
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of
from slowtime.discrepancy.diagnosis import NamedEffect, Number
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.localization import (
    PLACE_MARGIN,
    Character,
    Localization,
    characterise,
)
from slowtime.discrepancy.quoting import quoted, unit_at
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.channels import BASE_KINDS
from slowtime.dynamics.effects import Effect, Kind, Place, Unmeasured

AMPLITUDE_RELATIVE_SD = 0.05
"""[1] Relative standard deviation of the amplitude of a random motion, as recovered in band.
Source: docs/what_decides.md: half and double change no answer."""
STATIC_SHARE = 0.9
"""[share of a force] That is a static function of the motion at its place, from which the
motion there makes it. Source: docs/what_decides.md: half and double change no answer."""
STATIC_LEAD = 0.1
"""[share of a force] By which a static function explains more than any linear filter of the
motion, from which the motion makes it, too. Source: docs/what_decides.md: half and double
change no answer."""
MIN_FREE_RUN_REST = 0.6
"""[share of what is missing] That every law leaves in a free run where the base moves. Source:
docs/decisions/0026; beside a random motion the best law leaves seven tenths, in place of
another law nearly half."""
MAX_GROWTH = 2.0
"""[1] Of the recovered motion of the base, from the record driven least to that driven hardest:
a true one does not depend on inputs. It is judged where their power grows by more than as much.
Source: sixteen true motions had 1.3 at most; a pendulum and a friction had 24 and 4.5."""
MIN_RIVAL_SHARE = 0.1
"""[share of a force] Along it, up to which a law is no rival. Source: docs/decisions/0030;
beside a random motion of the base a hidden oscillator explains half of the free run and a
twentieth of the force."""
MAX_LAW_SHARE = 0.6
"""[share of the gain of log-likelihood] Of a motion of the base that a law may explain. Source:
docs/what_decides.md: half and double change no answer."""
MAX_LAW_SHARE_OF_SEVERAL = 0.2
"""[share of the gain of log-likelihood] The same where one force is not all that is missing.
Source: docs/decisions/0017 for the rule; docs/what_decides.md for the value: half and double
change no answer."""


def base_motion(
    located: Localization, tried: Sequence[Candidate], kinds: Mapping[str, Kind], *, first: bool
) -> NamedEffect | None:
    """Name a motion of the base that nobody measured, where it beats all else.

    It must be likelier than an unknown force anywhere else, explain no less than any, and be
    likelier than any law; where it enters tells it from a force. Where sensors are too few for
    that, or it does not explain all that is missing, no law may explain much: a force within
    the structure is made by the motion, one from outside is not. Nor can it in the first case
    be told once something else was found `first`.
    """
    group = located.groups[0]
    unmeasured = [k for k in kinds.values() if isinstance(k.action, Unmeasured)]
    place = next((p for p in group.places if p.kind == "base"), None)
    if not unmeasured or place is None or unmeasured[0].strength is None:
        return None
    if any(p.kind in ("element", "node") for p in group.places):
        return None
    if any(one.kind in BASE_KINDS for one in located.linear.description.inputs):
        return None  # somebody did measure it
    likelihood = group.explained.likelihood
    apart = [g for g in located.groups[1:] if not set(g.places) & set(group.twins)]
    rivals = [g.explained.likelihood for g in apart]
    rivals += [-c.cost / 2 for c in tried]
    lead = likelihood - max(rivals, default=-math.inf)
    if lead < LIMITS.least_log_evidence or located.p_value > LIMITS.false_alarm_p_value:
        return None
    if any(other.share > group.share for other in located.groups[1:]):
        return None  # far above the noise, an error of the model is told from both by luck
    made = max((-c.cost / 2 for c in tried), default=-math.inf)
    if group.twins and not first:
        return None
    several = group.left > LIMITS.several_forces_chi2
    share = MAX_LAW_SHARE_OF_SEVERAL if several else MAX_LAW_SHARE
    if several or group.twins:
        if made > likelihood - (1 - share) * group.score:
            return None
    if group.twins or several:
        elements = [near for near in located.equivalent_places if near.kind == "element"]
        if any(is_made_by_motion(characterise(located, place)) for place in elements):
            return None
    if _grows(located, place):
        return None
    kind = unmeasured[0]
    assert kind.strength is not None
    unit = unit_at(located.linear.description, place, kind.parameter(kind.strength).unit)
    size = _size(located, place, unit)
    probability = float(1 / (1 + math.exp(-min(LIMITS.evidence_power * lead, 50.0))))
    effect = Effect(kind.name, place, {kind.strength: size.value})
    return quoted(effect, {kind.strength: size}, kind, probability)


def _size(located: Localization, place: Place, unit: str) -> Number:
    """Root mean square of a random force, each record counting as far as it tells of it."""
    latents = [located.latent(place, i) for i in range(len(located.trials))]
    weights = np.array([latent.sd for latent in latents]) ** -2.0
    power = np.average([np.mean(latent.force**2) for latent in latents], weights=weights)
    noise = np.average([latent.noise_sd**2 for latent in latents], weights=weights)
    size = math.sqrt(power)
    # How much of the recovered power is the sensors' noise is what is not known of it.
    return Number(size, math.hypot(AMPLITUDE_RELATIVE_SD * size, noise / (2 * size)), unit)


def _grows(located: Localization, place: Place) -> bool:
    """Whether a force grows with what drives the structure, as none from outside does."""
    driven = [float(np.sum(np.var(trial.inputs, axis=0))) for trial in located.trials]
    least, most = int(np.argmin(driven)), int(np.argmax(driven))
    if driven[most] <= MAX_GROWTH * driven[least]:
        return False
    sizes = [located.latent(place, i).force.std() for i in (least, most)]
    return bool(sizes[1] > MAX_GROWTH * sizes[0])


def is_made_by_motion(there: Character) -> bool:
    """Whether a force is a function of the motion where it acts, as none from outside is."""
    # In proportion to its motion is any force that is much slower, or much narrower in band,
    # than the structure answers.
    curved = there.static_share > min(STATIC_SHARE, there.linear_share + STATIC_LEAD)
    return curved and not there.linear


def placed(located: Localization, tried: Sequence[Candidate]) -> bool:
    """Whether no force but one on the base could be what is missing, and it is all."""
    # What a fault of the measured motion explains has to be seen in a free run first.
    first = located.groups[0]
    bare = first.explained.likelihood - first.score
    little = (-one.cost / 2 < bare + MAX_LAW_SHARE_OF_SEVERAL * first.score for one in tried)
    return apart(located) and all(little)


def apart(located: Localization) -> bool:
    """Whether a force at the foremost place is all that is missing, and none elsewhere is."""
    first, *rest = located.groups
    alone = not first.twins and first.left < LIMITS.several_forces_chi2
    return alone and all(group.left > PLACE_MARGIN * first.left for group in rest)


def by_a_law(
    named: Sequence[FittedCandidate],
    labels: Sequence[Candidate],
    before: Fit,
    trials: tuple[Trial, ...],
    located: Localization,
) -> bool:
    """Whether a law explains much of what may be a motion of the base."""
    # A law that shakes a mode for long looks like a tone; but no right law leaves so much where
    # a force at the base leaves nothing, and none elsewhere does that. Nor does a right law,
    # whose free run follows, leave the force itself as it was.
    along = {
        label_of(one.effect): 1 - one.cost / one.cost_without
        for one in labels
        if one.cost_without
    }
    law = next(
        (one.fit for one in named if along.get(label_of(one.effect), 1.0) > MIN_RIVAL_SHARE),
        None,
    )
    if law is None or (apart(located) and law.chi2_in_band > LIMITS.far_off_chi2):
        return False
    return follows(law, before, trials)


def follows(law: Fit, before: Fit, trials: tuple[Trial, ...]) -> bool:
    """Whether a law explains much in a free run, which it could not if the base moved."""
    bar = refit(
        before.plant, trials, noise=law.noise, values=before.values,
        states=before.states, horizons=(1.0,),
    )  # fmt: skip
    return law.cost - law.data < MIN_FREE_RUN_REST * (bar.cost - bar.data)
