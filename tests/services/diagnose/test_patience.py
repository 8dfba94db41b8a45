"""When a diagnosis is told that it is late, and when that it is over."""

import types

import pytest

from slowtime.dynamics.builders import chain
from slowtime_services.diagnose import run


class Heard(Exception):
    """What the search was told is known; the rest of it is not run."""


@pytest.mark.parametrize(
    ("given_s", "masses", "patience_s"),
    [
        (10.0, 1, 10.0),
        (10.0, 5, 10.0),
        (None, 1, run.PATIENCE_S),
        (None, 5, run.PATIENCE_S * 5 / 3),
    ],
)
@pytest.mark.parametrize("compiling_s", [0.0, 100.0])
def test_it_is_late_before_it_is_over_by_the_time_of_its_own_thread(
    monkeypatch, given_s, masses, patience_s, compiling_s
):
    spent, compiled, told = [5.0], [3.0], {}

    def heard(_, **how):
        told.update(how)
        raise Heard

    clock = types.SimpleNamespace(monotonic=lambda: 0.0, thread_time=lambda: spent[0])
    monkeypatch.setattr(run, "time", clock)
    monkeypatch.setattr(run, "compiling_s", lambda: compiled[0])
    monkeypatch.setattr(run, "gather", lambda *_: types.SimpleNamespace(campaign=None))
    monkeypatch.setattr(run, "diagnose", heard)
    rig = chain([1.0] * masses, [1.0] * masses)
    with pytest.raises(Heard):
        run.diagnose_records(rig, [], patience_s=given_s, unchecked=True)
    for share, late, over in (
        (0.0, False, False),
        (0.69, False, False),
        (0.71, True, False),
        (0.99, True, False),
        (1.01, True, True),
    ):
        spent[0] = 5.0 + share * patience_s + compiling_s
        compiled[0] = 3.0 + compiling_s
        assert (told["late"](), told["over"]()) == (late, over)


@pytest.mark.parametrize(("masses", "times"), [(1, 1), (3, 1), (4, 4 / 3), (5, 5 / 3), (30, 2)])
def test_more_masses_have_more_time_up_to_twice(masses, times):
    rig = chain([1.0] * masses, [1.0] * masses)
    assert run.patience_for(rig) == pytest.approx(times * run.PATIENCE_S)
