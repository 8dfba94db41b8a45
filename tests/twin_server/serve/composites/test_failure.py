"""The failure probability of a member by its limit states, as its composite takes it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from twin_server.serve.composites.failure import failure_probability


def failing(*within, reasons=(), since=30.0):
    """Give the failure of a twin whose limit states are reached with these probabilities."""
    states = [{"within": one, "reasons": []} for one in within]
    risk = {
        "reasons": list(reasons),
        "limit_states": states,
        "since": since,
        "horizon": 90.0,
        "slow_time_unit": "d",
    }
    knowledge: Any = SimpleNamespace(
        registration=lambda _: SimpleNamespace(limit_states=("given",)),
        risk=lambda twin_id, horizon: risk,
    )
    return failure_probability(knowledge, "lab.beam", None)


def band(value, below, above):
    """Ends of the 90 % band whose halves have these normal standard deviations."""
    lo, hi = value - stats.norm.ppf(0.95) * below, value + stats.norm.ppf(0.95) * above
    return {"value": value, "lo": lo, "hi": hi}


@pytest.mark.parametrize(("below", "above"), [(0.01, 0.01), (0.002, 0.03), (0.02, 0.0)])
def test_a_band_of_90_percent_becomes_one_of_95_on_either_side(below, above):
    found = failing(band(0.1, below, above))
    assert found.value == pytest.approx(0.1)
    assert found.lo == pytest.approx(0.1 - stats.norm.ppf(0.975) * below)
    assert found.hi == pytest.approx(0.1 + stats.norm.ppf(0.975) * above)
    assert (found.horizon, found.unit, found.reasons) == (60.0, "d", ())


@pytest.mark.parametrize(("value", "sd"), [(0.01, 0.05), (0.99, 0.05), (0.5, 2.0)])
def test_a_band_ends_at_impossible_and_certain(value, sd):
    found = failing(band(value, sd, sd))
    assert 0.0 <= found.lo <= found.value <= found.hi <= 1.0


def test_of_several_limit_states_any_suffices_and_the_band_holds_for_any_dependence():
    parts = [band(0.1, 0.01, 0.01), band(0.2, 0.02, 0.03)]
    found, alone = failing(*parts), [failing(one) for one in parts]
    assert found.value == pytest.approx(1 - 0.9 * 0.8)
    # Wholly dependent, the likelier decides; exclusive, their probabilities add.
    assert found.lo == pytest.approx(max(one.lo for one in alone))
    assert found.hi == pytest.approx(sum(one.hi for one in alone))


@pytest.mark.parametrize(
    ("within", "since"), [((), 30.0), ((None,), 30.0), ((band(0.1, 0.01, 0.01),), None)]
)
def test_without_a_probability_of_each_nothing_is_known(within, since):
    found = failing(*within, since=since)
    assert np.isnan(found.value)
    assert (found.lo, found.hi) == (0.0, 1.0)
    assert found.reasons == ("lab.beam has no failure probability yet.",)
    told = failing(*within, since=since, reasons=["Few readings.", "Few readings."])
    assert told.reasons == ("lab.beam: Few readings.",)
