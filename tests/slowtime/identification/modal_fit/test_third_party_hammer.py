"""Hammer tests of five modes that SciPy simulates: `StateSpace`, `lsim` and `decimate`."""

import functools

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from slowtime.identification.frequency_response.hammer import hammer_response
from slowtime.identification.frequency_response.hits import find_hits, rest_before
from slowtime.identification.modal_fit.blows import identify_blows
from slowtime.identification.modal_fit.identification import identify_responses

RATE, FINER, GAP_S = 512.0, 8, 6.0
MASSES = np.diag([2.0, 1.5, 1.8, 1.2, 1.6])
SPRINGS = 3e4 * np.array([9.0, 7.0, 8.0, 6.0, 5.0])
STIFFNESS = (
    np.diag(SPRINGS + np.append(SPRINGS[1:], 0.0))
    - np.diag(SPRINGS[1:], 1)
    - np.diag(SPRINGS[1:], -1)
)
OMEGA = np.sqrt(scipy.linalg.eigh(STIFFNESS, MASSES, eigvals_only=True))
TRUTH = np.stack([OMEGA / (2 * np.pi), (0.3 / OMEGA + 2e-5 * OMEGA) / 2], axis=1)
"""Frequencies [Hz] and damping ratios under damping of 0.3 M + 2e-5 K."""
BAND = (2.0, 120.0)


@functools.cache
def system():
    damping = 0.3 * MASSES + 2e-5 * STIFFNESS
    below = -np.linalg.solve(MASSES, np.hstack([STIFFNESS, damping]))
    a = np.vstack([np.hstack([np.zeros((5, 5)), np.eye(5)]), below])
    b = np.vstack([np.zeros((5, 5)), np.linalg.inv(MASSES)])
    return scipy.signal.StateSpace(a, b, below, np.linalg.inv(MASSES))


@functools.cache
def record(seed, place, lead_s=1.0):
    """Force at one point and accelerations at all, of five blows."""
    rng = np.random.default_rng(seed)
    fine = np.arange(round((lead_s + 5 * GAP_S) * RATE * FINER)) / (RATE * FINER)
    force = np.zeros(len(fine))
    for at in lead_s + GAP_S * np.arange(5) + np.append(0.0, rng.uniform(0, 0.2, 4)):
        inside = (fine >= at) & (fine < at + 0.004)
        size = rng.uniform(80, 150)
        force[inside] = size * np.sin(np.pi * (fine[inside] - at) / 0.004)
    _, y, _ = scipy.signal.lsim(system(), np.outer(force, np.eye(5)[place]), fine)
    both = scipy.signal.decimate(np.column_stack([force, y]), FINER, ftype="fir", axis=0)
    both[:, 1:] += 0.01 * both[:, 1:].std(axis=0) * rng.standard_normal(both[:, 1:].shape)
    both[:, 0] += 1e-3 * both[:, 0].max() * rng.standard_normal(len(both))
    return both[:, 0], both[:, 1:]


def deviations(modes):
    """Errors over their standard deviations, of frequency and damping of each mode."""
    assert len(modes) == 5
    return [
        (measured.value - true) / measured.sd
        for mode, both in zip(modes, TRUTH, strict=True)
        for measured, true in zip((mode.frequency_hz, mode.damping_ratio), both, strict=True)
    ]


def from_record(force, responses):
    hits = find_hits(force, responses, RATE)
    return identify_blows(force, responses, RATE, hits, band_hz=BAND).result.modes


def from_responses(force, responses):
    hits = find_hits(force, responses, RATE)
    measured = hammer_response(force, responses, RATE, hits, kind="acceleration")
    return identify_responses(measured, band_hz=BAND).result.modes


@pytest.mark.parametrize("source", [from_record, from_responses])
def test_five_of_five_modes_are_within_two_standard_deviations(source):
    found = np.array([deviations(source(*record(seed, 4))) for seed in range(6)])
    # Of 60 values 2.7 lie outside by chance; 9 or more do in 1 case of 1000.
    assert np.count_nonzero(np.abs(found) > 2) < 9
    assert np.abs(found).max() < 4.5


def test_a_record_that_begins_with_the_blow_is_as_one_with_a_tenth_of_a_second_before_it():
    force, responses = record(31, 4, lead_s=0.3)
    blow = int(np.flatnonzero(force > 5)[0]) - 1
    modes = []
    for first in (blow, blow - round(0.1 * RATE)):
        f, y = force[first:], responses[first:]
        lead = rest_before(f, y)
        f = np.concatenate([np.full(lead, np.median(f)), f])
        y = np.concatenate([np.tile(np.median(y, axis=0), (lead, 1)), y])
        assert not [hit.refused for hit in find_hits(f, y, RATE) if hit.refused]
        modes.append(from_record(f, y))
    for one, other in zip(*modes, strict=True):
        for name in ("frequency_hz", "damping_ratio"):
            a, b = getattr(one, name), getattr(other, name)
            assert abs(a.value - b.value) < 0.5 * b.sd
            # The filter of no phase answers before the blow, which the first record lacks.
            assert a.sd == pytest.approx(b.sd, rel=0.6)
