"""The spool as a state machine: kills, full disks, damage, limits and acknowledgements.

The model knows which features must still be readable. Whatever happens, each of them is read
as it was given; what is gone is told by the account; and no operation takes more steps than
the segments and bytes that it is about.
"""

import contextlib
import errno
import json
import os
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

import edge_agent.publish
from edge_agent.publish import (
    Spool,
    SpoolError,
    damaged_bytes,
    segment_files,
    spool,
    spool_records,
)
from tests.state_machines import assert_found, run_long, run_share, steps_in

FOLDER = Path(edge_agent.publish.__file__).parent
SEGMENT_BYTES, MOST_BYTES = 300, 1_200
HOW = ("flip", "zero", "noise")
STEPS = 300
"""Lines of an operation that are not of its segments."""
STEPS_PER_SEGMENT = 40
STEPS_PER_BYTE = 12
"""A scan behind damage looks at each place at which three zero bytes stand."""


def payload_of(boot, sequence, size):
    return json.dumps({"boot": boot, "sequence": sequence, "pad": "x" * size}).encode()


class SpoolMachine(RuleBasedStateMachine):
    """One spool folder, used by one process after the other."""

    def __init__(self):
        super().__init__()
        damaged_bytes.logger.disabled = spool.logger.disabled = True
        self.folder = Path(tempfile.mkdtemp(prefix="spool-model-"))
        self.boots = 0
        self.given = {}  # (boot, sequence) to payload, of all that was taken
        self.refused = {}  # the same, of what the disk refused: it may have it all the same
        self.must = {}  # those that must be readable, in the order they were given
        self.acknowledged = {}
        self.withheld = set()
        self.torn = set()  # boots whose last record may have gone: how many is only estimated
        self.open()

    def teardown(self):
        self.spool.close()
        shutil.rmtree(self.folder, ignore_errors=True)
        damaged_bytes.logger.disabled = spool.logger.disabled = False

    def open(self):
        self.boots += 1
        size = sum(path.stat().st_size for path in self.folder.glob("*.spool"))
        with self.bounded(STEPS_PER_BYTE * size):
            self.spool = Spool(
                self.folder, f"b{self.boots}", max_bytes=MOST_BYTES,
                segment_bytes=SEGMENT_BYTES, fsync="never",
            )  # fmt: skip
        self.next = 0

    def bounded(self, more=0):
        segments = len(list(self.folder.glob("*.spool")))
        most = STEPS + STEPS_PER_SEGMENT * segments + more
        return _Bounded(most)

    @rule(size=st.integers(0, 300), skipped=st.integers(0, 2))
    def append(self, size, skipped):
        sequence = self.next + skipped
        payload = payload_of(self.spool.boot, sequence, size)
        with self.bounded():
            self.spool.append(sequence, payload)
        self.next = sequence + 1
        self.given[self.spool.boot, sequence] = payload
        self.must[self.spool.boot, sequence] = payload
        self.forget_dropped()

    @rule(size=st.integers(0, 300), written=st.integers(0, 200), cut=st.booleans())
    def append_to_a_full_disk(self, size, written, cut):
        """The disk takes a part of the record; sometimes even cutting it back fails."""
        sequence, mended = self.next, pytest.MonkeyPatch()
        payload = payload_of(self.spool.boot, sequence, size)

        def full(file, data):
            os.write(file, bytes(data[:written]))
            raise OSError(errno.ENOSPC, "No space left on device")

        def refuses(file, size):
            raise OSError(errno.EIO, "Input/output error")

        mended.setattr(spool, "write_all", full)
        if not cut:
            mended.setattr(os, "ftruncate", refuses)
        try:
            with self.bounded(), pytest.raises(SpoolError, match="Make room on the disk"):
                self.spool.append(sequence, payload)
        finally:
            mended.undo()
        self.next = sequence + 1
        self.refused[self.spool.boot, sequence] = payload
        self.forget_dropped()

    @rule(back=st.integers(0, 5))
    def a_sequence_that_does_not_grow_is_refused(self, back):
        sequence = self.spool.last_sequence - back
        with self.bounded(), pytest.raises(ValueError, match="Sequences must grow"):
            self.spool.append(sequence, b"{}")

    @rule(data=st.data(), beyond=st.sampled_from([0, 0, 0, 1, 2**40, 2**62]))
    def acknowledge(self, data, beyond):
        boot = f"b{data.draw(st.integers(1, self.boots))}"
        known = [sequence for b, sequence in self.given if b == boot]
        sequence = data.draw(st.integers(-1, max(known, default=0))) + beyond
        before = {entry.boot for entry in self.spool.held()}
        with self.bounded():
            count = self.spool.acknowledge(boot, sequence)
        if boot in self.withheld:
            assert count == 0
            assert before == {entry.boot for entry in self.spool.held()}
            return
        self.acknowledged[boot] = max(self.acknowledged.get(boot, -1), sequence)
        for key in [k for k in self.must if k[0] == boot and k[1] <= sequence]:
            del self.must[key]

    @rule(data=st.data())
    def withhold(self, data):
        boot = f"b{data.draw(st.integers(1, self.boots))}"
        with self.bounded():
            assert self.spool.withhold(boot, 7) == (boot not in self.withheld)
        self.withheld.add(boot)
        assert self.spool.withholds(boot)

    @rule(orderly=st.booleans())
    def restart(self, orderly):
        if orderly:
            self.spool.close()
        else:  # killed: the system closes its files, nothing else is done
            segment_files.unlock(self.spool._guard)
            if self.spool._file is not None:
                os.close(self.spool._file)
            self.spool._guard = self.spool._file = None
        self.open()
        self.forget_dropped()

    @precondition(lambda self: self.must)
    @rule(data=st.data(), length=st.integers(1, 60), how=st.sampled_from(HOW))
    def damage(self, data, length, how):
        """Bytes of a segment that is not being written change on the disk."""
        path = self.quiet_segment(data)
        if path is None:
            return
        bytes_ = bytearray(path.read_bytes())
        at = data.draw(st.integers(0, max(0, len(bytes_) - 1)))
        for place in range(at, min(at + length, len(bytes_))):
            bytes_[place] = {"flip": bytes_[place] ^ 0x41, "zero": 0, "noise": 0x37}[how]
        self.touched(path, at, at + length)
        path.write_bytes(bytes_)

    @precondition(lambda self: self.must)
    @rule(data=st.data())
    def lose_the_end(self, data):
        """A power cut takes the end of a segment that was not on the disk yet."""
        path = self.quiet_segment(data)
        if path is None:
            return
        size = path.stat().st_size
        left = data.draw(st.integers(len(spool_records.MARK), max(size, 8)))
        self.touched(path, left, size)
        self.torn.add(spool._boot_of(path))
        os.truncate(path, min(left, size))

    def quiet_segment(self, data):
        written = self.spool._segments[-1].path if self.spool._file is not None else None
        quiet = sorted(p for p in self.folder.glob("*.spool") if p != written)
        return data.draw(st.sampled_from(quiet)) if quiet else None

    def touched(self, path, begin, end):
        """Features of which a record has a byte from `begin` to before `end` may be lost."""
        boot, content = spool._boot_of(path), path.read_bytes()
        for key in [k for k in self.must if k[0] == boot]:
            record = spool_records.pack(key[1], self.given[key])
            at = content.find(record)
            if at >= 0 and at < end and begin < at + len(record):
                del self.must[key]
        if begin < len(spool_records.MARK) or end >= len(content):
            self.torn.add(boot)

    def forget_dropped(self):
        """A spool beyond its limit has dropped the oldest segments, no more than it had to."""
        assert self.spool.size <= MOST_BYTES or len(self.spool._segments) == 1
        if not self.spool.dropped:
            return
        readable = self.readable()
        gone = [key for key in self.must if key not in readable]
        left = [key for key in self.must if key in readable]
        if gone and left:
            order = list(self.must)
            assert order.index(gone[-1]) < order.index(left[0])
        for key in gone:
            del self.must[key]
        if gone:
            assert self.spool.size > MOST_BYTES - SEGMENT_BYTES - 2 * 512

    def readable(self):
        found = {}
        for number in range(1, self.boots + 1):
            boot = f"b{number}"
            read = [json.loads(payload) for payload in self.spool.read(boot)]
            sequences = [one["sequence"] for one in read]
            assert sequences == sorted(set(sequences))
            for one in read:
                assert one["boot"] == boot
                found[boot, one["sequence"]] = one
        return found

    @invariant()
    def what_must_be_there_is_read_as_it_was_given(self):
        with self.bounded(STEPS_PER_BYTE * self.spool.size + 60 * self.boots):
            readable = self.readable()
        assert self.must.keys() <= readable.keys()
        for (boot, sequence), one in readable.items():
            given = (self.given | self.refused)[boot, sequence]
            assert payload_of(boot, sequence, len(one["pad"])) == given

    @invariant()
    def the_account_covers_it_and_tells_what_is_lost(self):
        held = {entry.boot: entry for entry in self.spool.held()}
        readable = self.readable()
        for boot, sequence in self.must:
            assert held[boot].first <= sequence <= held[boot].last
        lost = {
            (boot, sequence)
            for boot in held
            for first, last in self.spool.damaged_ranges(boot)
            for sequence in range(first, min(last, self.boots + 10_000) + 1)
        }
        assert not lost & readable.keys()
        for boot, sequence in self.given:
            inside = boot in held and held[boot].first <= sequence <= held[boot].last
            if inside and boot not in self.torn and (boot, sequence) not in readable:
                assert (boot, sequence) in lost


class _Bounded:
    """Asserts that what is done within takes no more lines than it may."""

    def __init__(self, most):
        self.most = most

    def __enter__(self):
        self.watch = steps_in(FOLDER)
        self.steps = self.watch.__enter__()

    def __exit__(self, kind, error, trace):
        self.watch.__exit__(kind, error, trace)
        if kind is None:
            assert self.steps.count <= self.most


@pytest.mark.gate
def test_whatever_happens_to_a_spool_no_unacknowledged_feature_is_lost():
    run_share(SpoolMachine)


@pytest.mark.long
def test_a_spool_holds_for_as_long_as_is_asked():
    assert run_long(SpoolMachine) > 0


def test_a_spool_beyond_its_limit_drops_its_oldest_though_the_disk_takes_nothing(
    tmp_path, monkeypatch
):
    """Found by the machine: torn records had filled it, and nothing made room."""
    with contextlib.closing(Spool(tmp_path, "b1", max_bytes=9_000, segment_bytes=300)) as one:
        for sequence in range(20):
            one.append(sequence, payload_of("b1", sequence, 200))

    def full(file, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    with contextlib.closing(Spool(tmp_path, "b2", max_bytes=2_000)) as one:
        one.append(0, b"{}")
        assert one.size <= 2_000
    with contextlib.closing(Spool(tmp_path, "b3", max_bytes=1_000)) as one:
        begin = one._begin

        def begins_and_is_full(path):
            file = begin(path)
            monkeypatch.setattr(spool, "write_all", full)
            return file

        monkeypatch.setattr(one, "_begin", begins_and_is_full)
        with pytest.raises(SpoolError):
            one.append(0, b"{}")
        assert one.size <= 1_000


def _delete_what_has_begun(self, boot, sequence):
    for segment in [s for s in self._segments if s.boot == boot and s.first <= sequence]:
        self._remove(segment)
    return 0


def _drop_the_newest(self):
    while self.size > self._max_bytes and len(self._segments) > 1:
        self._dropped += 1
        self._remove(self._segments[-2])


@pytest.mark.gate
@pytest.mark.parametrize(
    ("where", "name", "fault"),
    [
        (Spool, "acknowledge", _delete_what_has_begun),
        (Spool, "_drop_oldest", _drop_the_newest),
        (Spool, "_cut_back", lambda self, segment: None),
        (spool_records, "_next_sound", lambda data, at, due: None),
    ],
)
def test_the_machine_finds_a_planted_fault(monkeypatch, where, name, fault):
    monkeypatch.setattr(where, name, fault)
    assert_found(SpoolMachine)
