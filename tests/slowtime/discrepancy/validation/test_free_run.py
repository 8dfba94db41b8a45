"""By what a model is judged where nothing was held out: tails, or pieces too short for one."""

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.noise.colour import white_noise
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.discrepancy.validation.free_run import (
    SPECTRUM_POINTS,
    evaluation_trials,
    learnt_and_unseen,
    refit_on_heads,
    spectra_of,
)
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.two_mass_chain import TWO, records_of


def trial_of(samples):
    noise = np.random.default_rng(1).standard_normal((samples, 1))
    return Trial(inputs=np.zeros((samples, 0)), outputs=noise, rate_hz=50.0)


@pytest.mark.parametrize("samples", [64, 90, 191, 192, 500])
def test_a_tail_is_a_third_where_that_is_a_record_and_else_the_whole(samples):
    trial = trial_of(samples)
    (tail,) = evaluation_trials((trial,), ())
    third = samples - samples * 2 // 3
    assert len(tail.outputs) == (third if third >= MIN_SAMPLES else samples)
    np.testing.assert_array_equal(tail.outputs, trial.outputs[-len(tail.outputs) :])
    held = (trial_of(70),)
    assert evaluation_trials((trial,), held) is held


@pytest.mark.parametrize(("samples", "fitted", "judged"), [(300, 200, 100), (90, 90, 90)])
def test_what_is_fitted_once_is_not_judged_by_unless_it_is_too_short(samples, fitted, judged):
    trial = trial_of(samples)
    (learnt,), (tail,) = learnt_and_unseen((trial,), ())
    assert (len(learnt.outputs), len(tail.outputs)) == (fitted, judged)
    held = (trial_of(70),)
    assert learnt_and_unseen((trial,), held) == ((trial,), held)


def test_a_fit_to_short_pieces_is_judged_as_it_is():
    pieces = tuple(one.part(0, 90) for one in records_of(()))
    fit = refit(Plant.of(TWO), pieces)
    assert refit_on_heads(fit, pieces) is fit


@pytest.mark.parametrize("lengths", [(64,), (90, 500), (333,), (4096, 900), (5000,)])
def test_spectra_of_records_however_short_have_power_everywhere(lengths):
    trials = [trial_of(samples) for samples in lengths]
    zeros = [np.zeros_like(trial.outputs) for trial in trials]
    noise = white_noise([[0.04]] * 2)
    spectra = spectra_of(trials, zeros, zeros, noise)
    assert len(spectra.frequency_hz) <= SPECTRUM_POINTS
    assert len(spectra.frequency_hz) >= min(*lengths, 4 * SPECTRUM_POINTS) // 4
    assert (spectra.measured > 0).all()
    width = spectra.frequency_hz[1] - spectra.frequency_hz[0]
    variance = np.mean([trial.outputs.var() for trial in trials])
    assert spectra.measured.sum() * width == pytest.approx(variance, rel=0.1)
    np.testing.assert_array_equal(spectra.before, spectra.measured)


def test_beyond_what_a_slower_record_holds_only_the_faster_tells():
    slow, fast = trial_of(400), trial_of(800)
    fast = Trial(inputs=fast.inputs, outputs=fast.outputs, rate_hz=100.0)
    zeros = [np.zeros_like(trial.outputs) for trial in (slow, fast)]
    both = spectra_of([slow, fast], zeros, zeros, white_noise([[0.04]] * 2)).measured
    alone = spectra_of([fast], zeros[1:], zeros[1:], white_noise([[0.04]] * 2)).measured
    high = len(both) // 2 + 2
    np.testing.assert_allclose(both[high:], alone[high:])
