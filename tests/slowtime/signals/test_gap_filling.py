"""Samples that are missing are estimated as well as the spectrum allows, and no better."""

import numpy as np
import pytest
import scipy.signal

from slowtime.signals.gap_filling import bridge

COUNT = 6000


def regular_losses(run: int = 2, every: int = 60):
    present = np.ones(COUNT, dtype=bool)
    place = np.arange(COUNT) % every
    present[(place >= 20) & (place < 20 + run)] = False
    return present


def vibration(noise: float, seed: int = 3):
    rng = np.random.default_rng(seed)
    rows = []
    for pole in (0.15, 0.4):
        sections = scipy.signal.tf2sos(
            [1.0], [1.0, -2 * 0.98 * np.cos(2 * np.pi * pole), 0.98**2]
        )
        wave = scipy.signal.sosfilt(sections, rng.standard_normal(COUNT))
        rows.append(wave / wave.std())
    return np.column_stack(rows) + noise * rng.standard_normal((COUNT, 2)) + 9.81


@pytest.mark.parametrize("run", [1, 2, 5])
def test_the_error_that_is_told_is_the_error_that_is_made(run):
    samples, present = vibration(0.05), regular_losses(run)
    found = bridge(np.where(present[:, None], samples, np.nan), present)
    made = ((found.samples - samples)[~present] ** 2).mean(axis=0) / samples.var(axis=0)
    assert made.max() == pytest.approx(found.error, rel=0.5)
    assert found.error < 0.5


def test_what_was_measured_stays_as_it_was():
    samples, present = vibration(0.05), regular_losses()
    found = bridge(samples, present)
    np.testing.assert_allclose(found.samples[present], samples[present], rtol=0, atol=1e-12)


def test_white_noise_cannot_be_bridged_and_says_so():
    noise = np.random.default_rng(0).standard_normal((COUNT, 1))
    assert bridge(noise, regular_losses()).error > 0.9


def test_a_smooth_signal_is_bridged_far_better_than_by_a_line():
    time = np.arange(COUNT)
    wave = (np.sin(0.4 * time) + np.sin(0.9 * time + 1))[:, None]
    present = regular_losses(3)
    found = bridge(wave, present)
    line = np.interp(time, time[present], wave[present, 0])[:, None]
    bridged, straight = (np.abs(x - wave)[~present].max() for x in (found.samples, line))
    assert bridged < 0.1 * straight


def test_a_constant_is_its_own_estimate():
    found = bridge(np.full((COUNT, 1), 2.5), regular_losses())
    assert (found.samples == 2.5).all()
    assert found.error == 0.0


@pytest.mark.parametrize("share", [0.6, 1.0])
def test_too_little_to_know_the_spectrum_is_refused(share):
    present = np.ones(200, dtype=bool)
    present[1 : 1 + int(share * 198)] = False
    with pytest.raises(ValueError, match="samples are there"):
        bridge(np.zeros((200, 1)), present)
