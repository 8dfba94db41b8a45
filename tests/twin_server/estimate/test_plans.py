"""The sentence of a plan says when the repair falls due, or that it probably does not."""

import dataclasses
import datetime
from typing import Any

import numpy as np
import pytest

from slowtime.decisions import Access, Cost, Costs, Plan, Terms, from_paths, make_plan
from twin_server.estimate.plans.plan import NotPlannableError, PlanOrder, access_of
from twin_server.estimate.plans.wording import TimeWording, last_order_sentence, sentence_of
from twin_server.registration.costs import CostTable, Deciding, months_of

TIME = np.linspace(0.0, 10.0, 121)
WHEN = TimeWording("year", None, None)


def plan(name: str, due: float, share: float) -> Plan:
    """Plan whose best option repairs at `due` in a share of the futures, else never."""
    rng = np.random.default_rng(1)
    grown = 0.3 + np.cumsum(0.002 * rng.random((200, len(TIME))), axis=1)
    costs = Costs(failure=Cost(20.0), repair=Cost(2.0), inspection=Cost(0.05))
    made = make_plan(from_paths(TIME, grown), costs, Terms())
    (at,) = (i for i, option in enumerate(made.options) if option.name == name)
    times = np.where(np.arange(200) < share * 200, due, np.inf)
    options = tuple(
        dataclasses.replace(option, repair_time=rng.permutation(times)) if i == at else option
        for i, option in enumerate(made.options)
    )
    ranking = dataclasses.replace(made.ranking, best=at, other=None)
    return dataclasses.replace(made, options=options, ranking=ranking)


@pytest.mark.parametrize(
    ("share", "says"),
    [
        (1.0, ", expected in 4 years:"),
        (0.6, ", expected in 4 years:"),
        (0.4, ", probably not within the horizon:"),
        (0.0, ", probably not within the horizon:"),
    ],
)
def test_a_repair_that_readings_decide_is_expected_at_its_median(share, says):
    told = sentence_of(plan("estimate_threshold", 4.0, share), "EUR", WHEN)
    assert told.startswith("Repair once the estimate reaches ")
    assert f" of failure{says} expected cost " in told


def test_a_repair_whose_time_is_the_decision_is_not_expected_besides():
    told = sentence_of(plan("repair_at", 4.0, 1.0), "EUR", WHEN)
    assert told.startswith("Repair in ")
    assert told.partition(":")[0].count(" in ") == 1
    assert "probably not" not in told


@pytest.mark.parametrize(
    ("unit", "slow_unit", "says"),
    [
        ("slow_time", "T0", "12.5 natural periods"),
        ("slow_time", "d", "12.5 days"),
        ("slow_time", None, "12.5 units of slow time"),
        ("year", "T0", "12.5 years"),
    ],
)
def test_a_time_of_a_plan_has_its_unit(unit, slow_unit, says):
    assert TimeWording(unit, None, None, slow_unit).span(12.5) == says


class Now:
    """A forecast of which only the slow time of the last reading is asked."""

    now = 100.0


def order_of(decision, *, since="2026-08-20T00:00:00+00:00", pace=86400.0):
    """Input of a plan in days, with one slow time a day."""
    given = {"failure": {"quantity": "stiffness_change", "below": -0.3}, "horizon": 800.0}
    moment = datetime.datetime.fromisoformat(since).timestamp()
    costs = CostTable(time_unit="d", failure=9.0, repair=1.0)
    laws: Any = Now()
    return PlanOrder(
        costs, Deciding.model_validate(given | decision), laws, 0.0, 0.01, 1.0, pace, 50.0,
        since_ns=None if pace is None else int(moment * 1e9),
    )  # fmt: skip


def test_months_are_windows_from_the_last_reading_on():
    access = access_of(order_of({"lead_time": 30.0, "access": {"months": [7, 8, 12]}}), 1.0)
    assert access.lead == 30.0
    begun = datetime.datetime(2026, 8, 20, tzinfo=datetime.UTC)
    assert access.windows is not None
    spans = [
        [(begun + datetime.timedelta(days=end)).strftime("%Y-%m-%d") for end in window]
        for window in access.windows
    ]
    # The season that has begun is open at once, and neighbouring months are one window.
    assert spans[:4] == [
        ["2026-08-20", "2026-08-31"],
        ["2026-12-01", "2026-12-31"],
        ["2027-07-01", "2027-08-31"],
        ["2027-12-01", "2027-12-31"],
    ]
    assert access.windows[-1][1] > 800.0


def test_windows_of_slow_time_are_counted_from_the_last_reading():
    access = access_of(
        order_of({"access": {"windows": [[10, 20], [90, 130], [200, 210]]}}), 2.0
    )
    assert access.windows == ((0.0, 15.0), (50.0, 55.0))


@pytest.mark.parametrize(
    ("decision", "text"),
    [
        ({"access": {"months": [5]}}, "decision.access.months"),
        ({"access": {"windows": [[10, 20]]}}, "closed at slow time 20"),
    ],
)
def test_access_that_cannot_be_placed_in_time_is_refused(decision, text):
    with pytest.raises(NotPlannableError, match=text):
        access_of(order_of(decision, pace=None), 1.0)


@pytest.mark.parametrize(
    ("access", "text"),
    [
        ({"months": [13]}, "12"),
        ({"windows": [[3, 2]]}, "out of order"),
        ({"months": [1], "windows": [[1, 2]]}, "Give one of them"),
    ],
)
def test_access_that_cannot_be_is_not_registered(access, text):
    with pytest.raises(ValueError, match=text):
        order_of({"access": access})


@pytest.mark.parametrize("text", ["0-3", "5-", "13", "May", "1-2-3", ""])
def test_months_that_are_none_are_refused(text):
    with pytest.raises(ValueError, match="numbers from 1 to 12"):
        months_of(text)


def ordering(accepted, lead=1.0, start=0.3):
    """Sentence about the last order of futures that fail after about six years."""
    rng = np.random.default_rng(1)
    grown = start + np.cumsum(0.02 * rng.random((400, len(TIME))), axis=1)
    costs = Costs(failure=Cost(20.0), repair=Cost(2.0))
    terms = Terms(access=Access(lead=lead), accepted=accepted)
    made = make_plan(from_paths(TIME, grown), costs, terms)
    when = TimeWording("year", 0, 31557600.0, ahead=lead > 0)
    return made, last_order_sentence(made, when), sentence_of(made, "EUR", when)


def test_the_last_safe_day_is_stated_with_its_limit_and_where_that_is_from():
    made, told, _ = ordering(0.05)
    at = datetime.datetime.fromtimestamp(made.last_order.order * 31557600.0, datetime.UTC)
    assert told.startswith("Last safe day to order a repair: in ")
    assert f"({at:%Y-%m-%d})" in told
    assert "If the repair is ordered on that day, a failure before it takes effect has" in told
    assert told.endswith(
        "The accepted probability is 5 %, from the last reading until a repair takes effect."
    )
    _, at_once, _ = ordering(0.05, lead=0.0)
    assert "If the repair is done on that day, a failure before it takes effect" in at_once
    _, by_cost, _ = ordering(None)
    assert by_cost.endswith("costs more, by the costs that are registered.")


def test_a_last_safe_day_that_has_passed_says_what_ordering_now_would_do():
    made, told, plan = ordering(0.05, lead=3.0, start=0.75)
    assert made.last_order.order < 0.0
    assert told.startswith("The last safe day to order a repair was ")
    assert "Ordered now, it is done in 3 years" in told
    assert plan.startswith("Order ")


def test_a_repair_at_a_trigger_that_pays_is_told_beside_fixed_dates_that_do_not():
    """A few futures fail, and readings tell which: no date serves all, a threshold does."""
    rates = np.where(np.arange(400) % 50 == 0, 0.16, 0.0)[:, None]
    new = from_paths(TIME, np.zeros((2, len(TIME))))
    futures = from_paths(TIME, 0.2 + rates * TIME, renewed=lambda _: new)
    costs = Costs(failure=Cost(20.0), repair=Cost(2.0))
    told = last_order_sentence(make_plan(futures, costs, Terms()), WHEN)
    assert "no repair on a fixed date costs less than running to failure; “repair once" in told
    assert told.endswith("” does.")
    dear = Costs(failure=Cost(2.0), repair=Cost(2.0))
    told = last_order_sentence(make_plan(futures, dear, Terms()), WHEN)
    assert told.endswith("costs less than running to failure.")
