"""The sentence of a plan says when the repair falls due, or that it probably does not."""

import dataclasses

import numpy as np
import pytest

from slowtime.decisions import Cost, Costs, Plan, Terms, from_paths, make_plan
from twin_server.estimate.plans.wording import When, sentence_of

TIME = np.linspace(0.0, 10.0, 121)
WHEN = When("year", None, None)


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
    assert When(unit, None, None, slow_unit).span(12.5) == says
