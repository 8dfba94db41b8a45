"""Two short seeds with real processes; and that the harness would notice what it looks for."""

import pytest

from .ledger import Ledger, Seen, judge
from .run import Outcome, run_many
from .schedule import KINDS, plan


@pytest.mark.system
def test_short_seeds_of_faults_leave_a_whole_account_and_the_states_of_a_quiet_life(tmp_path):
    outcomes: list[Outcome] = []
    run_many([plan(seed, 3.0) for seed in (7, 11)], tmp_path, 2, outcomes.append)
    assert [outcome.line for outcome in outcomes if outcome.faults] == []
    accepted = [o.verdict.accepted for o in outcomes if o.verdict is not None]
    assert len(accepted) == 2
    assert min(accepted) > 10


def test_a_seed_gives_the_same_schedule_again_and_all_kinds_are_drawn():
    assert plan(5, 60.0) == plan(5, 60.0)
    assert plan(5, 60.0) != plan(6, 60.0)
    drawn = {fault.kind for seed in range(40) for fault in plan(seed, 60.0).faults}
    assert drawn == set(KINDS)


def made(*sequences):
    ledger = Ledger()
    for sequence in sequences:
        line = b'{"asset":"beam","boot":"b","sequence":%d}' % sequence
        ledger._note(b"M" + line)
        ledger._note(b"K" + line)
    return ledger, dict(ledger.made)


def test_what_is_missing_doubled_altered_or_invented_is_noticed():
    ledger, payloads = made(*range(6))
    history = list(payloads.items())
    sound = judge(ledger, Seen(history, []))
    assert sound.faults == []
    lost = ("beam", "b", 2, 3, "why")
    assert judge(ledger, Seen(history[:2] + history[4:], [lost])).faults == []
    assert len(judge(ledger, Seen(history[:2] + history[4:], [])).unaccounted) == 2
    assert judge(ledger, Seen([*history, history[0]], [])).doubled == [history[0][0]]
    altered = [(history[0][0], b"{}"), *history[1:]]
    assert judge(ledger, Seen(altered, [])).altered == [history[0][0]]
    foreign = ("beam", "b", 9)
    assert judge(ledger, Seen([*history, (foreign, b"")], [])).invented == [foreign]
    assert judge(ledger, Seen(history, [lost])).contradicted == [history[2][0], history[3][0]]
