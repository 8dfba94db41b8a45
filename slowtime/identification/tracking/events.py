"""Events of tracked modes: appearance, loss, return, crossing and veering."""

import dataclasses
import itertools
import math
from typing import Literal

from . import shape as shapes
from .track import Track

Happening = Literal["born", "missing", "found", "died", "crossed", "veered"]

SURE = 3.0
"""Difference beyond which two frequencies have crossed [standard deviations]."""


@dataclasses.dataclass(frozen=True, slots=True)
class TrackEvent:
    """One thing that happened to an identity.

    Parameters
    ----------
    kind
        `born` (believed from now on, seen first at `epoch`), `missing` (not seen for a while,
        last at `epoch`), `found` (a missing one seen again), `died` (given up for good),
        `crossed` (it and `other` have passed each other in frequency, each with its own
        shape), `veered` (it and `other` came close, turned away and exchanged their shapes;
        identities stay with the frequencies).
    identity
        Whose.
    epoch
        When, counted in steps from 0.
    other
        The other identity of a crossing or veering.
    """

    kind: Happening
    identity: int
    epoch: int
    other: int | None = None


def reorder(
    order: tuple[int, ...], tracks: dict[int, Track], epoch: int
) -> tuple[tuple[int, ...], list[TrackEvent]]:
    """Order of identities in frequency, and the crossings since the order before."""
    known = [identity for identity in order if identity in tracks]
    fresh = sorted(set(tracks) - set(known), key=lambda i: tracks[i].frequency.mean)
    for identity in fresh:
        below = [tracks[k].frequency.mean < tracks[identity].frequency.mean for k in known]
        known.insert(sum(below), identity)
    events = []
    for place in range(len(known) - 1):
        low, high = known[place], known[place + 1]
        if _passed(tracks[low], tracks[high]):
            known[place], known[place + 1] = high, low
            events.append(TrackEvent("crossed", low, epoch, high))
    return tuple(known), events


def veered(
    order: tuple[int, ...], tracks: dict[int, Track], epoch: int
) -> tuple[dict[int, Track], list[TrackEvent]]:
    """Neighbours that have exchanged shapes, with their new shapes."""
    renewed: dict[int, Track] = {}
    events = []
    for low, high in itertools.pairwise(order):
        one, other = tracks[low], tracks[high]
        if low in renewed or not _exchanged(one, other):
            continue
        renewed |= {low: one.known_anew(), high: other.known_anew()}
        events.append(TrackEvent("veered", low, epoch, high))
    return renewed, events


def _passed(low: Track, high: Track) -> bool:
    apart = low.frequency.mean - high.frequency.mean
    return apart > SURE * math.hypot(low.frequency.sd, high.frequency.sd)


def _exchanged(one: Track, other: Track) -> bool:
    if one.shape.directions == 0:
        return False
    own = shapes.alike(one.shape, one.known_by), shapes.alike(other.shape, other.known_by)
    cross = shapes.alike(one.shape, other.known_by), shapes.alike(other.shape, one.known_by)
    return max(own) < 0.5 < min(cross)
