"""Composites over REST: what is told of a yard is what its tree makes of its members."""

import numpy as np
import pytest

from slowtime.reliability.trees import (
    CommonCause,
    Equicorrelated,
    k_of_n,
    parallel,
    series,
    simulate,
)
from twin_server.estimate.forecast import futures
from twin_server.serve.composites import failure

from .conftest import IDS, YARD

pytestmark = pytest.mark.long  # each beam learns its forecast


def whole_tree():
    return series(
        k_of_n(2, *IDS[:3]),
        parallel(*IDS[3:6]),
        k_of_n(2, *IDS[6:9], IDS[3]),
        parallel(series(IDS[9], IDS[10]), IDS[11]),
    )


@pytest.fixture(scope="module")
def told(yard):
    return yard.get("/api/v1/composites/lab.yard").json()


def test_the_probability_of_the_yard_is_that_of_sampling_its_members(yard):
    fewer = {
        **YARD,
        "members": ["lab.line", *IDS[3:11]],
        "tree": {"series": [*YARD["tree"]["series"][:3], {"parallel": IDS[9:11]}]},
    }
    assert yard.client.put("/api/v1/composites/lab.full", json=fewer).status_code == 201
    told = yard.get("/api/v1/composites/lab.full").json()
    values = {one["id"]: one["failure"]["value"] for one in told["twins"]}
    assert max(values.values()) > 0.3  # some are close to their threshold
    assert values[IDS[0]] < 0.01  # its own threshold, in the line, is farther
    groups = (Equicorrelated(tuple(IDS[6:9]), 0.5), CommonCause((IDS[3], IDS[4]), 0.2))
    tree = series(*whole_tree().inputs[:3], parallel(*IDS[9:11]))
    estimate, sd = simulate(tree, values, groups, np.random.default_rng(5), 400_000)
    failed = told["failure"]
    assert abs(failed["value"] - estimate) < 4 * sd + 1e-12
    assert failed["lowest"] <= failed["lo"] <= failed["value"] <= failed["hi"]
    assert failed["hi"] <= failed["highest"]
    assert failed["horizon"] == 30.0
    shares = {one["id"]: one["importance"]["criticality"] for one in told["twins"]}
    assert told["health"]["worst"] == max(shares, key=lambda one: shares[one])
    line = next(one for one in told["members"] if one["id"] == "lab.line")
    assert line["kind"] == "line"
    sooner = yard.get("/api/v1/composites/lab.full", horizon=1.0).json()["failure"]
    assert sooner["value"] <= failed["value"]
    assert yard.client.delete("/api/v1/composites/lab.full").status_code == 204


def test_drift_rates_of_a_line_are_pooled_and_hold_the_true_ones(yard):
    line = {"kind": "line", "members": IDS}
    assert yard.client.put("/api/v1/composites/lab.all", json=line).status_code == 201
    (pool,) = yard.get("/api/v1/composites/lab.all").json()["pooled"]
    assert pool["quantity"] == "stiffness_change"
    assert [one["id"] for one in pool["members"]] == IDS
    truth = [-(0.10 + 0.012 * i) / 60 for i in range(12)]
    held = [one["lo"] <= r <= one["hi"] for one, r in zip(pool["members"], truth, strict=True)]
    assert sum(held) >= 10
    new = pool["members"][11]
    assert new["own"] is None
    assert new["shrinkage"] == 1.0
    assert new["lo"] == pool["another"]["lo"]
    assert pool["fleet"]["lo"] < np.mean(truth[:11]) < pool["fleet"]["hi"]
    assert yard.client.delete("/api/v1/composites/lab.all").status_code == 204


def test_the_band_of_a_member_is_that_of_as_many_draws_as_a_forecast_makes():
    assert failure.PATHS == futures.PATHS
    rng = np.random.default_rng(0)
    held = 0
    for p in (0.0005, 0.02, 0.5):
        for seen in rng.binomial(failure.PATHS, p, 200):
            lo, hi = failure.interval(seen / failure.PATHS)
            held += lo <= p <= hi
    assert 0.92 < held / 600 < 0.985


def test_a_member_without_a_forecast_leaves_bounds_and_says_so(told):
    twins = {one["id"]: one for one in told["twins"]}
    assert list(twins) == [*IDS[3:], *IDS[:3]]
    alone = twins[IDS[11]]
    assert (alone["failure"]["value"], alone["importance"]) == (None, None)
    assert (alone["failure"]["lo"], alone["failure"]["hi"]) == (0.0, 1.0)
    failed = told["failure"]
    assert failed["value"] is None
    assert 0 <= failed["any_dependence"]["lo"] <= failed["lo"] < failed["hi"] <= 1
    assert any(f"{IDS[11]} has too few valid readings" in one for one in failed["reasons"])
    assert told["health"]["twins"] == 12


def test_a_member_with_limit_states_fails_by_them(yard):
    state = {"kind": "threshold", "name": "soft", "quantity": "stiffness_change", "below": -0.2}
    nominal = {"frequency_hz": 3.0, "damping_ratio": 0.02}
    body = {"nominal": nominal, "limit_states": [state]}
    assert yard.client.put(f"/api/v1/twins/{IDS[4]}", json=body).status_code == 200
    wanted = {"members": [IDS[4]], "horizon": 30.0}
    assert yard.client.put("/api/v1/composites/lab.one", json=wanted).status_code == 201
    found = yard.get("/api/v1/composites/lab.one").json()["failure"]
    risk = yard.get(f"/api/v1/twins/{IDS[4]}/risk", horizon=30.0).json()
    within = risk["limit_states"][0]["within"]
    assert found["value"] == pytest.approx(within["value"], abs=1e-9)
    assert found["horizon"] == 30.0
    assert found["lo"] <= within["lo"] <= within["hi"] <= found["hi"]
    assert yard.client.delete("/api/v1/composites/lab.one").status_code == 204
