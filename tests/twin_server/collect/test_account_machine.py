"""The account as a state machine: it holds, and the model finds faults that are planted."""

import pytest

from tests.state_machines import assert_found, run_long, run_share
from tests.twin_server.collect.account_machine import HEALING, AccountMachine
from twin_server.collect import boots, sequence


@pytest.mark.gate
def test_the_account_holds_whatever_edges_and_servers_do():
    run_share(AccountMachine)


@pytest.mark.long
def test_the_account_holds_for_as_long_as_is_asked():
    assert run_long(AccountMachine) > 0


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


@pytest.mark.gate
@pytest.mark.parametrize("plant", [believe_every_end, walk_through_holes, forget_what_is_held])
def test_the_model_finds_a_planted_fault(monkeypatch, plant):
    plant(monkeypatch)
    assert_found(AccountMachine)
