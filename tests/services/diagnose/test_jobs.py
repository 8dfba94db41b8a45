"""What is found does not depend on the number of processes that share a diagnosis."""

import dataclasses
import sys

import pytest

from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.workers import Workers, shared_among
from slowtime.dynamics.effects import Effect, Place
from slowtime.dynamics.work import metered
from slowtime_services.diagnose.document import document_of
from slowtime_services.engines.forks import ForkedWorkers
from tests.slowtime.discrepancy.two_mass_chain import (
    CUBIC,
    DRAG,
    FIRST,
    KINDS,
    LATE,
    TWO,
    records_of,
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux"),
]
FRICTION = Effect("coulomb", FIRST, {"friction_n": 1.0})
GAIN = Effect("sensor_gain", Place("sensor", "x_m1"), {"gain": 1.2})
CASES = {
    "nothing": (),
    "a law": (CUBIC,),
    "another law": (DRAG,),
    "friction, whose events are located": (FRICTION,),
    "an input that is late": (LATE,),
    "a fault of a sensor": (GAIN,),
    "two effects": (CUBIC, DRAG),
}
SHORT = 3_000_000
"""[units] A budget that ends within the search."""


def report(effects, workers: Workers | None, budget=None):
    trials = records_of(effects, count=3, samples=400)
    campaign = Campaign(description=TWO, trials=trials[:2], holdout=trials[2:])
    with metered() as meter:
        over = (lambda: meter.spent > budget) if budget else None
        with shared_among(workers):
            found = diagnose(campaign, kinds=KINDS, late=over, over=over)
    whole = document_of(dataclasses.replace(found, seconds=0.0))
    return whole.model_dump_json(), meter.spent


@pytest.mark.parametrize("case", CASES)
def test_the_report_and_the_work_are_the_same_to_the_last_byte(case):
    assert report(CASES[case], ForkedWorkers(2)) == report(CASES[case], None)


@pytest.mark.parametrize("case", ["a law", "two effects"])
def test_the_same_where_the_budget_ends_within_the_search(case):
    alone = report(CASES[case], None, SHORT)
    assert report(CASES[case], ForkedWorkers(3), SHORT) == alone
