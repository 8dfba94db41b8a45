"""A fit that was begun ahead is taken only where it is the one that is wanted."""

import dataclasses
from typing import Any

from slowtime.discrepancy.calibration.levenberg_marquardt import Comparison
from slowtime.discrepancy.estimation.fits_ahead import Attempt, FitsAhead
from slowtime.discrepancy.workers import Pending, Workers
from slowtime.dynamics.work import count_work, metered


@dataclasses.dataclass
class Done(Pending[Any]):
    """A result that is there at once."""

    found: object
    dropped: bool = False

    def result(self):
        return self.found

    def drop(self):
        self.dropped = True


class Beside(Workers):
    """Workers that compute in this process, at once."""

    count = 2

    def __init__(self):
        self.begun = []

    def map(self, function, items, shared):
        return [function(item) for item in items]

    def begin(self, function, shared):
        self.begun.append(Done(function()))
        return self.begun[-1]


def fit():
    count_work(100)
    return Attempt("fit", (Comparison(10.0, 2.0, (1, 4)),))


def taken(begun_with, cost_to_beat, *, late=False):
    ahead: FitsAhead[str] = FitsAhead(Beside(), ())
    with metered() as meter:
        ahead.begin(0, begun_with, fit)
        assert meter.spent == 0
        found = ahead.take(0, cost_to_beat, lambda: late)
    return found, meter.spent


def test_it_is_taken_with_its_work_where_comparisons_come_out_the_same():
    # 10 is compared with twice a quarter of the cost: beaten below 20.
    for begun_with, cost_to_beat in ((None, None), (None, 21.0), (50.0, 20.0), (15.0, 12.0)):
        found, work = taken(begun_with, cost_to_beat)
        assert found is not None, (begun_with, cost_to_beat)
        assert work == 100


def test_it_is_not_taken_where_one_would_come_out_otherwise():
    for begun_with, cost_to_beat in ((None, 19.0), (21.0, 19.0), (19.0, None)):
        assert taken(begun_with, cost_to_beat) == (None, 0)


def test_it_is_not_taken_where_the_budget_may_have_ended_within():
    assert taken(None, None, late=True) == (None, 0)


def test_what_was_not_begun_or_was_lost_is_not_taken():
    nobody: FitsAhead[str] = FitsAhead(None, ())
    assert nobody.take(0, None, bool) is None
    ahead: FitsAhead[str] = FitsAhead(Beside(), ())
    ahead._begun[0] = Done(None), None
    assert ahead.take(0, None, bool) is None


def test_fits_that_were_not_taken_are_ended():
    workers = Beside()
    ahead: FitsAhead[str] = FitsAhead(workers, ())
    ahead.begin(0, None, fit)
    ahead.begin(0, None, fit)
    ahead.drop()
    assert [one.dropped for one in workers.begun] == [True]
