r"""Tracking of modes over epochs at constant cost per epoch.

At every epoch the assignment of modes to identities is the likeliest one as a whole, with

.. math:: \ln \frac{P_D}{1 - P_D} + \ln \frac{p(\hat f_j \mid i) \, p(\hat\phi_j \mid i)}
                                            {\lambda \, p_0(\hat\phi_j)}

for mode j being track i's, and 0 for "not seen": :math:`P_D` is how often the track shows,
:math:`\lambda` how many false modes an epoch has per unit of ln f, :math:`p_0` the density
of any shape at all. A mode that is nobody's becomes a candidate, and an identity only
once it has been seen often enough; an identity that is missing waits where it was, ever less
certain of where and of what shape, and so shifts nobody else's.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.identification.modes import Mode

from . import events as happenings
from . import shape as shapes
from .events import TrackEvent
from .frequency import student
from .track import Track, begin

_JUMP = 0.1
"""Relative standard deviation of a sudden change of frequency, in the search for a lost mode
[1]."""

_DOUBLE = 0.95, 0.01
"""Least MAC and largest relative frequency difference of two estimates of one mode [1]."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """State between epochs.

    Parameters
    ----------
    tracks
        Identities, then candidates.
    order
        Identities in ascending order of frequency, as last established beyond doubt.
    epoch
        Number of epochs so far, failed ones included.
    next_identity
        What the next identity will be called.
    """

    tracks: tuple[Track, ...] = ()
    order: tuple[int, ...] = ()
    epoch: int = 0
    next_identity: int = 1

    @property
    def identities(self) -> dict[int, Track]:
        """Tracks that have an identity, missing ones included."""
        return {t.identity: t for t in self.tracks if t.identity is not None}


@dataclasses.dataclass(frozen=True, slots=True)
class Tracked:
    """What one epoch brought.

    Parameters
    ----------
    identities
        One per mode of the epoch, in its order; None for modes that are nobody's (yet).
    events
        What happened to identities.
    """

    identities: tuple[int | None, ...]
    events: tuple[TrackEvent, ...]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ModeTracker:
    """Follow modes through epochs.

    Parameters
    ----------
    confirm
        Epochs that must show a candidate, and at least half of those that could have, before
        it is given an identity.
    quiet
        Epochs in a row that do not show an identity, after which it is said to be missing.
    patience
        Epochs in a row that do not show an identity, after which it is given up.
    false_modes
        Expected number of false modes in an epoch, per unit of ln f.
    most
        Most tracks kept, candidates included; it bounds the cost of an epoch.
    """

    confirm: int = 5
    quiet: int = 10
    patience: int = 2000
    false_modes: float = 0.3
    most: int = 64

    def __post_init__(self) -> None:
        """Refuse settings that would never give an identity, or never keep one."""
        if not (1 <= self.confirm and 1 <= self.quiet <= self.patience and self.most >= 1):
            raise ValueError(
                f"confirm={self.confirm}, quiet={self.quiet}, patience={self.patience}, "
                f"most={self.most}: all are at least 1, and quiet at most patience."
            )
        if not 0.0 < self.false_modes < np.inf:
            raise ValueError(
                f"false_modes={self.false_modes} is not a positive number. Give about 0.3 for "
                "careful identification, more where many false poles pass."
            )

    def start(self) -> Tracks:
        """Nothing seen yet."""
        return Tracks()

    def step(
        self, state: Tracks, modes: Sequence[Mode], *, elapsed: float = 1.0
    ) -> tuple[Tracks, Tracked]:
        """Assign the modes of one epoch to tracks.

        Parameters
        ----------
        state
            From `start` or the step before.
        modes
            Of the epoch, in any order; none for an epoch that failed, which is no evidence
            that a mode has gone. Harmonics of machines are passed over.
        elapsed
            Time since the epoch before, in usual distances between epochs.

        Returns
        -------
        State after the epoch, and the modes with their identities.
        """
        _check(state, modes, elapsed)
        usable = [j for j, mode in enumerate(modes) if mode.kind == "structural"]
        tracks = [track.ahead(elapsed) for track in state.tracks]
        if not usable:
            after = dataclasses.replace(state, tracks=tuple(tracks), epoch=state.epoch + 1)
            return after, Tracked((None,) * len(modes), ())
        owners = self._owners(tracks, modes, usable)
        moved = [
            track.sighted(modes[owners[i]], state.epoch) if i in owners else track.overlooked()
            for i, track in enumerate(tracks)
        ]
        taken = set(owners.values())
        moved += [begin(modes[j], state.epoch) for j in usable if j not in taken]
        owner_of = {mode: i for i, mode in owners.items()}
        kept, names, next_identity = self._name(moved, state)
        identities = tuple(
            names.get(owner_of[j]) if j in owner_of else None for j in range(len(modes))
        )
        return self._conclude(state, moved, kept, identities, next_identity)

    def _owners(
        self, tracks: list[Track], modes: Sequence[Mode], usable: list[int]
    ) -> dict[int, int]:
        """Which track has which mode: identities choose first, candidates from the rest."""
        owners: dict[int, int] = {}
        for settled in (True, False):
            rows = [i for i, t in enumerate(tracks) if (t.identity is not None) is settled]
            free = [j for j in usable if j not in owners.values()]
            gains = np.array(
                [[self._gain(tracks[i], modes[j]) for j in free] for i in rows]
            ).reshape(len(rows), len(free))
            owners |= {rows[i]: free[j] for i, j in _likeliest(gains)}
        return owners

    def _gain(self, track: Track, mode: Mode) -> float:
        shows = min(max(track.shows, 0.02), 0.98)
        return (
            math.log(shows / (1.0 - shows)) + track.log_ratio(mode) - math.log(self.false_modes)
        )

    def _name(
        self, moved: list[Track], state: Tracks
    ) -> tuple[dict[int, Track], dict[int, int], int]:
        """Give identities to candidates seen often enough: a lost one's, or a new one."""
        settled = {i: t for i, t in enumerate(moved) if t.identity is not None}
        ripe: list[int] = []
        for i in sorted(range(len(moved)), key=lambda i: moved[i].frequency.mean):
            known = [*settled.values(), *(moved[k] for k in ripe)]
            if self._ripe(moved[i]) and not _double(moved[i], known):
                ripe.append(i)
        inherited = self._inherited([moved[i] for i in ripe], settled)
        kept = dict(enumerate(moved))
        next_identity = state.next_identity
        for place, i in enumerate(ripe):
            if place in inherited:
                old = kept.pop(inherited[place])
                kept[i] = dataclasses.replace(
                    moved[i], identity=old.identity, known_by=old.known_by
                )
            else:
                kept[i] = dataclasses.replace(moved[i], identity=next_identity).known_anew()
                next_identity += 1
        names = {i: t.identity for i, t in kept.items() if t.identity is not None}
        return self._bounded(kept), names, next_identity

    def _ripe(self, track: Track) -> bool:
        """Seen often enough; epochs that failed do not count against it."""
        return (
            track.identity is None
            and track.missed == 0
            and track.seen >= max(self.confirm, 0.5 * track.chances)
        )

    def _inherited(self, ripe: list[Track], settled: dict[int, Track]) -> dict[int, int]:
        """Which ripe candidates are lost identities whose frequency has jumped."""
        lost = [i for i, t in settled.items() if ripe and t.last < min(r.first for r in ripe)]
        gains = np.array(
            [[_jumped(settled[i], candidate) for i in lost] for candidate in ripe]
        ).reshape(len(ripe), len(lost))
        return {place: lost[column] for place, column in _likeliest(gains)}

    def _bounded(self, kept: dict[int, Track]) -> dict[int, Track]:
        """Drop the dead, and the least seen candidates beyond `most`."""
        alive = {i: t for i, t in kept.items() if not self._over(t)}
        ranked = sorted(alive, key=lambda i: (alive[i].identity is None, -alive[i].seen))
        return {i: alive[i] for i in sorted(ranked[: self.most])}

    def _over(self, track: Track) -> bool:
        if track.identity is not None:
            return track.missed >= self.patience
        return track.missed > min(track.seen, self.confirm)

    def _conclude(
        self,
        state: Tracks,
        moved: list[Track],
        kept: dict[int, Track],
        identities: tuple[int | None, ...],
        next_identity: int,
    ) -> tuple[Tracks, Tracked]:
        """Put events and the next state together."""
        before = state.identities
        settled = {t.identity: t for t in kept.values() if t.identity is not None}
        happened = self._comings_and_goings(before, settled, state.epoch)
        order, crossings = happenings.reorder(state.order, settled, state.epoch)
        renewed, veerings = happenings.veered(order, settled, state.epoch)
        settled |= renewed
        candidates = [t for t in kept.values() if t.identity is None]
        after = Tracks((*settled.values(), *candidates), order, state.epoch + 1, next_identity)
        return after, Tracked(identities, (*happened, *crossings, *veerings))

    def _comings_and_goings(
        self, before: dict[int, Track], after: dict[int, Track], epoch: int
    ) -> list[TrackEvent]:
        found: list[TrackEvent] = []
        for identity in sorted(before.keys() | after.keys()):
            old, new = before.get(identity), after.get(identity)
            if new is None:
                found.append(TrackEvent("died", identity, epoch))
            elif old is None:
                found.append(TrackEvent("born", identity, new.first))
            elif new.missed == self.quiet and old.missed < self.quiet:
                found.append(TrackEvent("missing", identity, new.last))
            elif new.missed == 0 and old.missed >= self.quiet:
                found.append(TrackEvent("found", identity, epoch))
        return found


def _likeliest(gains: Float[np.ndarray, "row column"]) -> list[tuple[int, int]]:
    """Pairs of the best assignment as a whole; none where being alone is likelier."""
    if not gains.size:
        return []
    from scipy.optimize import linear_sum_assignment  # here: `method=modes` alone needs it

    rows, columns = linear_sum_assignment(-np.maximum(gains, 0.0))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(i, j) for i, j in pairs if gains[i, j] > 0.0]


def _jumped(lost: Track, candidate: Track) -> float:
    """Log-odds that a candidate is a lost identity after a jump, and not a new mode."""
    apart = (lost.frequency.mean - candidate.frequency.mean) ** 2
    spread = lost.frequency.sd**2 + candidate.frequency.sd**2 + _JUMP**2
    shape_sd = np.sqrt(candidate.shape.variance / len(candidate.shape.shape))
    shape = candidate.shape.shape
    return float(student(apart, spread, 1)) + shapes.log_ratio(
        lost.shape, shape, np.full(len(shape), shape_sd)
    )


def _double(track: Track, known: list[Track]) -> bool:
    """Whether a candidate only doubles an identity, as split poles do."""
    if track.shape.directions == 0:
        return False
    likeness, near = _DOUBLE
    return any(
        abs(other.frequency.mean - track.frequency.mean) < near
        and other.last >= track.first
        and shapes.alike(other.shape, track.shape.shape) > likeness
        for other in known
    )


def _check(state: Tracks, modes: Sequence[Mode], elapsed: float) -> None:
    if not 0.0 <= elapsed < np.inf:
        raise ValueError(
            f"elapsed={elapsed} is not a time since the epoch before. Give epochs in order, "
            "and the time between them in usual distances, 1 for regular ones."
        )
    channels = {len(mode.shape) for mode in modes}
    channels |= {len(track.shape.shape) for track in state.tracks[:1]}
    if len(channels) > 1:
        raise ValueError(
            f"Shapes of {sorted(channels)} channels were given. Modes are followed by shapes "
            "of the same channels; start anew when sensors are added or taken away."
        )
    values = [(m.frequency_hz.value, m.frequency_hz.sd) for m in modes]
    if not all(0.0 < f < np.inf and 0.0 <= sd < np.inf for f, sd in values):
        raise ValueError(
            f"Frequencies and standard deviations {values} were given. Allowed are positive "
            "frequencies with finite standard deviations; leave out modes without."
        )
