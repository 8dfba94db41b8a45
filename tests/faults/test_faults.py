"""Two short seeds with real processes; and that the harness would notice what it looks for."""

import pytest

from . import campaign, player
from .ledger import Ledger, Seen, judge
from .run import Outcome, run_many
from .schedule import FLEET, KINDS, plan


@pytest.mark.system
def test_short_seeds_of_faults_leave_a_whole_account_and_the_states_of_a_quiet_life(tmp_path):
    outcomes: list[Outcome] = []
    run_many([plan(seed, 3.0) for seed in (7, 11)], tmp_path, 2, outcomes.append)
    assert [outcome.line for outcome in outcomes if outcome.faults] == []
    accepted = [o.verdict.accepted for o in outcomes if o.verdict is not None]
    assert len(accepted) == 2
    assert min(accepted) > 10


@pytest.mark.system
def test_a_short_seed_of_faults_on_a_metered_link_leaves_a_whole_account(tmp_path):
    outcomes: list[Outcome] = []
    run_many([plan(11, 5.0, link="metered")], tmp_path, 1, outcomes.append)
    assert [outcome.line for outcome in outcomes if outcome.faults] == []


@pytest.mark.system
@pytest.mark.slow
def test_a_short_seed_of_faults_over_shards_leaves_the_states_of_a_quiet_life(tmp_path):
    outcomes: list[Outcome] = []
    run_many([plan(7, 10.0, shards=2)], tmp_path, 1, outcomes.append)
    assert [outcome.line for outcome in outcomes if outcome.faults] == []


@pytest.mark.system
@pytest.mark.slow
@pytest.mark.parametrize("what", ["kills", "rolling", "backup"])
def test_a_recording_keeps_its_hashes_while_its_shards_are(what, tmp_path, capsys):
    words = ["--what", what, "--events", "4", "--seconds", "20", "--quick", "--sqlite"]
    words += ["--each", "20", "--assets", "8", "--out", str(tmp_path)]
    assert campaign.main(words) == 0
    told = capsys.readouterr().out
    assert "sound: 8 of 8 hashes identical" in told
    assert "lacking" not in told.replace(", 0 lacking", "")


def test_a_campaign_notices_what_is_missing_or_of_another_hash(tmp_path):
    messages = player.recording(3, 5, seed=1)
    expected = campaign.in_peace(messages, tmp_path / "peace.sqlite")
    part = tmp_path / "part.sqlite"
    assert campaign.in_peace(messages[:-1], part) != expected
    told = campaign.judge(str(part), [str(part)], messages, expected)
    assert [line.partition(",")[0] for line in told] == [
        "1 histories with another hash",
        "1 readings missing",
    ]


def test_a_seed_gives_the_same_schedule_again_and_all_kinds_are_drawn():
    assert plan(5, 60.0) == plan(5, 60.0)
    assert plan(5, 60.0) != plan(6, 60.0)
    drawn = {fault.kind for seed in range(40) for fault in plan(seed, 60.0).faults}
    assert drawn == set(KINDS)
    befallen = {fault.who for seed in range(40) for fault in plan(seed, 60.0, 2).faults}
    assert befallen >= {"shard-0", "shard-1", FLEET, "twin", "router"}


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
