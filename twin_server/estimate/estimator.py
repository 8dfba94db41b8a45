"""Estimates the states of many twins from their next features, all at once.

A state depends on nothing but the twin's registration and its features in order: not on the
clock, not on when they arrived, not on how the stream was cut into batches.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtri

from slowtime.evolution import (
    Change,
    mass_from_frequency,
    stiffness_and_mass,
    stiffness_from_frequency,
)
from slowtime_schemas.messages import Features
from twin_server.history import states as st
from twin_server.history.details import Detail
from twin_server.history.states import States
from twin_server.registration.twin import Registration

from .alarms import follow_alarms
from .checkpoint import Checkpoint, Twin
from .columns import Columns, columns
from .element_states import estimate_elements
from .nominal.reference import Nominals, nominals_of
from .notices import Notice
from .renewals import follow_renewals

LEVEL = 0.95
"""Probability of every interval."""

_QUANTILE = float(ndtri(0.5 + 0.5 * LEVEL))
_ANY_DAMPING = 0.02
"""Nominal damping ratio where none is known [1]; `_UNKNOWN` keeps it from mattering."""

_UNKNOWN = 1e3
"""Relative standard deviation of a nominal damping ratio that is not known [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Estimates:
    """Estimates of some features of many twins.

    Parameters
    ----------
    states
        One for each features message, in the same order.
    checkpoints
        One for each twin.
    notices
        For each twin; their rows count within `states`.
    details
        Of each state of a twin of elements; empty where there is no such twin.
    """

    states: States
    checkpoints: list[Checkpoint]
    notices: list[list[Notice]]
    details: Sequence[Detail | None] = ()


def estimate(
    twins: Sequence[Twin],
    features: Sequence[Features],
    owners: Sequence[int],
    missing_before: Sequence[int],
    covered: Sequence[float] = (),
) -> Estimates:
    """Estimate the states of `twins` from their next features.

    Parameters
    ----------
    twins
        Those that have features here.
    features
        Of each twin in order; those of different twins may alternate.
    owners
        For each features message, the place of its twin in `twins`.
    missing_before
        For each, how many are missing between it and the one before.
    covered
        For each, the share of its time that earlier windows have measured [1]; empty for none.
    """
    covered = covered or [0.0] * len(features)
    of_elements = [t.registration.changes == "elements" for t in twins]
    if any(of_elements):
        return _estimate_by_kind(twins, features, owners, missing_before, covered, of_elements)
    owner = np.asarray(owners, dtype=np.intp)
    modes = [twin.registration.mode for twin in twins]
    freed = [twin.registration.covariates is not None for twin in twins]
    each = [freed[place] for place in owners] if any(freed) else None
    given = columns(features, [modes[place] for place in owners], each, covered)
    rows_of = _rows_by_owner(owner, len(twins))
    nominals, checkpoints, learnt = nominals_of(twins, features, given, owner, rows_of)
    # What leaves the range of floats is found and named below, not warned of.
    with np.errstate(all="ignore"):
        states = _begin(given, missing_before)
        st.note_coverage(states, covered)
        _estimate_all(states, given, nominals, twins, owner)
    notices: list[list[Notice]] = []
    for place, (twin, rows) in enumerate(zip(twins, rows_of, strict=True)):
        checkpoints[place], seen = follow_alarms(
            twin.registration, checkpoints[place], states[rows]
        )
        theirs = [features[row] for row in rows.tolist()]
        checkpoints[place], renewed = follow_renewals(checkpoints[place], theirs)
        seen = sorted(renewed + learnt[place] + seen, key=lambda notice: notice.row)
        notices.append([notice._replace(row=int(rows[notice.row])) for notice in seen])
    return Estimates(states, checkpoints, notices)


def _estimate_by_kind(
    twins: Sequence[Twin],
    features: Sequence[Features],
    owners: Sequence[int],
    missing_before: Sequence[int],
    covered: Sequence[float],
    of_elements: Sequence[bool],
) -> Estimates:
    """Estimate twins of elements one by one, and all others together."""
    rows_of = _rows_by_owner(np.asarray(owners, dtype=np.intp), len(twins))
    states, checkpoints = st.blank(len(features)), [twin.checkpoint for twin in twins]
    notices: list[list[Notice]] = [[] for _ in twins]
    details: list[Detail | None] = [None] * len(features)
    for place, twin in enumerate(twins):
        rows = rows_of[place].tolist()
        if not of_elements[place] or not rows:
            continue
        told = estimate_elements(
            twin.registration,
            twin.checkpoint,
            [features[row] for row in rows],
            [missing_before[row] for row in rows],
            [covered[row] for row in rows],
        )
        states[rows], checkpoints[place] = told.states, told.checkpoint
        notices[place] = [notice._replace(row=rows[notice.row]) for notice in told.notices]
        for row, detail in zip(rows, told.details, strict=True):
            details[row] = detail
    others = [place for place, apart in enumerate(of_elements) if not apart]
    among_others = {place: number for number, place in enumerate(others)}
    rows = sorted(row for place in others for row in rows_of[place].tolist())
    if rows:
        found = estimate(
            [twins[place] for place in others],
            [features[row] for row in rows],
            [among_others[owners[row]] for row in rows],
            [missing_before[row] for row in rows],
            [covered[row] for row in rows],
        )
        states[rows] = found.states
        for place, checkpoint, seen in zip(
            others, found.checkpoints, found.notices, strict=True
        ):
            checkpoints[place] = checkpoint
            notices[place] = [notice._replace(row=rows[notice.row]) for notice in seen]
    return Estimates(states, checkpoints, notices, details)


def _rows_by_owner(owner: Int[np.ndarray, " time"], count: int) -> list[Int[np.ndarray, " _"]]:
    order = np.argsort(owner, kind="stable")
    bounds = np.searchsorted(owner[order], np.arange(count + 1))
    return [order[bounds[i] : bounds[i + 1]] for i in range(count)]


def _begin(given: Columns, missing_before: Sequence[int]) -> States:
    """States with the measured values, and no change yet."""
    states = st.blank(len(given))
    states["sequence"], states["t_ns"] = given.sequence, given.t_ns
    states["slow_time"], states["truth"] = given.slow_time, given.truth
    states["missing_before"] = missing_before
    states["reasons"] = np.where(np.isnan(given.frequency_hz), st.NO_MODE, 0)
    _put(states, "damping_ratio", given.damping_ratio, given.damping_sd)
    return states


def _put(
    states: States,
    name: str,
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
) -> None:
    half = _QUANTILE * sd
    estimate = np.column_stack((value, sd, value - half, value + half))
    estimate[~np.isfinite(estimate).all(axis=1)] = np.nan
    states[name] = estimate


def _estimate_all(
    states: States,
    given: Columns,
    nominals: Nominals,
    twins: Sequence[Twin],
    owner: Int[np.ndarray, " time"],
) -> None:
    """Fill in the frequency used and the changes, one call for all twins of a kind."""
    wants_smoothed = _of_each(twins, owner, lambda r: r.frequency_source == "smoothed")
    smoothed = (wants_smoothed > 0) & ~np.isnan(given.smoothed_hz)
    frequency = np.where(smoothed, given.smoothed_hz, given.frequency_hz)
    sd = np.where(smoothed, given.smoothed_sd, given.frequency_sd)
    _put(states, "frequency_hz", frequency, sd)
    states["notes"] |= np.where(smoothed, st.USED_SMOOTHED, 0).astype(np.uint32)
    unknown = np.isnan(nominals.frequency)
    learning = unknown & ~nominals.under_covariates
    states["reasons"] |= np.where(learning, st.LEARNING, 0).astype(np.uint32)
    lost = np.isnan(states["frequency_hz"][:, 0]) & ~np.isnan(frequency)
    states["reasons"] |= np.where(lost, st.NOT_REPRESENTABLE, 0).astype(np.uint32)
    frequency, sd, correlation = _freed(states, nominals, frequency, sd, given.correlation)
    usable = ~unknown & ~np.isnan(frequency)
    free = _of_each(twins, owner, lambda r: r.damping_coefficient_sd)
    for kind, theirs in _rows_by_kind(twins, owner):
        _assume(states, theirs, kind[0])
        rows = theirs[usable[theirs]]
        if rows.size == 0:
            continue
        ratio = frequency[rows] / nominals.frequency[rows]
        if kind[0] == "both":
            # The smoothed frequency carries several epochs' errors, not this one's.
            shared = np.where(smoothed[rows], 0.0, correlation[rows])
            _both(states, rows, ratio, sd, frequency, given, nominals, kind, free[rows], shared)
        else:
            ratio_sd = sd[rows] / nominals.frequency[rows]
            one = stiffness_from_frequency if kind[0] == "stiffness" else mass_from_frequency
            change = one(
                ratio, ratio_sd, nominal_relative_sd=nominals.relative_sd[rows], level=LEVEL
            )
            _put_change(states, rows, f"{kind[0]}_change", change)


def _freed(
    states: States,
    nominals: Nominals,
    frequency: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
    correlation: Float[np.ndarray, " time"],
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Frequencies that covariates act on as they would be at the reference, with their sds.

    What is added to their errors has nothing to do with damping.
    """
    rows = np.flatnonzero(nominals.under_covariates)
    if not rows.size:
        return frequency, sd, correlation
    before = sd[rows] / frequency[rows]
    frequency, sd, correlation = frequency.copy(), sd.copy(), correlation.copy()
    frequency[rows], sd[rows] = nominals.freed_hz[rows], nominals.freed_sd[rows]
    correlation[rows] *= before / (sd[rows] / frequency[rows])
    states["reasons"][rows] |= nominals.reasons[rows]
    return frequency, sd, correlation


_Kind = tuple[str, float, float]


def _kind(registration: Registration) -> _Kind:
    """Return the key that readings estimated in one call share."""
    if registration.changes == "both":
        return "both", registration.prior_stiffness_sd, registration.prior_mass_sd
    return registration.changes, 0.0, 0.0


def _rows_by_kind(
    twins: Sequence[Twin], owner: Int[np.ndarray, " time"]
) -> list[tuple[_Kind, Int[np.ndarray, " _"]]]:
    """Return the readings of each kind, in order; kinds in the order of their first twin."""
    numbers: dict[_Kind, int] = {}
    of_twin = [numbers.setdefault(_kind(twin.registration), len(numbers)) for twin in twins]
    each = np.array(of_twin, dtype=np.intp)[owner]
    return list(zip(numbers, _rows_by_owner(each, len(numbers)), strict=True))


def _of_each(
    twins: Sequence[Twin],
    owner: Int[np.ndarray, " time"],
    of: Callable[[Registration], float],
) -> Float[np.ndarray, " time"]:
    """Return one value of the registration of each reading."""
    each: Float[np.ndarray, " time"] = np.array(
        [float(of(twin.registration)) for twin in twins]
    )[owner]
    return each


def _assume(states: States, rows: Int[np.ndarray, " some"], changes: str) -> None:
    for kept, bit in (("stiffness", st.ASSUMES_STIFFNESS), ("mass", st.ASSUMES_MASS)):
        if changes not in (kept, "both"):
            states[f"{kept}_change"][rows] = 0.0
            states["notes"][rows] |= bit


def _put_change(
    states: States, rows: Int[np.ndarray, " some"], name: str, change: Change
) -> None:
    estimate = np.column_stack((change.value, change.sd, change.lo, change.hi))
    sound = np.isfinite(estimate).all(axis=1)
    estimate[~sound] = np.nan
    unsaid = ~sound & (change.reasons == 0)
    states[name][rows] = estimate
    states["reasons"][rows] |= change.reasons
    states["reasons"][rows] |= np.where(unsaid, st.NOT_REPRESENTABLE, 0).astype(np.uint32)


def _both(
    states: States,
    rows: Int[np.ndarray, " some"],
    ratio: Float[np.ndarray, " some"],
    sd: Float[np.ndarray, " time"],
    frequency: Float[np.ndarray, " time"],
    given: Columns,
    nominals: Nominals,
    kind: _Kind,
    free: Float[np.ndarray, " some"],
    correlation: Float[np.ndarray, " some"],
) -> None:
    unknown = ~((nominals.damping[rows] > 1e-6) & (nominals.damping[rows] < 1.0))
    damping_0 = np.where(unknown, _ANY_DAMPING, nominals.damping[rows])
    damping_0_sd = np.where(unknown, _UNKNOWN, nominals.damping_relative_sd[rows])
    damping = given.damping_ratio[rows]
    positive = damping > 0.0
    relative = np.where(
        positive, given.damping_sd[rows] / np.where(positive, damping, 1.0), np.nan
    )
    joint = stiffness_and_mass(
        ratio,
        sd[rows] / frequency[rows],
        damping,
        relative,
        damping_ratio_0=damping_0,
        correlation=correlation,
        prior_stiffness_sd=kind[1],
        prior_mass_sd=kind[2],
        damping_coefficient_sd=free,
        nominal_relative_sd=nominals.relative_sd[rows],
        nominal_damping_relative_sd=damping_0_sd,
        level=LEVEL,
    )
    _put_change(states, rows, "stiffness_change", joint.stiffness)
    _put_change(states, rows, "mass_change", joint.mass)
    states["correlation"][rows] = np.nan_to_num(joint.correlation)
    states["reasons"][rows] |= np.where(unknown, st.NO_DAMPING, 0).astype(np.uint32)
