"""Windows of long records, and what whole records say of what was found in them."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.record_windows import (
    RECORD_SAMPLES,
    WINDOW_SAMPLES,
    record_windows,
    with_whole_records,
)
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.search import SearchSettings, search
from slowtime.dynamics.effects import Effect, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, FIRST, KINDS, TWO, records_of

LONG = 20_000


def outputs(trials):
    return sum(len(trial.outputs) for trial in trials)


def test_short_records_are_searched_as_they_are():
    trials = records_of((), samples=4000)
    assert list(record_windows(trials, TWO)) == [trials]


def test_windows_of_long_records_grow_to_the_records_themselves():
    trials = records_of((), count=3, samples=LONG)
    windows = list(record_windows(trials, TWO))
    sizes = [outputs(one) for one in windows]
    assert sizes[0] <= WINDOW_SAMPLES
    assert sizes == sorted(sizes)
    assert windows[-1] is trials


def test_a_window_is_where_a_record_moves_most():
    (trial,) = records_of((), count=1, samples=LONG)
    quiet = np.where(np.arange(LONG) < 9000, 0.01, 1.0)[:, None]
    loud = dataclasses.replace(trial, outputs=trial.outputs * quiet)
    (window,) = next(record_windows((loud,), TWO))
    assert len(window.outputs) == RECORD_SAMPLES
    assert window.start_s >= 9000 / trial.rate_hz
    assert next(record_windows((trial,), TWO))[0].start_s == trial.start_s


def found_in_windows(trials):
    windows = next(record_windows(trials, TWO))
    first = refit(Plant.of(TWO, kinds=KINDS), windows)
    return search(first, windows, SearchSettings(KINDS, Monitor()))


@pytest.mark.long
def test_a_law_found_in_windows_is_fitted_to_whole_records():
    trials = records_of((CUBIC,), count=1, samples=LONG)
    found = found_in_windows(trials)
    whole = with_whole_records(found, trials, KINDS)
    assert whole is not None
    assert [len(one) for one in whole.last.residual] == [LONG]
    told, before = (one.effects[0].numbers["k3_n_per_m3"] for one in (whole, found))
    assert told.sd < 0.7 * before.sd
    assert abs(told.value - CUBIC.parameters["k3_n_per_m3"]) < 4 * told.sd


@pytest.mark.long
def test_what_begins_after_the_windows_is_found_in_whole_records():
    kinds = {"stiffness_jump": catalogue()["stiffness_jump"]}
    late = Effect("stiffness_jump", FIRST, {"dk_n_per_m": 90.0, "t_jump_s": 150.0})
    trials = records_of((late,), count=1, samples=13_000)
    windows = next(record_windows(trials, TWO))
    first = refit(Plant.of(TWO, kinds=kinds), windows)
    nothing = search(first, windows, SearchSettings(kinds, Monitor()))
    assert not nothing.effects
    assert with_whole_records(nothing, trials, kinds) is None
    answer = diagnose(Campaign(description=TWO, trials=trials), kinds=kinds)
    assert [one.effect.kind for one in answer.effects] == ["stiffness_jump"]
    assert answer.effects[0].numbers["t_jump_s"].value == pytest.approx(150.0, abs=0.1)
