import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.ambient.spectra import fit_spectra, spectral_problem
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import (
    Description,
    Input,
    Node,
    Sensor,
    Spring,
    Tolerance,
    assemble,
)
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.simulation import ambient_structure

RATE, SECONDS, NOISE = 64.0, 200.0, 5e-2


def rig():
    return Description(
        name="two",
        nodes=(Node(id="m1", mass_kg=1.0), Node(id="m2", mass_kg=1.2)),
        elements=(
            Spring(
                id="j0", between=("base", "m1"), stiffness_n_per_m=900.0, damping_n_s_per_m=1.4
            ),
            Spring(
                id="j1", between=("m1", "m2"), stiffness_n_per_m=800.0, damping_n_s_per_m=1.3
            ),
        ),
        sensors=tuple(
            Sensor(channel=f"a{i}", quantity="acceleration", node=f"m{i}", unit="m/s^2")
            for i in (1, 2)
        ),
        tolerance=Tolerance(stiffness=0.03, damping=0.3),
    )


def shaken(seed, change=(1.0, 1.0), tone=0.0):
    """Response to forces of which the second is the stronger."""
    rng = np.random.default_rng(seed)
    true = with_values(
        rig(),
        {("stiffness", "j0"): 900 * change[0], ("stiffness", "j1"): 800 * change[1]},
    )
    samples = round(RATE * SECONDS)
    outputs = ambient_structure(
        assemble(true), samples, RATE, rng, force_psd=np.array([1e-2, 3e-2])
    )
    outputs = outputs + NOISE * rng.standard_normal(outputs.shape)
    times = np.arange(samples) / RATE
    outputs = outputs + tone * np.sin(2 * np.pi * 4.0 * times)[:, None] * [1.0, -0.4]
    return Trial(inputs=np.zeros((samples, 0)), outputs=outputs, rate_hz=RATE)


def compared(*trials):
    return fit_spectra(spectral_problem(Plant.of(rig()), trials))


@pytest.fixture(scope="module")
def results():
    return [compared(shaken(seed, (1.02, 0.97))) for seed in range(4)]


@pytest.mark.long
def test_constants_strengths_and_noise_come_out_within_their_errors(results):
    scores = [(r.values[:2] - np.array([900 * 1.02, 800 * 0.97])) / r.sd[:2] for r in results]
    assert np.abs(scores).max() < 3.5
    assert 0.5 < np.std(scores) < 1.7
    forces = np.mean([r.force_density for r in results], axis=0)
    assert forces == pytest.approx(np.array([[1e-2, 3e-2]]), rel=0.1)
    noise = np.mean([r.noise_density for r in results], axis=0)
    assert noise == pytest.approx(np.full((1, 2), 2 * NOISE**2 / RATE), rel=0.3)


@pytest.mark.long
def test_a_model_that_lacks_nothing_is_not_accused(results):
    assert min(r.p_value for r in results) > 1e-3
    assert [r.failed_bands() for r in results] == [()] * 4


def test_a_line_that_is_no_mode_is_noticed_in_its_band():
    result = compared(shaken(3, tone=0.1))
    assert result.p_value < 1e-6
    assert any(low <= 4.0 <= high for low, high in result.failed_bands())
    assert len(result.failed_bands()) < len(result.bands) / 4


def test_bands_that_fail_side_by_side_are_one():
    result = compared(shaken(3, tone=0.1))
    values = [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    bands = tuple(
        dataclasses.replace(one, p_value=p)
        for one, p in zip(result.bands, values, strict=False)
    )
    failed = dataclasses.replace(result, bands=bands).failed_bands()
    assert failed == (
        (bands[0].low_hz, bands[1].high_hz),
        (bands[3].low_hz, bands[3].high_hz),
        (bands[6].low_hz, bands[8].high_hz),
    )


def test_a_stiffness_beyond_its_tolerance_is_pulled_out_of_it():
    result = compared(shaken(4, (1.0, 0.8)))
    assert result.pulls["stiffness", "j1"] < -5
    assert abs(result.pulls["stiffness", "j0"]) < 2


def test_records_with_an_input_are_sent_elsewhere():
    driven = dataclasses.replace(
        rig(), inputs=(Input(channel="u", kind="force", node="m1", unit="N"),)
    )
    with pytest.raises(ValueError, match="Use refit and locate"):
        spectral_problem(Plant.of(driven), (shaken(0),))


@pytest.mark.slow
def test_the_chance_of_a_false_accusation_is_as_stated():
    chances = np.array([compared(shaken(seed)).p_value for seed in range(100, 220)])
    assert np.mean(chances < 0.05) < 0.12
    assert np.mean(chances < 0.01) < 0.05
    assert np.mean(chances < 0.5) == pytest.approx(0.5, abs=0.2)
