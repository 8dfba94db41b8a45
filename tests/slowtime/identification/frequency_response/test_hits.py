"""Blows are found; bounces, overloads and cut blocks are refused with the reason."""

import numpy as np
import pytest

from slowtime.identification.frequency_response.excitation import kind_of_excitation
from slowtime.identification.frequency_response.hammer import hammer_response
from slowtime.identification.frequency_response.hits import find_hits
from tests.slowtime.identification.modal_fit.structures import blows, frame, response_to

RATE = 256.0
AT = 1.0 + 6.0 * np.arange(5)


def record(extra=(), seed=1):
    rng = np.random.default_rng(seed)
    at = np.concatenate([AT, [one[0] for one in extra]])
    peaks = np.concatenate([np.linspace(80, 120, 5), [one[1] for one in extra]])
    force = blows(at, peaks, RATE, 31.0)
    responses = response_to(frame(3), np.column_stack([force, 0 * force]), RATE)
    force = force + 0.05 * rng.standard_normal(len(force))
    return force, responses + 0.02 * rng.standard_normal(responses.shape)


def test_all_blows_are_found_and_used():
    force, responses = record()
    hits = find_hits(force, responses, RATE)
    np.testing.assert_allclose([hit.at_s for hit in hits], AT + 0.005, atol=0.005)
    assert [hit.refused for hit in hits] == [""] * 5


def test_a_negative_force_is_found_as_well():
    force, responses = record()
    assert len(find_hits(-force, responses, RATE)) == 5


@pytest.mark.parametrize("size", [10.0, 60.0, 200.0])
def test_a_bounce_is_refused_however_strong_it_is(size):
    force, responses = record([(AT[2] + 0.08, size)])
    hits = find_hits(force, responses, RATE)
    assert [bool(hit.refused) for hit in hits] == [False, False, True, False, False]
    assert "double hit" in hits[2].refused


def test_a_clipped_response_is_refused_by_its_flat_top():
    force, responses = record()
    limit = 0.6 * np.abs(responses[:, 1]).max()
    responses[:, 1] = np.clip(responses[:, 1], -limit, limit)
    hits = find_hits(force, responses, RATE)
    assert any(hit.refused == "overload of response 2" for hit in hits)


def test_the_flat_top_of_a_coarse_converter_is_no_overload():
    force, responses = record()
    step = np.abs(responses).max() / 20
    coarse = np.round(responses / step) * step
    # Twice the same largest value, reached by a step of the converter.
    at = int(np.argmax(coarse[:, 2]))
    coarse[at - 1 : at + 3, 2] = coarse[at, 2]
    coarse[[at - 2, at + 3], 2] = coarse[at, 2] - step
    assert not any(hit.refused for hit in find_hits(force, coarse, RATE))


def test_a_known_range_tells_an_overload():
    force, responses = record()
    limits = np.array([100.0, 1e3, 1e3, 1e3])
    refused = [hit.refused for hit in find_hits(force, responses, RATE, limits=limits)]
    assert refused == ["", "", "overload of the force"] + ["overload of the force"] * 2 or (
        refused[-1] == "overload of the force" and refused[0] == ""
    )


def test_a_block_that_holds_the_next_blow_says_so_and_not_that_the_hammer_bounced():
    force, responses = record()
    hits = find_hits(force, responses, RATE, block_s=7.0)
    assert [hit.refused for hit in hits[:4]] == [
        "the next blow comes 6 s later, in its block of 7 s"
    ] * 4


def test_a_block_beyond_the_record_is_refused():
    force, responses = record()
    hits = find_hits(force[: -round(3 * RATE)], responses[: -round(3 * RATE)], RATE)
    assert hits[-1].refused == "its block reaches beyond the record"
    assert not hits[0].refused


def test_noise_alone_has_no_blow():
    rng = np.random.default_rng(2)
    noise = rng.standard_normal((4000, 2))
    with pytest.raises(ValueError, match=r"No blow was found.*channel of the hammer"):
        find_hits(noise[:, 0], noise[:, 1:], RATE)


def test_hammers_and_shakers_are_told_apart():
    rng = np.random.default_rng(3)
    assert kind_of_excitation(record()[0][:, None]) == "hammer"
    assert kind_of_excitation(rng.standard_normal((4000, 1))) == "shaker"
    assert kind_of_excitation(np.sin(0.1 * np.arange(4000))[:, None]) == "shaker"


def test_the_exponential_window_moves_poles_exactly():
    """After rest, the windowed response is that of the structure at s = j omega + sigma."""
    force, _ = record()
    structure = frame(3, damping=0.05)
    u = np.column_stack([force * (force > 1), 0 * force])
    responses = response_to(structure, u, RATE)
    hits = find_hits(u[:, 0], responses, RATE)
    response = hammer_response(u[:, 0], responses, RATE, hits, decay_rate=2.0).within(1.0, 20.0)
    true = structure.acceleration(response.s)[:, :, :1]
    assert np.abs(response.response - true).max() < 0.02 * np.abs(true).max()
    at_rest = structure.acceleration(2j * np.pi * response.frequency_hz)[:, :, :1]
    assert np.abs(response.response - at_rest).max() > 0.2 * np.abs(true).max()


def test_without_a_useful_blow_all_reasons_are_told():
    force, responses = record([(at + 0.1, 50.0) for at in AT])
    hits = find_hits(force, responses, RATE)
    with pytest.raises(ValueError, match=r"None of 5 blows is of use.*double hit"):
        hammer_response(force, responses, RATE, hits)


def test_a_structure_that_still_rings_before_a_blow_is_told():
    force, responses = record()
    ringing = find_hits(force, responses, RATE)
    still = responses.copy()
    for hit in ringing:
        still[hit.pulse[0] - 100 : hit.pulse[0]] = 0.0
    assert ringing[2].ringing > 0.05
    assert find_hits(force, still, RATE)[2].ringing < 0.01
