"""Diagnoses and what they found are kept beside the history."""

from twin_server.persist import DiagnosisRow, EventRow, TwinRow, WriteBatch
from twin_server.persist.tables.checksums import DIAGNOSES, EVENTS
from twin_server.persist.tables.statements import note_number

TWIN = TwinRow("lab", "beam", "{}", "{}")


def asked(twin="lab.beam"):
    return DiagnosisRow(0, twin, 5, None, "queued", '{"clock":"fast"}')


def test_what_was_found_is_read_back_as_it_was(store):
    number = store.add_diagnosis(asked(), 10)
    (row,) = store.diagnoses("lab.beam")
    assert row == asked()._replace(number=number)
    assert store.diagnosis_page("lab.beam", number) is None
    assert store.diagnosis_model("lab.beam", number) is None
    done = row._replace(ended_ns=9, state="done", report='{"verdict":"undecided"}')
    store.end_diagnosis(done, b"<p>" * 1000, "slowtime_model: 1\n")
    assert store.diagnoses("lab.beam", number) == [done]
    assert store.diagnosis_page("lab.beam", number) == b"<p>" * 1000
    assert store.diagnosis_model("lab.beam", number) == "slowtime_model: 1\n"


def test_only_the_last_of_a_twin_are_kept_and_numbers_are_never_used_again(store):
    numbers = [store.add_diagnosis(asked(), 3) for _ in range(5)]
    other = store.add_diagnosis(asked("lab.wing"), 3)
    assert (numbers, other) == ([1, 2, 3, 4, 5], 1)
    assert [row.number for row in store.diagnoses("lab.beam")] == numbers[-3:]
    store.write(WriteBatch(twins=[TWIN]))
    assert store.delete("lab.beam")
    assert [row.number for row in store.diagnoses()] == [other]
    assert store.add_diagnosis(asked(), 3) == 6


def test_what_was_numbered_over_all_twins_keeps_its_number_and_counts_go_on(store):
    with store._writing() as writer:
        for key, twin in ((3, "lab.beam"), (4, "lab.wing")):
            row = DIAGNOSES.sealed((key, *asked(twin)[1:], None, None))
            marks = ",".join("?" * len(row))
            writer.execute(f"insert into diagnoses values ({marks})", row)
            event = EVENTS.sealed((key, twin, *twin.split("."), 5, None, 0, f"{key}"))
            writer.execute(f"insert into events values ({','.join('?' * len(event))})", event)
        for what in ("event", "diagnosis"):
            note_number(writer, what, 4)
    assert [store.add_diagnosis(asked(), 9) for _ in range(2)] == [5, 6]
    done = store.diagnoses("lab.beam", 3)[0]._replace(state="done")
    store.end_diagnosis(done, b"<p>", "model")
    assert store.diagnosis_page("lab.beam", 3) == b"<p>"
    assert [row.number for row in store.diagnoses("lab.beam")] == [3, 5, 6]
    assert store.diagnoses("lab.wing", 3) == []
    events = [EventRow(0, "lab", asset, 9, None, False, "{}") for asset in ("beam", "new")]
    assert store.write(WriteBatch(events=events)) == [5, 1]
    for after, numbers in ((0, [3, 5]), (2, [3, 5]), (3, [5]), (4, [5]), (5, []), (2**62, [])):
        assert [e.number for e in store.events("lab.beam", after=after)] == numbers
    assert [e.number for e in store.events("lab.beam", limit=1, newest=True)] == [5]
