"""What was appended can be read again: after a kill, with a torn tail, and in its order."""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from edge_agent.publish import Spool, SpoolError
from edge_agent.publish.damaged_bytes import DamagedBytes
from edge_agent.publish.spool_records import Damage


def payload(number):
    return b'{"sequence":%d,"filling":"%s"}' % (number, b"x" * (40 + number % 50))


def fill(folder, boot, numbers, **more):
    spool = Spool(folder, boot, **more)
    for number in numbers:
        spool.append(number, payload(number))
    return spool


def test_features_come_back_in_order_within_the_range_asked_for(tmp_path):
    spool = fill(tmp_path, "b1", range(500), segment_bytes=4096)
    assert len(list(tmp_path.glob("*.spool"))) > 5
    assert list(spool.read("b1")) == [payload(n) for n in range(500)]
    assert list(spool.read("b1", 123, 341)) == [payload(n) for n in range(123, 342)]
    assert list(spool.read("b2")) == []
    assert spool.held() == (("b1", 0, 499),)


def test_an_earlier_boot_is_still_held_beside_the_new_one(tmp_path):
    fill(tmp_path, "b1", range(30)).close()
    spool = fill(tmp_path, "b2", range(4))
    assert spool.held() == (("b1", 0, 29), ("b2", 0, 3))
    assert list(spool.read("b1", 28)) == [payload(28), payload(29)]
    assert spool.acknowledge("b1", 29) == 30
    assert spool.held() == (("b2", 0, 3),)


def test_acknowledged_segments_go_and_unacknowledged_ones_stay(tmp_path):
    spool = fill(tmp_path, "b1", range(500), segment_bytes=4096)
    forgotten = spool.acknowledge("b1", 250)
    (held,) = spool.held()
    assert held.first == forgotten <= 251
    assert held.last == 499
    assert list(spool.read("b1", 251)) == [payload(n) for n in range(251, 500)]
    spool.acknowledge("b1", 499)
    assert spool.held() == ()
    spool.append(500, payload(500))
    assert spool.held() == (("b1", 500, 500),)
    assert spool.size == sum(path.stat().st_size for path in tmp_path.glob("*.spool"))


def test_a_full_spool_drops_its_oldest_segment_and_counts_what_was_in_it(tmp_path):
    spool = fill(tmp_path, "b1", range(2000), segment_bytes=4096, max_bytes=65_536)
    (held,) = spool.held()
    assert spool.dropped == held.first > 0
    assert spool.size <= 65_536
    assert spool.size == sum(path.stat().st_size for path in tmp_path.glob("*.spool"))
    assert list(spool.read("b1")) == [payload(n) for n in range(held.first, 2000)]


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_tail_torn_anywhere_costs_only_what_was_torn(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("spool")
    fill(folder, "b1", range(20)).close()
    (path,) = folder.glob("*.spool")
    whole = path.read_bytes()
    keep = data.draw(st.integers(0, len(whole)))
    noise = data.draw(st.binary(max_size=40))
    path.write_bytes(whole[:keep] + noise)
    ends = [8]
    for number in range(20):
        ends.append(ends[-1] + 16 + len(payload(number)))
    sound = sum(end <= keep for end in ends[1:])
    spool = Spool(folder, "b2")
    read = list(spool.read("b1"))
    assert read[:sound] == [payload(n) for n in range(sound)]
    assert len(read) == sound or whole[:keep] + noise == whole[: keep + len(noise)]
    spool.append(0, b"new")
    assert list(spool.read("b2")) == [b"new"]
    spool.close()


def positions(numbers):
    """Where each record begins in a segment that begins with the first of `numbers`."""
    at, found = 8, {}
    for number in numbers:
        found[number] = (at, at + 16 + len(payload(number)))
        at = found[number][1]
    return found


def reopened(folder, data, boot="b2"):
    """Put `data` in place of the one segment of boot b1; give what arrives and what is told."""
    path = next(path for path in folder.glob("*.spool") if ".b1." in path.name)
    path.write_bytes(data)
    spool = Spool(folder, boot)
    arrived = list(spool.read("b1"))
    ranges = spool.damaged_ranges("b1")
    held = spool.held()
    spool.close()
    return arrived, {n for first, last in ranges for n in range(first, last + 1)}, held


def test_a_flipped_bit_costs_its_record_and_no_other_and_is_told(tmp_path):
    fill(tmp_path, "b1", range(60)).close()
    (path,) = tmp_path.glob("*.spool")
    whole, where = path.read_bytes(), positions(range(60))
    rng = random.Random(7)
    heads = [where[n][0] * 8 + bit for n in (0, 30, 59) for bit in range(0, 128, 5)]
    places = [*range(0, 64, 8), *heads, *rng.sample(range(len(whole) * 8), 120)]
    for place in places:
        data = bytearray(whole)
        data[place // 8] ^= 1 << place % 8
        arrived, damaged, _ = reopened(tmp_path, data)
        hit = {n for n, (begin, end) in where.items() if begin <= place // 8 < end}
        sound = [payload(n) for n in range(60) if n not in hit]
        assert [one for one in arrived if one != payload(min(hit, default=-1))] == sound, place
        missing = {n for n in range(60) if payload(n) not in arrived}
        assert damaged == missing <= hit, place


def test_damaged_bytes_are_set_aside_and_stay_once_their_segment_is_acknowledged(tmp_path):
    fill(tmp_path, "b1", range(20)).close()
    (path,) = tmp_path.glob("*.spool")
    data, (begin, end) = bytearray(path.read_bytes()), positions(range(20))[11]
    data[end - 3] ^= 16
    path.write_bytes(data)
    spool = Spool(tmp_path, "b2")
    assert spool.damaged == 1
    assert spool.held() == (("b1", 0, 19),)
    (aside,) = tmp_path.glob("*.damaged")
    assert aside.read_bytes() == data[begin:end]
    assert spool.acknowledge("b1", 19) == 19
    assert spool.held() == ()
    assert spool.damaged_ranges("b1") == []
    assert aside.read_bytes() == data[begin:end]


@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_whatever_is_damaged_what_is_untouched_arrives_and_the_rest_is_told(
    tmp_path_factory, data
):
    folder = tmp_path_factory.mktemp("spool")
    count = data.draw(st.integers(1, 25))
    fill(folder, "b1", range(count)).close()
    (path,) = folder.glob("*.spool")
    whole, where = path.read_bytes(), positions(range(count))
    begin = data.draw(st.integers(0, len(whole) - 1))
    end = min(len(whole), begin + data.draw(st.integers(1, 300)))
    kind = data.draw(st.sampled_from(["removed", "zeros", "noise", "two flips"]))
    flipped = bytearray(whole)
    if kind == "two flips":
        flipped[begin] ^= 1 << data.draw(st.integers(0, 7))
        flipped[end - 1] ^= 1 << data.draw(st.integers(0, 7))
    else:
        size = 0 if kind == "removed" else end - begin
        noise = data.draw(st.binary(min_size=size, max_size=size))
        flipped[begin:end] = bytes(size) if kind == "zeros" else noise
    assume(len(flipped) > 8)
    arrived, damaged, ((boot, first, last),) = reopened(folder, flipped)
    untouched = [n for n, (b, e) in where.items() if e <= begin or b >= end]
    assert [one for one in arrived if one in map(payload, untouched)] == [
        payload(n) for n in untouched
    ]
    missing = {n for n in range(count) if payload(n) not in arrived}
    tail = {n for n in missing if not any(payload(m) in arrived for m in range(n, count))}
    assert missing - tail <= damaged
    # How many there were at the end can only be estimated, if nothing of them is legible.
    gone = kind == "removed" and end == len(whole)
    assert gone or not tail or (tail if kind == "two flips" else {min(tail)}) <= damaged
    assert (boot, first) == ("b1", 0)
    assert last >= max((n for n in range(count) if n not in tail), default=-1)


def test_damage_while_the_agent_runs_is_noticed_where_it_is_read(tmp_path):
    spool = fill(tmp_path, "b1", range(30))
    (path,) = tmp_path.glob("*.spool")
    data = bytearray(path.read_bytes())
    where = positions(range(30))
    for number in (4, 29):
        data[where[number][0] + 20] ^= 1
    path.write_bytes(data)
    assert list(spool.read("b1")) == [payload(n) for n in range(30) if n not in (4, 29)]
    assert spool.damaged_ranges("b1") == [(4, 4), (29, 29)]
    spool.append(30, payload(30))
    assert list(spool.read("b1", 29)) == [payload(30)]
    spool.close()


def test_a_segment_in_which_nothing_is_sound_is_told_from_first_to_last(tmp_path):
    fill(tmp_path, "b1", range(100), segment_bytes=4096).close()
    first, second, *_ = sorted(tmp_path.glob("*.spool"))
    begins, ends = int(second.name.split(".")[2]), len(first.read_bytes())
    first.write_bytes(bytes(ends))
    spool = Spool(tmp_path, "b2")
    assert spool.held() == (("b1", 0, 99),)
    assert spool.damaged_ranges("b1") == [(0, begins - 1)]
    assert list(spool.read("b1")) == [payload(n) for n in range(begins, 100)]
    spool.close()


def test_what_is_set_aside_is_bounded(tmp_path):
    aside = DamagedBytes(tmp_path, most_bytes=1_000)
    segment = tmp_path / "00000001.b1.00000000000000000000.spool"
    for number in range(20):
        aside.found(
            segment,
            "b1",
            bytes(10_000),
            Damage(number * 200, number * 200 + 199, number, number),
        )
    kept = sorted(tmp_path.glob("*.damaged"))
    assert sum(path.stat().st_size for path in kept) <= 1_000
    assert kept[-1].name == f"{segment.name}.{19 * 200:010d}.damaged"


KILLED = """
import sys
from pathlib import Path
from edge_agent.publish import Spool
spool = Spool(Path(sys.argv[1]), sys.argv[2], segment_bytes=4096)
for number in range(10**9):
    spool.append(number, b'{"n":%d}' % number)
    sys.stdout.write(f"{number}\\n"); sys.stdout.flush()
"""


@pytest.mark.long
def test_a_process_that_is_killed_loses_nothing_that_append_has_returned_from(tmp_path):
    rng = random.Random(1)
    for boot in ("b0", "b1"):
        command = [sys.executable, "-c", textwrap.dedent(KILLED), str(tmp_path), boot]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            said = [process.stdout.readline() for _ in range(rng.randrange(200, 900))]
            os.kill(process.pid, signal.SIGKILL)
            said += process.stdout.readlines()
        last = int([line for line in said if line.endswith("\n")][-1])
        spool = Spool(tmp_path, f"reader-of-{boot}")
        assert list(spool.read(boot, 0, last)) == [b'{"n":%d}' % n for n in range(last + 1)]
        spool.close()


def test_two_agents_cannot_share_a_spool_and_no_boot_is_used_twice(tmp_path):
    spool = fill(tmp_path, "b1", range(3))
    with pytest.raises(
        SpoolError, match=r"in use by another edge agent.*its own spool\.folder"
    ):
        Spool(tmp_path, "b2")
    spool.close()
    spool.close()
    with pytest.raises(SpoolError, match=r"already holds features of boot 'b1'"):
        Spool(tmp_path, "b1")


def test_sequences_must_grow(tmp_path):
    spool = fill(tmp_path, "b1", [5])
    with pytest.raises(ValueError, match="Sequence 5 was given after 5"):
        spool.append(5, b"")


def test_a_disk_that_takes_nothing_is_told_and_the_spool_goes_on_afterwards(
    tmp_path, monkeypatch
):
    spool = fill(tmp_path, "b1", range(3))
    real = os.write

    def full(file, data):
        real(file, bytes(data)[:7])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(SpoolError, match=r"No space left.*Make room on the disk"):
        spool.append(3, payload(3))
    monkeypatch.setattr(os, "write", real)
    spool.append(4, payload(4))
    spool.close()
    again = Spool(tmp_path, "b2")
    assert list(again.read("b1")) == [payload(n) for n in (0, 1, 2, 4)]


@pytest.mark.parametrize(("policy", "least"), [("never", 0), ("segment", 1), ("always", 10)])
def test_the_policy_decides_how_often_the_disk_is_waited_for(
    tmp_path, monkeypatch, policy, least
):
    calls: list[int] = []
    monkeypatch.setattr(os, "fsync", calls.append)
    fill(tmp_path, "b1", range(10), fsync=policy).close()
    assert len(calls) >= least
    assert (policy == "never") == (not calls)


def test_a_disk_that_is_full_where_a_segment_begins_is_told_and_recovered_from(
    tmp_path, monkeypatch
):
    spool = fill(tmp_path, "b1", range(3))
    spool.acknowledge("b1", 2)
    real = os.write

    def full(file, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    for number in (3, 4):
        with pytest.raises(SpoolError, match=r"cannot write.*Make room on the disk"):
            spool.append(number, payload(number))
    assert not list(tmp_path.glob("*.spool"))
    monkeypatch.setattr(os, "write", real)
    spool.append(5, payload(5))
    assert list(spool.read("b1")) == [payload(5)]
    spool.close()


def test_a_boot_dropped_whole_is_told_of_until_the_twin_has_heard(tmp_path):
    limits: dict[str, Any] = {"segment_bytes": 4096, "max_bytes": 65_536}
    fill(tmp_path, "b1", range(100), **limits).close()
    fill(tmp_path, "b2", range(2000), **limits).close()
    spool = Spool(tmp_path, "b3", **limits)
    gone, held = spool.held()
    assert gone == ("b1", 100, 99)
    assert (held.boot, held.last) == ("b2", 1999)
    assert spool.acknowledge("b1", 98) == 0
    assert spool.held() == (gone, held)
    spool.acknowledge("b1", 99)
    assert spool.held() == (held,)
    spool.close()
    (tmp_path / "dropped.json").write_text("[")
    spool = Spool(tmp_path, "b4", **limits)
    assert spool.held() == (held,)
    spool.close()


def test_with_the_strictest_policy_a_file_s_name_is_on_the_disk_with_its_first_record(
    tmp_path, monkeypatch
):
    synced: list[str] = []
    real = os.fsync

    def noted(file):
        synced.append(os.readlink(f"/proc/self/fd/{file}"))
        real(file)

    monkeypatch.setattr(os, "fsync", noted)
    spool = Spool(tmp_path, "b1", fsync="always")
    spool.append(0, payload(0))
    assert synced == [str(tmp_path), str(next(tmp_path.glob("*.spool")))]
    spool.close()


def test_boots_are_in_the_order_they_ran_in_whatever_the_clock_says(tmp_path):
    for boot in ("2026", "1970", "2025"):
        fill(tmp_path, boot, range(2)).close()
    before = tmp_path / "1999.00000000000000000000.spool"
    (path,) = tmp_path.glob("*.2026.*")
    before.write_bytes(path.read_bytes())
    spool = Spool(tmp_path, "2027")
    assert [held.boot for held in spool.held()] == ["1999", "2026", "1970", "2025"]
    spool.close()


@pytest.mark.skipif(os.name == "nt", reason="open files cannot be moved there")
@pytest.mark.parametrize("harm", ["deleted", "moved", "folder deleted", "replaced"])
def test_a_current_segment_that_is_taken_away_is_written_again_with_all_that_was_in_it(
    tmp_path, caplog, harm
):
    folder = tmp_path / "spool"
    spool = fill(folder, "b1", range(30))
    (segment,) = folder.glob("*.spool")
    if harm == "moved":
        segment.rename(tmp_path / "elsewhere")
    elif harm == "folder deleted":
        shutil.rmtree(folder)
    else:
        segment.unlink()
        if harm == "replaced":
            segment.write_bytes(b"of somebody else")
    spool.append(30, payload(30))
    assert "It is written again" in caplog.text
    assert list(spool.read("b1")) == [payload(n) for n in range(31)]
    with pytest.raises(SpoolError, match="in use by another edge agent"):
        Spool(folder, "b2")
    spool.close()
    again = Spool(folder, "b2")
    assert list(again.read("b1")) == [payload(n) for n in range(31)]


@pytest.mark.parametrize("harm", ["deleted", "a folder"])
def test_of_a_full_segment_that_is_taken_away_the_features_are_said_to_be_damaged(
    tmp_path, harm
):
    spool = fill(tmp_path, "b1", range(500), segment_bytes=4096)
    first, second, *_ = sorted(tmp_path.glob("*.spool"))
    first.unlink()
    if harm == "a folder":
        first.mkdir()
    missing = int(second.name.split(".")[2])
    assert list(spool.read("b1")) == [payload(n) for n in range(missing, 500)]
    assert spool.damaged_ranges("b1") == [(0, missing - 1)]
    assert spool.damaged == missing


@pytest.mark.skipif(os.name == "nt", reason="open files cannot be moved there")
def test_a_segment_whose_folder_became_a_file_is_read_and_written_again(tmp_path):
    folder = tmp_path / "spool"
    spool = fill(folder, "b1", range(30))
    folder.rename(tmp_path / "elsewhere")
    folder.write_bytes(b"of somebody else")
    assert list(spool.read("b1")) == [payload(n) for n in range(30)]
    assert spool.damaged == 0
    with pytest.raises(SpoolError, match="cannot write"):
        spool.append(30, payload(30))
    folder.unlink()
    spool.append(30, payload(30))
    assert list(spool.read("b1")) == [payload(n) for n in range(31)]


def test_what_can_be_read_after_all_is_not_said_to_be_damaged(tmp_path):
    spool = fill(tmp_path, "b1", range(500), segment_bytes=4096)
    first, second, *_ = sorted(tmp_path.glob("*.spool"))
    kept, missing = first.read_bytes(), int(second.name.split(".")[2])
    first.unlink()
    list(spool.read("b1"))
    assert spool.damaged_ranges("b1") == [(0, missing - 1)]
    altered = bytearray(kept)
    altered[positions(range(missing))[3][0] + 20] ^= 1
    first.write_bytes(altered)
    list(spool.read("b1"))
    assert spool.damaged_ranges("b1") == [(3, 3)]
    first.write_bytes(kept)
    assert list(spool.read("b1")) == [payload(n) for n in range(500)]
    assert spool.damaged_ranges("b1") == []


def test_acknowledged_features_stay_for_a_recorder_that_asks_late(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    kept = Spool(tmp_path, "b1", segment_bytes=300, keep_acknowledged_s=60.0)
    with contextlib.closing(kept):
        for sequence in range(6):
            kept.append(sequence, b"x" * 100)
        assert kept.acknowledge("b1", 5) == 0
        assert len(list(kept.read("b1"))) == 6
        kept.append(6, b"x" * 100)  # its segment holds something new
        now[0] += 60.0
        kept.acknowledge("b1", 5)
        assert 6 <= kept.held()[0].last
        assert len(list(kept.read("b1"))) < 6
        kept.acknowledge("b1", 6)
        now[0] += 60.0
        kept.acknowledge("b1", 6)
        assert list(kept.read("b1")) == []


def test_a_full_spool_gives_up_acknowledged_features_first_and_counts_none(tmp_path):
    kept = Spool(tmp_path, "b1", segment_bytes=300, max_bytes=2_000, keep_acknowledged_s=60.0)
    with contextlib.closing(kept):
        for sequence in range(40):
            kept.append(sequence, b"x" * 100)
            kept.acknowledge("b1", sequence)
        assert kept.size <= 2_000
        assert kept.dropped == 0
