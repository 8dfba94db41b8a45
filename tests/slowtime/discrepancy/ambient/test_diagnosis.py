"""Ambient campaigns: what can be said is said, and no more."""

import numpy as np
import pytest

from slowtime.discrepancy.ambient.diagnosis import _bands_text
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.records import Campaign, Trial
from slowtime.dynamics.description import (
    Description,
    Node,
    Sensor,
    Spring,
    Tolerance,
    assemble,
)
from slowtime.dynamics.simulation import ambient_structure

RATE, SECONDS = 64.0, 120.0


def rig():
    return Description(
        name="one",
        nodes=(Node(id="m1", mass_kg=1.0),),
        elements=(
            Spring(
                id="j0", between=("base", "m1"), stiffness_n_per_m=900.0, damping_n_s_per_m=1.4
            ),
        ),
        sensors=(Sensor(channel="a1", quantity="acceleration", node="m1", unit="m/s^2"),),
        tolerance=Tolerance(stiffness=0.03, damping=0.3),
    )


def answered(stiffness=900.0, tone=0.0):
    rng = np.random.default_rng(5)
    true = with_values(rig(), {("stiffness", "j0"): stiffness})
    samples = round(RATE * SECONDS)
    outputs = ambient_structure(assemble(true), samples, RATE, rng, force_psd=np.array([1e-2]))
    outputs = outputs + 0.05 * rng.standard_normal(outputs.shape)
    outputs[:, 0] += tone * np.sin(2 * np.pi * 7.0 * np.arange(samples) / RATE)
    trial = Trial(inputs=np.zeros((samples, 0)), outputs=outputs, rate_hz=RATE)
    return diagnose(Campaign(description=rig(), trials=(trial,), holdout=()))


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({}, "nothing_missing"),
        ({"stiffness": 680.0}, "parameters_only"),
        ({"tone": 0.5}, "unknown_effect"),
    ],
)
def test_spectra_alone_name_no_effect_but_tell_whether_they_are_the_models(change, verdict):
    found = answered(**change)
    assert found.verdict == verdict
    assert found.effects == ()
    assert found.experiment is not None
    assert "Measure what drives" in found.sentence
    if verdict == "unknown_effect":
        assert any(low <= 7.0 <= high for low, high in found.when.bands_hz)
    if verdict == "parameters_only":
        number = found.moved["stiffness j0"]
        assert abs(number.value - 680.0) < 4 * number.sd


def test_a_silent_span_is_told_without_an_input_too():
    samples = round(RATE * SECONDS)
    outputs = np.random.default_rng(6).standard_normal((samples, 1)) * 0.3
    outputs += ambient_structure(
        assemble(rig()), samples, RATE, np.random.default_rng(7), force_psd=np.array([1e-2])
    )
    outputs[900:1400] = 0.0
    trial = Trial(inputs=np.zeros((samples, 0)), outputs=outputs, rate_hz=RATE)
    campaign = Campaign(description=rig(), trials=(trial,), holdout=())
    found = diagnose(campaign)
    assert [f.fault for f in found.findings] == ["zero"]


@pytest.mark.parametrize("count", [1, 4, 5, 40])
def test_a_sentence_names_four_bands_at_most_and_counts_the_others(count):
    bands = tuple((float(k), k + 0.5 + 0.01 * k) for k in range(1, count + 1))
    told = _bands_text(bands)
    assert told.count(" to ") == min(count, 4)
    assert f"{bands[-1][0]:.3g} to {bands[-1][1]:.3g} Hz" in told  # the widest
    assert (f"{count - 4} more bands between 1 and" in told) == (count > 4)
