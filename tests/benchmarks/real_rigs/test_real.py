"""Diagnoses of measured rigs whose answers are known, as `make real` runs them."""

import pytest

from benchmarks.real_rigs.running import SLOWTIME, prepare, run
from benchmarks.real_rigs.scores import outcome_of
from benchmarks.real_rigs.sets import chosen

RIGHT = ("as known", "as known, and more", "undecided, the known answer among what may be")


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "at_most"),
    [
        # The noise alone is 2.5 %; amplitudes are too small to tell the sine from a cubic.
        pytest.param("swing", 0.04, marks=pytest.mark.long),
        # A published Bouc-Wen law, whose numbers leave 0.03 %.
        pytest.param("loop", 0.002, marks=pytest.mark.slow),
    ],
)
def test_the_known_answer_is_found_and_foretells_what_was_held_out(
    name, at_most, data, tmp_path
):
    (one,) = chosen((name,))
    try:
        folder = prepare(one, data, tmp_path)
    except OSError as error:
        pytest.skip(f"{error.filename} is not there; set SLOWTIME_DATA to where it is")
    told = run(SLOWTIME, folder)
    assert told["exit"] == 0, told["last_words"]
    outcome = outcome_of(one, folder)
    assert outcome is not None
    assert outcome.verdict in RIGHT, outcome.sentence
    found, refitted = outcome.row("slowtime"), outcome.row("model refitted")
    assert found is not None
    assert found.error is not None
    assert refitted is not None
    assert refitted.error is not None
    assert found.error <= at_most < refitted.error
