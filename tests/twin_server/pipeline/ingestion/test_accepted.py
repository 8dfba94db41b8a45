"""Digests for acknowledgements: of the same range whatever the rounds, a few rows in each."""

import pytest

from slowtime_services.digests import MODULUS, digest_of
from twin_server.collect import Run
from twin_server.persist import FeatureRow
from twin_server.pipeline.ingestion.accepted import ROWS_OF_ALL, ROWS_OF_ONE, RangeProver


class Rows:
    """A store of boots whose features are all there, but for some."""

    def __init__(self, missing=()):
        self.missing, self.read = set(missing), 0

    def messages_of_boot(self, number, first, last):
        found = [
            FeatureRow(number, s, s, 0.0, b"%d" % s, b"")
            for s in range(first, last + 1)
            if s not in self.missing
        ]
        self.read += len(found)
        return found


def prover_of(rows, clock):
    return RangeProver(rows, lambda: clock[0])


def digest(first, last):
    return sum(digest_of(s, b"%d" % s) for s in range(first, last + 1)) % MODULUS


def proven(prover, clock, run):
    """Ask in round after round, until the range is told."""
    for rounds in range(1, 100):
        clock[0] += 0.2
        if (found := prover.range_of(run)) is not None:
            return found, rounds
    raise AssertionError("the range is never told")


@pytest.fixture
def clock():
    return [0.0]


@pytest.fixture
def restarted():
    run = Run("lab", "beam", "b1", number=1, next=3_000, last=2_999)
    run.interrupt(3_000)
    run.floor = 0
    return run


def test_a_long_range_is_read_in_rounds_and_told_once(clock, restarted):
    rows = Rows()
    prover = prover_of(rows, clock)
    restarted.held_from = 100
    found, rounds = proven(prover, clock, restarted)
    assert (found.sequence, found.first, found.digest) == (2_999, 100, digest(100, 2_999))
    assert rounds == -(-2_900 // ROWS_OF_ONE)
    assert rows.read == 2_900
    restarted.held_from = 100
    assert prover.range_of(restarted) == found
    assert rows.read == 2_900


def test_what_is_before_a_gap_is_read_once_and_not_again(clock, restarted):
    rows = Rows(missing={2_600})
    prover = prover_of(rows, clock)
    for _ in range(5):
        restarted.held_from = 0
        found, _ = proven(prover, clock, restarted)
        assert (found.first, found.digest) == (2_601, digest(2_601, 2_999))
    assert rows.read <= ROWS_OF_ONE


def test_what_an_agent_holds_of_an_earlier_range_is_told_alone(clock, restarted):
    prover = prover_of(Rows(), clock)
    restarted.held_from, restarted.held_to = 10, 1_500
    found, rounds = proven(prover, clock, restarted)
    assert (found.sequence, found.first, found.digest) == (1_500, 10, digest(10, 1_500))
    assert rounds > 1


def test_one_asset_has_one_turn_in_a_round_and_all_together_a_limit(clock):
    rows = Rows()
    prover = prover_of(rows, clock)
    clock[0] = 1.0
    for asset in range(50):
        for boot in range(3):
            run = Run("lab", f"a{asset}", f"b{boot}", number=1, next=3_000, last=2_999)
            run.stretch, run.held_from = 3_000, 0
            assert prover.range_of(run) is None
    assert rows.read == ROWS_OF_ALL
