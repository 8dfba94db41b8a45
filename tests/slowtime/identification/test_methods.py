"""One record by every method: the same modes, the same lines, in the same order."""

import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime.identification.bayes import fit
from slowtime.identification.methods import by_method
from slowtime.identification.mode_shapes.criteria import mac

SHAPES = np.array([[1.0, 0.9], [0.6, -0.8], [0.3, -0.7]])


@pytest.fixture(scope="module")
def heard():
    rng, count, rate = np.random.default_rng(1), 16_000, 40.0
    samples = 0.05 * rng.standard_normal((count, 3))
    for hz, shape in zip((2.0, 5.0), SHAPES.T, strict=True):
        ringing = ambient_acceleration(Oscillator.from_modal(hz, 0.01), count, rate, rng)
        samples = samples + np.outer(ringing / ringing.std(), shape)
    samples += np.outer(np.sin(2 * np.pi * 3.21 * np.arange(count) / rate), [0.5, 0.4, 0.3])
    return samples, rate


@pytest.mark.parametrize("method", ["modes", "bayes", "fdd", "efdd"])
def test_every_method_finds_modes_and_lines(heard, method):
    samples, rate = heard
    result = by_method(samples, rate, method=method)
    kinds = [mode.kind for mode in result.modes]
    assert kinds == ["structural", "harmonic", "structural"]
    for mode, hz, shape in zip(result.structural, (2.0, 5.0), SHAPES.T, strict=True):
        assert abs(mode.frequency_hz.value - hz) < 4 * mode.frequency_hz.sd
        assert mac(mode.shape, shape) > 0.98
        assert 0 <= mode.quality <= 1
    assert result.modes[1].frequency_hz.value == pytest.approx(3.21, abs=0.01)
    assert len(result.spectrum_hz) == len(result.singular_values)


@pytest.mark.long
def test_poles_of_the_diagram_belong_to_the_modes_they_are_near(heard):
    samples, rate = heard
    result = by_method(samples, rate, method="bayes")
    diagram = result.stabilisation
    assert set(diagram.mode[diagram.mode >= 0]) == {0, 2}
    for place in (0, 2):
        of_mode = diagram.frequency_hz[diagram.mode == place]
        hz = result.modes[place].frequency_hz.value
        assert np.median(of_mode) == pytest.approx(hz, rel=0.01)


def test_a_band_is_kept_to(heard):
    samples, rate = heard
    result = by_method(samples, rate, method="efdd", band_hz=(1.0, 3.0))
    assert len(result.modes) == 1


def test_a_bayesian_fit_that_did_not_reach_its_top_gives_no_values(heard, monkeypatch):
    samples, rate = heard
    candidates = by_method(samples, rate, method="modes").structural
    climb = fit._climb
    monkeypatch.setattr(fit, "_climb", lambda *given, **rest: (climb(*given, **rest)[0], False))
    modes = by_method(samples, rate, method="bayes").structural
    for mode, candidate in zip(modes, candidates, strict=True):
        assert "not_converged" in mode.flags
        assert mode.frequency_hz == candidate.frequency_hz
        assert mode.damping_ratio == candidate.damping_ratio
