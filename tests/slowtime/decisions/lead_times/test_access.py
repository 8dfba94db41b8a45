import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slowtime.decisions import Access

TIME = np.linspace(0.0, 10.0, 101)
DENSE = np.linspace(0.0, 10.0, 10_001)


def is_open(access, at):
    windows = access.windows or ((0.0, np.inf),)
    return any(begin - 1e-9 <= at <= end + 1e-9 for begin, end in windows)


@st.composite
def accesses(draw):
    lead = draw(st.floats(0.0, 4.0))
    ends = sorted(draw(st.lists(st.integers(0, 120), min_size=2, max_size=8, unique=True)))
    pairs = zip(ends[0::2], ends[1::2], strict=False)
    windows = tuple((begin / 10, end / 10) for begin, end in pairs)
    return {"lead": lead, "windows": windows if draw(st.booleans()) else None}


@settings(max_examples=60, deadline=None)
@given(accesses(), st.floats(0.0, 9.0))
def test_an_order_takes_effect_at_the_first_open_time_after_its_lead_time(given_access, order):
    access = Access(**given_access)
    later = [at for at in DENSE if at >= order + access.lead and is_open(access, at)]
    effect = access.effect(order)
    assert effect >= order + access.lead
    if later:
        assert later[0] - 0.0011 <= effect <= later[0] + 1e-9
        assert is_open(access, effect)
    else:
        assert effect > 10.0 - 0.0011


@settings(max_examples=60, deadline=None)
@given(accesses())
def test_on_a_grid_an_effect_is_never_early_and_at_most_a_step_late(given_access):
    access = Access(**given_access)
    index = access.effect_index(TIME)
    for k in range(0, len(TIME), 7):
        effect = access.effect(float(TIME[k]))
        if index[k] < len(TIME):
            assert effect <= TIME[index[k]] + 1e-9 < effect + TIME[1] + 1e-8
        else:
            assert effect > TIME[-1]
    assert index[-1] == len(TIME)


@settings(max_examples=60, deadline=None)
@given(accesses())
def test_planned_effects_lie_in_windows_and_after_the_lead_time(given_access):
    access = Access(**given_access)
    at = access.effect_times(TIME)
    for k in np.flatnonzero(np.isfinite(at)):
        assert is_open(access, at[k])
        assert at[k] >= access.lead - 1e-9
        assert TIME[k] - TIME[1] - 1e-8 <= at[k] <= TIME[k]
    planned = access.planned_index(TIME)
    assert np.all(np.diff(planned) >= 0)
    assert np.all(planned >= np.arange(len(TIME) + 1))


def test_later_cycles_wait_for_a_window_on_average():
    season = Access(lead=0.25, windows=tuple((float(year), year + 0.5) for year in range(11)))
    later = season.on_average(10.0)
    assert later.windows is None
    # Half of the time nothing is waited for, else a quarter of a year on average.
    assert later.lead == pytest.approx(0.25 + 0.125, abs=0.005)


@pytest.mark.parametrize(
    ("access", "text"),
    [
        ({"lead": -1.0}, "A lead time of -1"),
        ({"windows": ((2.0, 1.0),)}, "in order"),
        ({"windows": ()}, "at least one"),
    ],
)
def test_access_that_cannot_be_is_refused(access, text):
    with pytest.raises(ValueError, match=text):
        Access(**access)
