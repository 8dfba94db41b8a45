"""A person's edits of the automatic choice of modes, on a simulated structure."""

import functools

import numpy as np
import pytest

from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.methods import by_method
from slowtime.identification.modal_fit.by_hand import edited_test
from slowtime.identification.modal_fit.identification import identify_responses
from slowtime.identification.options import Edit, Selection
from tests.slowtime.identification.modal_fit.structures import frame, response_to
from tests.slowtime.identification.modal_fit.test_identification import responses

FRAME = frame(3)
RATE = 32.0


@functools.cache
def record():
    rng = np.random.default_rng(5)
    force = rng.standard_normal((round(100 * RATE), 2))
    y = response_to(FRAME, force, RATE)
    return y + 0.02 * y.std() * rng.standard_normal(y.shape)


@functools.cache
def found(*edits, automatic=True):
    chosen = Selection(edits=edits, automatic=automatic)
    return identify_modes(record(), RATE, selection=chosen)


def told(modes):
    return [(mode.frequency_hz, mode.damping_ratio, mode.flags) for mode in modes]


def test_no_edit_is_the_automatic_choice():
    plain = identify_modes(record(), RATE)
    assert told(found().modes) == told(plain.modes)
    assert found().notes == ()
    assert len(plain.modes) == 3


def test_a_dropped_mode_is_gone_and_the_others_stay_as_they_are():
    first, second, third = found().modes
    dropped = found(Edit(action="drop", at_hz=(round(second.frequency_hz.value, 2),)))
    assert told(dropped.modes) == told([first, third])
    assert dropped.notes == (
        "Modes chosen by hand, from the automatic choice: drop "
        f"{round(second.frequency_hz.value, 2):.5g} Hz.",
    )
    of_mode = dropped.stabilisation.frequency_hz[dropped.stabilisation.mode == 1]
    assert np.median(of_mode) == pytest.approx(third.frequency_hz.value, rel=0.01)


def test_only_what_is_kept_is_reported_without_the_automatic_choice():
    second = found().modes[1]
    keep = Edit(action="keep", at_hz=(second.frequency_hz.value,))
    assert told(found(keep, automatic=False).modes) == told([second])


def test_a_pole_of_the_diagram_can_be_kept():
    diagram = found().stabilisation
    spare = (diagram.mode < 0) & (diagram.damping_ratio > 0.01) & (diagram.order == 20)
    spare &= np.isfinite(diagram.frequency_sd_hz)
    away = [np.abs(diagram.frequency_hz / m.frequency_hz.value - 1) for m in found().modes]
    spare &= np.min(away, axis=0) > 0.03
    at = float(diagram.frequency_hz[np.flatnonzero(spare)[0]])
    kept = found(Edit(action="keep", at_hz=(at,), order=20))
    (mode,) = [mode for mode in kept.modes if mode.flags]
    assert mode.flags == ("kept_by_hand",)
    assert mode.frequency_hz.value == pytest.approx(at, rel=0.2)
    assert all(
        np.isfinite(v) for v in (mode.frequency_hz.sd, mode.damping_ratio.sd, mode.correlation)
    )
    assert np.isfinite(mode.shape_sd).all()


def test_modes_that_are_merged_become_one_between_them():
    low, high = (mode.frequency_hz.value for mode in found().modes[1:])
    merged = found(Edit(action="merge", at_hz=(low, high)))
    assert [mode.flags for mode in merged.modes] == [(), ("merged_by_hand",)]
    assert low < merged.modes[1].frequency_hz.value < high


def test_a_mode_can_be_split():
    first = found().modes[0].frequency_hz.value
    split = found(Edit(action="split", at_hz=(first,), into_hz=(first, first)))
    parts = [mode for mode in split.modes if mode.flags == ("split_by_hand",)]
    assert len(parts) == 2
    assert len(split.modes) == 4


def test_bayes_takes_edits_too_and_other_methods_say_that_they_do_not():
    first = found().modes[0].frequency_hz.value
    drop = Selection(edits=(Edit(action="drop", at_hz=(first,)),))
    assert len(by_method(record(), RATE, method="bayes", selection=drop).modes) == 2
    with pytest.raises(ValueError, match="efdd has no poles to choose from"):
        by_method(record(), RATE, method="efdd", selection=drop)


def test_edits_that_mean_nothing_are_refused_with_what_there_is():
    with pytest.raises(ValueError, match=r"drop 1.1 Hz: there is no mode within 1 %.*Modes"):
        found(Edit(action="drop", at_hz=(1.1,)))
    with pytest.raises(ValueError, match=r"no pole of order 77 within 1 % of 1.1 Hz"):
        found(Edit(action="keep", at_hz=(1.1,), order=77))
    first = found().modes[0].frequency_hz.value
    drop, keep = (Edit(action=name, at_hz=(first,)) for name in ("drop", "keep"))
    with pytest.raises(ValueError, match="name the same mode"):
        found(drop, keep)
    with pytest.raises(ValueError, match="names a single mode"):
        found(Edit(action="merge", at_hz=(first, first)))


def test_modal_tests_are_edited_alike():
    test = identify_responses(responses(1, 0.02), band_hz=(1.0, 15.0))
    hz = [mode.frequency_hz.value for mode in test.result.modes]
    assert len(hz) == 3
    drop = Selection(edits=(Edit(action="drop", at_hz=(hz[1],)),))
    dropped = edited_test(test, drop)
    assert [m.frequency_hz.value for m in dropped.result.modes] == [hz[0], hz[2]]
    assert len(dropped.constants) == 2
    assert np.all(dropped.fitted == test.fitted)
    keep = Selection(edits=(Edit(action="keep", at_hz=(hz[2],)),), automatic=False)
    kept = edited_test(test, keep)
    assert [m.frequency_hz.value for m in kept.result.modes] == [hz[2]]
    assert kept.constants[0].participation.shape == test.constants[2].participation.shape
    merge = Selection(edits=(Edit(action="merge", at_hz=(hz[1], hz[2])),))
    with pytest.raises(ValueError, match="the responses have no mode there"):
        edited_test(test, merge)
