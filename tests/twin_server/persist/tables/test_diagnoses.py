"""Diagnoses and what they found are kept beside the history."""

from twin_server.persist import DiagnosisRow, TwinRow, WriteBatch

TWIN = TwinRow("lab", "beam", "{}", "{}")


def asked(twin="lab.beam"):
    return DiagnosisRow(0, twin, 5, None, "queued", '{"clock":"fast"}')


def test_what_was_found_is_read_back_as_it_was(store):
    number = store.add_diagnosis(asked(), 10)
    (row,) = store.diagnoses("lab.beam")
    assert row == asked()._replace(number=number)
    assert store.diagnosis_page(number) is None
    assert store.diagnosis_model(number) is None
    done = row._replace(ended_ns=9, state="done", report='{"verdict":"undecided"}')
    store.end_diagnosis(done, b"<p>" * 1000, "slowtime_model: 1\n")
    assert store.diagnoses(number=number) == [done]
    assert store.diagnosis_page(number) == b"<p>" * 1000
    assert store.diagnosis_model(number) == "slowtime_model: 1\n"


def test_only_the_last_of_a_twin_are_kept_and_numbers_are_never_used_again(store):
    numbers = [store.add_diagnosis(asked(), 3) for _ in range(5)]
    other = store.add_diagnosis(asked("lab.wing"), 3)
    assert [row.number for row in store.diagnoses("lab.beam")] == numbers[-3:]
    store.write(WriteBatch(twins=[TWIN]))
    assert store.delete("lab.beam")
    assert [row.number for row in store.diagnoses()] == [other]
    assert store.add_diagnosis(asked(), 3) > other
