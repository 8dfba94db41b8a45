import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring

ONE = Description(
    name="one",
    nodes=(Node(id="m1", mass_kg=1.0),),
    elements=(Spring(id="j1", between=("base", "m1"), stiffness_n_per_m=100.0),),
    inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
    sensors=(Sensor(channel="a", quantity="acceleration", node="m1", unit="m/s^2"),),
)


def trial(columns=1, sensors=1, samples=100, **changes):
    given = Trial(
        inputs=np.zeros((samples, columns)), outputs=np.ones((samples, sensors)), rate_hz=50.0
    )
    return dataclasses.replace(given, **changes)


def test_what_is_not_finite_is_not_used_and_reads_as_zero():
    outputs = np.ones((100, 1))
    outputs[7] = np.nan
    record = trial(outputs=outputs)
    assert not record.used[7, 0]
    assert record.measured[7, 0] == 0
    assert record.used.sum() == 99


def test_a_mask_of_ones_own_is_kept_but_cannot_call_nan_good():
    outputs = np.ones((100, 1))
    outputs[7] = np.nan
    use = np.ones((100, 1), dtype=bool)
    use[3] = False
    assert set(np.flatnonzero(~trial(outputs=outputs, use=use).used)) == {3, 7}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"rate_hz": 0.0}, "not a valid sampling rate"),
        ({"inputs": np.zeros((99, 1))}, "Cut both"),
        ({"samples": 20}, "at least 64 are needed"),
    ],
)
def test_a_record_that_is_none_says_why(changes, text):
    with pytest.raises(ValueError, match=text):
        trial(**changes)


def test_columns_that_do_not_fit_the_model_are_refused():
    with pytest.raises(ValueError, match=r"2 sensor columns, the model lists 1"):
        Campaign(description=ONE, trials=(trial(sensors=2),))
    with pytest.raises(ValueError, match=r"0 input columns, the model lists 1"):
        Campaign(description=ONE, trials=(trial(),), holdout=(trial(columns=0),))


def test_an_input_must_be_known_throughout():
    inputs = np.zeros((100, 1))
    inputs[5] = np.inf
    with pytest.raises(ValueError, match=r"Input 'u' is not finite in 1 samples"):
        Campaign(description=ONE, trials=(trial(inputs=inputs),))


def test_there_must_be_something_to_learn_from():
    with pytest.raises(ValueError, match="no record to learn from"):
        Campaign(description=ONE, trials=())
