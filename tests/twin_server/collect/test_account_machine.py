"""The account as a state machine: it holds, and the model finds faults that are planted."""

import os

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis.errors import FlakyFailure
from hypothesis.stateful import run_state_machine_as_test

from tests.twin_server.collect.account_machine import HEALING, AccountMachine
from twin_server.collect import boots, sequence

SHORT = settings(
    max_examples=25,
    stateful_step_count=25,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
LONG_EXAMPLES = int(os.environ.get("SLOWTIME_MODEL_EXAMPLES", "1500"))


def test_the_account_holds_whatever_edges_and_servers_do():
    run_state_machine_as_test(AccountMachine, settings=SHORT)


@pytest.mark.long
def test_the_account_holds_in_many_more_histories():
    """An hour takes SLOWTIME_MODEL_EXAMPLES=40000."""
    long = settings(
        SHORT, max_examples=LONG_EXAMPLES, derandomize=False, stateful_step_count=40
    )
    run_state_machine_as_test(AccountMachine, settings=long)


def believe_every_end(monkeypatch):
    """Wait for whatever an agent states, as far as it reaches."""
    monkeypatch.setattr(
        AccountMachine, "_new", lambda self: self.account_class(HEALING, max_jump=2**62)
    )


def walk_through_holes(monkeypatch):
    """Walk through a hole number by number, where it is given up."""
    given_up = sequence.give_up

    def walk(run, hole, certain, change):
        for _ in range(hole[0], min(hole[1], hole[0] + 10**5)):
            pass
        given_up(run, hole, certain, change)

    monkeypatch.setattr(sequence, "give_up", walk)


def forget_what_is_held(monkeypatch):
    """Let a boot in without storing what waited with it."""
    let_in = boots._let_in

    def without_rows(line, run, holding, answered, limits, change):
        before = len(change.held)
        let_in(line, run, holding, answered, limits, change)
        del change.held[before:]
        run.held.clear()
        run.told = run.next - 1

    monkeypatch.setattr(boots, "_let_in", without_rows)


@pytest.mark.parametrize("plant", [believe_every_end, walk_through_holes, forget_what_is_held])
def test_the_model_finds_a_planted_fault(monkeypatch, plant):
    plant(monkeypatch)
    search = settings(SHORT, phases=[Phase.generate], max_examples=60)
    with pytest.raises((AssertionError, FlakyFailure, ExceptionGroup)):
        run_state_machine_as_test(AccountMachine, settings=search)
